"""Perturbed worlds: drawn from a world's seed alone, within ranges; noisy and late sensors."""

from __future__ import annotations

import json
import re
import shlex
from math import inf
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from click.testing import CliRunner

from islandgp.bt.core.language import parse, to_text
from islandgp.bt.core.vocabulary import Action, Vocabulary, flag, number
from islandgp.cli import islandgp
from islandgp.config.settings import Settings, read_settings
from islandgp.domain import Schema, SensorFaults, Sensors
from islandgp.errors import ConfigError, DomainError, EvaluationError
from islandgp.evaluation.base import Job, Problem, simulate
from islandgp.evaluation.perturbation import Perturbation
from islandgp.evaluation.serial import Serial
from islandgp.resources import resource
from tests.composed import composed, plain
from tests.running.commands import ROOT

KEYS = {
    "on": flag("a flag"),
    "x": number("a number", 0, 10, most=10, noise=2),
    "y": number("", 0, 1),
}
ALL_ROUNDER = parse((resource("grammar") / "examples" / "all_rounder.bt").read_text("utf-8"))
SHORT = "world.episode.length=40"


def sensors(noise: float, delay: int, seed: int = 1) -> Sensors:
    """Sensors of the keys above."""
    return SensorFaults(noise, delay).sensors(KEYS, seed)


def test_sensors_without_faults() -> None:
    """What the tree sees is what there is."""
    see = sensors(0, 0)
    assert [see([1, x, 0.5]) for x in range(3)] == [[1, x, 0.5] for x in range(3)]


def test_noise() -> None:
    """Only keys that declare it have some; it is as large as asked for, and stays in the range."""
    see = sensors(1, 0)
    values = np.array([see([1, 5, 0.5]) for _ in range(4000)])
    assert (values[:, 0] == 1).all()
    assert (values[:, 2] == 0.5).all()
    assert values[:, 1].min() >= 0
    assert values[:, 1].max() <= 10
    assert values[:, 1].std() == pytest.approx(2, rel=0.1)
    repeated = sensors(1, 0)
    assert [repeated([1, 5, 0.5]) for _ in range(3)] == values[:3].tolist()
    other = sensors(1, 0, seed=2)
    assert other([1, 5, 0.5]) != values[0].tolist()


def test_delay() -> None:
    """A world's delay is one of 0 to the greatest; until it is over the first values are seen."""
    delays = set()
    for seed in range(30):
        see = sensors(0, 2, seed)
        values = [see([0, x, 0])[1] for x in range(6)]
        delay = values.count(0) - 1
        assert values == [max(0, x - delay) for x in range(6)]
        delays.add(delay)
    assert delays == {0, 1, 2}


RANGES = Perturbation.model_validate(
    {"world": {"robot": {"charge_below": [30, 60]}, "humanoids.count": [5, 20]}, "noise": 1}
)


def test_settings_are_drawn_from_their_ranges() -> None:
    """Whole ones stay whole; a world's draw is a function of its seed."""
    world = composed().world.model_dump()
    draws = [RANGES.changes(world, seed) for seed in range(200)]
    charges = [one["robot.charge_below"] for one in draws]
    counts = [one["humanoids.count"] for one in draws]
    assert 30 <= min(charges) < 31
    assert 59 < max(charges) <= 60
    assert set(counts) == set(range(5, 21))
    assert all(isinstance(count, int) for count in counts)
    assert draws == [RANGES.changes(world, seed) for seed in range(200)]
    assert RANGES.in_words() == "robot.charge_below 30 to 60, humanoids.count 5 to 20, noise 1"


def problem(*overrides: str, **perturb: Any) -> Problem:
    """The island with a perturbation, in short episodes."""
    settings = composed(SHORT, *overrides)
    perturbation = Perturbation.model_validate(perturb)
    factory = settings.domain.factory
    task = (settings.world, settings.rewards, settings.curriculum)
    return Problem.of(factory, *task, perturbation, perturbed=True)


def outcomes(island: Problem, seeds: list[int]) -> list[Any]:
    """What the all-rounder achieves."""
    text = to_text(ALL_ROUNDER)
    return Serial(island).evaluate([Job(text, 3, seed) for seed in seeds])


def test_a_range_without_width_is_that_world() -> None:
    """So a perturbed world is the configured one with other settings, in each stage."""
    perturbed = problem(world={"robot": {"speed": [8, 8]}})
    assert outcomes(perturbed, [1, 2]) == outcomes(
        composed(SHORT, "world.robot.speed=8").problem(), [1, 2]
    )


def test_faultless_sensors_change_nothing() -> None:
    """An island whose tree is ticked on a copy of the blackboard gives the same to the bit."""
    plain_island, perturbed = composed(SHORT).problem(), problem(noise=1e-300)
    assert outcomes(perturbed, [3, 4]) == outcomes(plain_island, [3, 4])


def test_outcomes_do_not_depend_on_the_order() -> None:
    """Nor on what ran before: a worker may get any episode."""
    perturbation: dict[str, Any] = {"world": {"robot.speed": [8, 12]}, "noise": 3, "delay": 20}
    forwards = outcomes(problem(**perturbation), [1, 2, 3])
    backwards = outcomes(problem(**perturbation), [3, 2, 1, 3])
    assert backwards == [*forwards[::-1], forwards[2]]
    assert forwards != outcomes(composed(SHORT).problem(), [1, 2, 3])


def test_training() -> None:
    """`perturb.training` decides where a run's episodes are; a report can ask for either."""
    for training in (False, True):
        override = f"perturb={{world: {{robot.speed: [8, 12]}}, training: {training}}}"
        settings = composed(SHORT, override)
        assert (settings.problem().perturbed is not None) is training
        assert settings.problem(perturbed=True).perturbed is not None
        config = plain(SHORT, override)
        assert (Problem.recorded(config).perturbed is not None) is training
        assert Problem.recorded(config, perturbed=True).perturbed is not None
    assert composed().problem(perturbed=True).perturbed is None
    assert Problem.recorded(plain()).perturbed is None


def test_a_world_that_cannot_be_is_reported() -> None:
    """An episode in it ends with the domain's reason, for any ends of the ranges."""
    impossible = problem(world={"obstacles.gap": [60, 60]})
    with pytest.raises(EvaluationError, match=r"world\.obstacles: expected room for"):
        simulate(impossible, Job(to_text(ALL_ROUNDER), 0, 1))


WRONG = [
    ({}, "perturb: expected world, noise or delay, found nothing to perturb; give one"),
    ([], "perturb=[]: input should be a valid dictionary or instance of Perturbation"),
    ({"world": {"charge_below": [30, 60]}}, "perturb.world.charge_below: expected a number among"),
    ({"world": {"robot": 3}}, "perturb.world.robot=3: input should be a valid tuple"),
    ({"world": {"start": [1, 2]}}, "perturb.world.start: expected a number among the world's"),
    (
        {"world": {"robot.speed": [12, 8]}},
        "perturb.world.robot.speed: expected the lower",
    ),
    ({"world": {"robot.speed": [1, inf]}}, "perturb.world.robot.speed.1=inf: input should be a"),
    ({"world": {"robot.speed": [0, 1]}}, "perturb.world: with the least values: robot.speed: "),
    ({"world": {"garbage.initial": [1.5, 3]}}, "perturb.world.garbage.initial: expected whole"),
    ({"world": {"obstacles.gap": [2, 200]}}, "perturb.world: with the greatest values: world.ob"),
    ({"noise": -1}, "perturb.noise=-1: input should be greater than or equal to 0"),
    ({"delay": 21}, "perturb.delay: expected at most 20 ticks, as the domain declares, found 21"),
    ({"nois": 1}, "perturb.nois: unknown key;"),
]


@pytest.mark.parametrize(("perturb", "line"), WRONG)
def test_wrong_perturbations(perturb: Any, line: str) -> None:
    """One line, before anything runs."""
    with pytest.raises(ConfigError) as error:
        read_settings({**plain(), "perturb": perturb})
    assert str(error.value).startswith(line)
    assert "\n" not in str(error.value)


def test_a_domain_that_declares_nothing() -> None:
    """Its worlds may have ranges, and no noise or delay."""
    vocabulary = Vocabulary("quiet", {"Wait": Action("waits")}, {"x": number("", 0, 1)})
    schema = Schema(vocabulary, {"points": ""}, {}, "")
    settings: Settings = composed()
    perturbation = Perturbation(noise=1, delay=1)
    faults = list(perturbation.faults(object, settings.world, settings.rewards, schema))
    assert [line.partition(":")[0] for line in faults] == ["perturb.noise", "perturb.delay"]


@pytest.mark.parametrize(("noise", "message"), [(-1, "noise of at least 0"), (inf, "as noise of")])
def test_wrong_declarations(noise: float, message: str) -> None:
    """Of noise, and of a delay."""
    with pytest.raises(DomainError, match=message):
        Vocabulary("odd", {"Wait": Action("")}, {"x": number("", 0, 1, noise=noise)})
    vocabulary = Vocabulary("odd", {"Wait": Action("")}, {})
    with pytest.raises(DomainError, match="equal to 0 for the delay"):
        Schema(vocabulary, {"points": ""}, {}, "", delay=-1)


def test_cartpole_declares_sensors() -> None:
    """Noise on each of its numbers and a delay; its trees feel both."""
    pytest.importorskip("gymnasium", reason="gymnasium is not installed")
    settings = composed("domain=cartpole", "perturb={noise: 4, delay: 3}")
    schema = settings.make_domain().schema
    assert schema.delay > 0
    assert all(key.noise > 0 for key in schema.vocabulary.keys.values())
    tree = "selector { when turning > 0 { PushRight } PushLeft }\n"
    true, perturbed = (
        Serial(settings.problem(perturbed=each)).evaluate([Job(tree, 0, s) for s in range(4)])
        for each in (False, True)
    )
    assert [o.fitness for o in true] != [o.fitness for o in perturbed]


def test_play_runs_in_perturbed_worlds(tmp_path: Path) -> None:
    """If the configuration has some."""
    file = tmp_path / "a tree.bt"
    file.write_text(to_text(ALL_ROUNDER), encoding="utf-8")
    options = ["--seeds", "2", "--json", "--set", SHORT]
    points = []
    for perturbed in ([], ["--set", "perturb={noise: 3, delay: 20}"]):
        result = CliRunner().invoke(islandgp, ["play", str(file), *options, *perturbed])
        points.append([row["fitness"] for row in json.loads(result.output)])
    assert points[0] != points[1]


def test_the_page_s_commands_run(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Those of docs/domains.md, with short episodes."""
    page = (ROOT / "docs/domains.md").read_text(encoding="utf-8")
    (shell,) = re.findall(r"^```sh perturb\n(.*?)^```", page, re.MULTILINE | re.DOTALL)
    monkeypatch.chdir(tmp_path)
    Path("all_rounder.bt").write_text(to_text(ALL_ROUNDER), encoding="utf-8")
    lines = shell.splitlines()
    assert len(lines) == 2
    for command in map(shlex.split, lines):
        result = CliRunner().invoke(islandgp, [*command[1:], "--seeds", "2", "--set", SHORT])
        assert result.exit_code == 0, result.output
        assert re.search("Perturbed: (robot.charge_below 30 to 60|noise 2)", result.output)
