"""MiniGrid as a domain outside of the package, used by --config-dir."""

from __future__ import annotations

import json
import re
import shlex
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

pytest.importorskip("minigrid", reason="minigrid is not installed")

from grid_robot import GridRobot
from grid_world import Levels
from islandgp.bt.core.language import parse
from islandgp.config.compose import only_job
from islandgp.config.settings import Settings
from islandgp.errors import ConfigError, IslandError
from islandgp.testing import check_domain
from tests.running.commands import in_process
from tests.trees.shell import Cli

HERE = Path(__file__).parents[1]
BY_HAND = (HERE / "by_hand.bt").read_text(encoding="utf-8")
SMALL = ("gp.population=6", "gp.generations=2", "gp.validation=0", "world.ticks=40")
QUICK = (*SMALL, "tracking=off", "evaluator=serial", "progress=off")


def settings(*overrides: str) -> Settings:
    """The settings of a run in the domain."""
    return only_job(["domain=minigrid", "tracking=off", *overrides], HERE / "conf").settings


@pytest.mark.slow
def test_minigrid_keeps_the_promises_of_a_domain() -> None:
    """A maze with keys, in which a seed chooses one of six levels."""
    make = settings("world.ticks=40").make_domain
    assert check_domain(make, trees=[BY_HAND], random_trees=6).faults == {}


@pytest.mark.slow
def test_the_page_s_commands(tmp_path: Path) -> None:
    """Each command of README.md succeeds; runs are shortened."""
    page = (HERE / "README.md").read_text(encoding="utf-8")
    (block,) = re.findall(r"^```sh\n(.*?)^```", page, re.DOTALL | re.MULTILINE)
    commands = [shlex.split(line) for line in block.splitlines()]
    assert [command[0] for command in commands] == ["pip", "cd", *["islandgp"] * 4]
    run = in_process(HERE)
    for command in commands[2:]:
        place = (f"runs={tmp_path}", *QUICK) if command[1] == "run" else ()
        assert run(*command[1:], *place)
    assert list(tmp_path.rglob("best.bt"))


def test_commands_on_a_tree(islandgp: Cli, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Replay and export, on a tree whose first line names the domain."""
    monkeypatch.chdir(HERE)
    options, quick = ("--config-dir", "conf"), ("--set", "world.ticks=40")
    result = islandgp("play", "by_hand.bt", "--seeds", 2, "--json", *options, *quick)
    assert (result.code, len(json.loads(result.out))) == (0, 2)
    page, file = tmp_path / "page.html", tmp_path / "tree.xml"
    assert islandgp("replay", "by_hand.bt", "-o", page, *options, *quick).code == 0
    assert '"frames":["iVBOR' in page.read_text(encoding="utf-8").replace(" ", "")
    assert islandgp("export", "by_hand.bt", "-o", file, *options).code == 0
    assert "GoToKey" in file.read_text(encoding="utf-8")


class _Silent:
    """A log that nobody reads."""

    def __call__(self, event: str, amount: float = 1.0) -> None: ...


def _in_view(env: Any) -> set[tuple[int, int]]:
    """The cells that MiniGrid itself reports as visible."""
    _, visible = env.gen_obs_grid()
    cells = set()
    for across, ahead in zip(*np.nonzero(visible), strict=True):
        x, y = env.agent_pos + env.dir_vec * (6 - ahead) + env.right_vec * (across - 3)
        if 0 <= x < env.width and 0 <= y < env.height:
            cells.add((int(x), int(y)))
    return cells


@pytest.mark.parametrize("level", ["DoorKey-8x8", "MultiRoom-N6", "KeyCorridorS3R3"])
def test_the_robot_sees_what_minigrid_shows(level: str) -> None:
    """Its own quick field of view is the environment's, on a random walk through doors."""
    robot = GridRobot(Levels(levels=(level,), ticks=200), 3, _Silent())  # type: ignore[arg-type]
    rng, cells = np.random.default_rng(0), _in_view(robot.env)
    for _ in range(120):
        robot.wish = int(rng.choice([0, 1, 2, 2, 2, 3, 4, 5]))
        if robot.step():
            break
        cells |= _in_view(robot.env)
        assert robot.memory.seen == sum(robot.memory.at(x, y) for x, y in cells)


@pytest.mark.parametrize(
    ("name", "level", "solved"),
    [
        ("by_hand", "DoorKey-8x8", 6),
        ("by_hand", "UnlockPickup", 6),
        ("by_hand", "BlockedUnlockPickup", 0),
        ("ball_first", "BlockedUnlockPickup", 6),
    ],
)
def test_trees_by_hand(name: str, level: str, solved: int) -> None:
    """Keys, full hands and blocked doors are within the words of the domain."""
    domain = settings(f"world.levels=[{level}]").make_domain()
    text = (HERE / f"{name}.bt").read_text(encoding="utf-8")
    tree = parse(text, domain.schema.vocabulary)
    assert sum(domain.run_episode(tree, seed, {}).counters["solved"] for seed in range(6)) == solved


def test_two_skills_at_once_do_no_harm() -> None:
    """In a parallel one skill leads another away; both end, and the episode too."""
    domain = settings().make_domain()
    text = "parallel success all failure all { Explore GoToKey GoToDoor PickUp Toggle Drop }"
    tree = parse(text, domain.schema.vocabulary)
    endings = {domain.run_episode(tree, seed, {}).endings for seed in range(12)}
    assert endings <= {("time",), ("solved",)}


def test_a_thing_is_rewarded_once() -> None:
    """Picking a key up again and again earns no more points than once."""
    domain = settings("world.levels=[DoorKey-8x8]").make_domain()
    tree = parse("sequence { GoToKey PickUp Drop }", domain.schema.vocabulary)
    outcome = max(
        (domain.run_episode(tree, seed, {}) for seed in range(8)),
        key=lambda result: result.counters["dropped"],
    )
    assert outcome.counters["dropped"] > 3
    assert outcome.counters["key"] == 1


@pytest.mark.parametrize(
    ("override", "line"),
    [
        ("world.levels=[DoorKey-9x9]", "world.levels: expected levels of"),
        ("world.levels=[Dynamic-Obstacles-6x6]", "world.levels: expected"),
        ("world.levels=[]", "world.levels=[]"),
    ],
)
def test_a_wrong_level_is_one_line(override: str, line: str) -> None:
    """Key, what was expected and found."""
    with pytest.raises(IslandError) as excinfo:
        settings(override)
    assert str(excinfo.value).startswith(line)
    assert "\n" not in str(excinfo.value)


def test_without_minigrid(monkeypatch: pytest.MonkeyPatch) -> None:
    """The message has the remedy."""
    monkeypatch.setattr("grid_world.find_spec", lambda _: None)
    with pytest.raises(ConfigError, match="pip install minigrid"):
        settings("seed=1")


def test_each_stage_has_its_levels() -> None:
    """The curriculum of MiniGrid begins with levels that need two skills."""
    problem = settings().problem()
    levels = [problem.at(stage).world.levels for stage in range(3)]  # type: ignore[attr-defined]
    assert "Unlock" in levels[0]
    assert "LockedRoom" in levels[2]
    assert levels[2] == problem.domain.world.levels  # type: ignore[attr-defined]
    assert replace(problem, stages=()).at(0) is problem.domain
