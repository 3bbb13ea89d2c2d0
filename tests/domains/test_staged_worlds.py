"""A stage of the curriculum may change settings of the world."""

from __future__ import annotations

from typing import Any

import pytest

from islandgp.config.settings import read_settings
from islandgp.errors import ConfigError
from islandgp.evaluation.base import Job, simulate
from islandgp.running.parts import run_context
from tests.composed import plain

EARLY = {"episode": {"length": 10}}


def staged(*worlds: dict[str, Any]) -> dict[str, Any]:
    """The default configuration with a stage for each world."""
    stages = [
        {"epochs": [i, i], "multipliers": {}, "world": world} for i, world in enumerate(worlds, 1)
    ]
    return {**plain(), "curriculum": {"generations_per_epoch": 5, "stages": stages}}


def test_each_stage_has_its_world() -> None:
    """What a stage does not name stays as in the group `world`."""
    problem = read_settings(staged(EARLY, {"episode": {"length": 20}})).problem()
    job = Job("PatrolWaypoint", 0, 1)
    lasted = [simulate(problem, Job(job.tree, stage, job.seed)).seconds for stage in (0, 1)]
    assert lasted == [10, 20]
    assert problem.at(0).world.humanoids == problem.domain.world.humanoids  # type: ignore[attr-defined]


def test_supervisors_have_the_world_of_a_generation() -> None:
    """Their own episodes use the world of the population in that generation."""
    settings = read_settings(staged(EARLY, {"episode": {"length": 20}}))
    context = run_context(settings)
    lengths = [context.domain_in(g).world.episode.length for g in (0, 5, 6)]  # type: ignore[attr-defined]
    assert lengths == [10, 10, 20]
    plainly = read_settings(plain())
    context = run_context(plainly)
    assert context.domain_in(9) is context.domain


def test_without_changes_there_is_one_domain() -> None:
    """Each stage runs in the same object."""
    problem = read_settings(plain()).problem()
    assert all(problem.at(stage) is problem.domain for stage in range(4))


@pytest.mark.parametrize(
    ("world", "line"),
    [
        ({"episode": {"length": -1}}, "curriculum.stages.0.world.episode.length=-1: input should"),
        (
            {"episde": {"x": 1}},
            "curriculum.stages.0.world.episde: unknown key; did you mean"
            " curriculum.stages.0.world.episode?",
        ),
        ({"nothing": {}}, "curriculum.stages.0.world.nothing: unknown key;"),
        (
            {"episode": {"bloks": 1}},
            "curriculum.stages.0.world.episode.bloks: unknown key;",
        ),
    ],
)
def test_a_world_that_cannot_be(world: dict[str, Any], line: str) -> None:
    """One line that names the stage and its key."""
    with pytest.raises(ConfigError) as excinfo:
        read_settings(staged(world))
    assert str(excinfo.value).startswith(line)
    assert "\n" not in str(excinfo.value)
