"""Episodes of other worlds over their environments alone, with the same seeds and actions.

The bare side is what anybody gets from `gymnasium.make`: it resets and takes the recorded
actions. Ours is the domain's whole episode, with the hand-written tree.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path
from time import process_time
from typing import Any, Final

from benchmarks.figure import Effort, Figure, Missing, at_most
from benchmarks.pinned import settings
from benchmarks.turns import medians, ratio, turns
from islandgp.bt.core.language import parse
from islandgp.bt.core.node import Node
from islandgp.domain import Domain
from islandgp.domains.gymnasium import domain as gymnasium_domain

FOLDER: Final = Path(gymnasium_domain.__file__).parent / "trees"
TREES: Final = {
    "cartpole": FOLDER / "cartpole.bt",
    "lunarlander": FOLDER / "lunarlander.bt",
}
EPISODES: Final = {Effort.TINY: 1, Effort.QUICK: 6, Effort.FULL: 12}  # in a pair, seeds 0, 1, ...
ROUNDS: Final = {Effort.TINY: 1, Effort.QUICK: 3, Effort.FULL: 15}
GOALS: Final = {"cartpole": 1.5, "lunarlander": 1.2}


@dataclass(frozen=True, slots=True)
class Taken:
    """The actions of one episode."""

    level: str  # as gymnasium.make takes it
    seed: int
    actions: tuple[int, ...]


def measure(effort: Effort) -> list[Figure]:
    """Pairs of some episodes and the same actions in the bare environments."""
    if find_spec("gymnasium") is None:
        raise Missing("needs pip install 'islandgp[gymnasium]'")
    figures = []
    for name, file in TREES.items():
        chosen = settings(f"domain={name}")
        domain = chosen.problem().domain
        tree = parse(file.read_text(encoding="utf-8"), domain.schema.vocabulary)
        episodes = [_taken(domain, tree, seed) for seed in range(EPISODES[effort])]
        sides = [_episodes(domain, tree, len(episodes)), _bare(episodes)]
        for side in sides:
            side()  # what is made once is made
        rows = turns(sides, ROUNDS[effort], clock=process_time)
        steps = sum(len(episode.actions) for episode in episodes)
        ours, bare = medians(rows)
        figures += [
            Figure(
                f"{name}_ratio",
                ratio(rows, 0, 1),
                "",
                f"{len(episodes)} episodes, {steps:,} steps / the bare environment with the same"
                " actions; median over pairs",
                at_most(GOALS[name]),
            ),
            Figure(f"{name}_step_us", 1e6 * ours / steps, "us", "a step of the episodes"),
            Figure(f"{name}_bare_us", 1e6 * bare / steps, "us", "a step of the bare environment"),
        ]
    return figures


def _episodes(domain: Domain, tree: Node, count: int) -> Callable[[], object]:
    return lambda: [domain.run_episode(tree, seed, {}) for seed in range(count)]


def _taken(domain: Any, tree: Node, seed: int) -> Taken:
    """Runs an episode and takes down its actions."""
    level, env = domain.world.environment, domain.environment(render=False)
    step, actions = env.step, []

    def recorded(action: int) -> Any:
        actions.append(action)
        return step(action)

    env.step = recorded
    try:
        domain.run_episode(tree, seed, {})
    finally:
        del env.step  # the class's own again
    return Taken(level, seed, tuple(actions))


def _bare(episodes: list[Taken]) -> Callable[[], object]:
    """The environments with these actions and nobody who looks."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        import gymnasium

        environments: Mapping[str, Any] = {
            level: gymnasium.make(level, disable_env_checker=True)
            for level in {episode.level for episode in episodes}
        }

    def run() -> None:
        for episode in episodes:
            env = environments[episode.level]
            env.reset(seed=episode.seed)
            for action in episode.actions:
                env.step(action)

    return run
