"""What every benchmark runs on: the default experiment, trees by hand, fixed seeds."""

from __future__ import annotations

from functools import cache

from hydra import compose, initialize_config_dir
from omegaconf import OmegaConf

from islandgp.bt.core.language import parse
from islandgp.bt.core.node import Node
from islandgp.config.settings import Settings, read_settings
from islandgp.domain.rewards import worth
from islandgp.domains.island.events import Award
from islandgp.domains.island.vocabulary import VOCABULARY
from islandgp.domains.island.world import IslandWorld
from islandgp.evaluation.base import Problem
from islandgp.resources import resource

STAGE = 0  # of Table 2
SEED = 0  # of a run


@cache
def settings(*overrides: str) -> Settings:
    """The default experiment without tracking, with overrides as on the command line."""
    with initialize_config_dir(str(resource("conf")), version_base="1.3"):
        config = compose("config", ["tracking=off", *overrides])
    plain = OmegaConf.to_container(config, resolve=True, throw_on_missing=True)
    assert isinstance(plain, dict)
    return read_settings({str(key): value for key, value in plain.items()})


def setting(*overrides: str) -> Problem:
    """What evaluators get of it."""
    chosen = settings(*overrides)
    return Problem(chosen.make_domain(), chosen.curriculum)


def points() -> Award:
    """The rewards of the pinned stage."""
    return worth(settings().rewards, settings().curriculum.multipliers(STAGE))


def example(name: str) -> Node:
    """A tree of `grammar/examples`."""
    file = resource("grammar") / "examples" / f"{name}.bt"
    return parse(file.read_text(encoding="utf-8"), VOCABULARY)


def endless(world: IslandWorld, **changes: object) -> IslandWorld:
    """The world without the early endings, so that each episode takes the same number of steps.

    An empty battery still ends an episode. `changes` replace whole parts or single
    numbers: `humanoids={"count": 40}`.
    """
    plain = world.model_dump()
    length = world.episode.length
    never = {"stagnation": length, "stagnation_low_battery": length, "negative": length}
    plain["episode"] |= never
    for name, value in changes.items():
        plain[name] = {**plain[name], **value} if isinstance(value, dict) else value
    return IslandWorld.model_validate(plain)
