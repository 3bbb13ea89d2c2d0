"""`islandgp prune` and `islandgp explain`, as a user runs them."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from islandgp.bt.core.language import parse
from islandgp.bt.core.node import size
from islandgp.evolution.prune import LEAST_EPISODES
from tests.trees.shell import Cli

SHORT = ("--set", "world.episode.length=60", "--set", "evaluator=serial")
LONG = """domain island

# my robot
selector {
  when lap == 2 { sequence { SeekCharger PatrolWaypoint SeekCharger } }
  when foundGarbage { sequence { MoveToGarbage PickupGarbage } }
  PatrolWaypoint
}
"""


@pytest.fixture
def tree(tmp_path: Path) -> Path:
    """A file with a branch that never runs."""
    path = tmp_path / "my tree.bt"
    path.write_text(LONG)
    return path


def test_prune_prints_the_shorter_tree_and_what_went(islandgp: Cli, tree: Path) -> None:
    """The tree goes to the standard output, the report to the standard error."""
    result = islandgp("prune", tree, "--episodes", 200, *SHORT)
    assert result.code == 0, result.err
    assert result.out.startswith("domain island\n\nselector {")
    assert size(parse(result.out)) <= 6
    assert "without `when lap == 2` (5 nodes)" in result.err
    assert f"Nodes: 11 before, {size(parse(result.out))} after" in result.err
    assert islandgp("prune", tree, "--episodes", 200, *SHORT) == result


def test_prune_writes_a_file(islandgp: Cli, tree: Path, tmp_path: Path) -> None:
    """With -o the tree is written; the file that is read is never overwritten."""
    target = tmp_path / "short.bt"
    assert islandgp("prune", tree, "--episodes", 200, "-o", target, *SHORT).code == 0
    assert size(parse(target.read_text())) <= 6
    assert islandgp("prune", tree, "-o", tree, *SHORT).code == 2
    assert tree.read_text() == LONG


@pytest.mark.parametrize(
    ("arguments", "expected"),
    [
        (("--episodes", 5), f"5 is not in the range {LEAST_EPISODES}<=x"),
        (("--stage", 9), "--stage: expected 1 to"),
        (("--set", "prune.tolerance=2"), "prune.tolerance"),
        (("--set", "prune.worlds=1"), "prune.worlds"),
    ],
)
def test_prune_rejects_bad_values(
    islandgp: Cli, tree: Path, arguments: tuple[object, ...], expected: str
) -> None:
    """One message, exit code 2, nothing on the standard output."""
    result = islandgp("prune", tree, *arguments)
    assert (result.code, result.out) == (2, "")
    assert expected in result.err
    assert "Traceback" not in result.err


def test_a_tree_without_shorter_forms_stays(islandgp: Cli, tmp_path: Path) -> None:
    """A single action is printed as it is."""
    text = "PatrolWaypoint\n"
    path = tmp_path / "small.bt"
    path.write_text(text)
    result = islandgp("prune", path, "--episodes", 200, *SHORT)
    assert (result.code, result.out) == (0, text)


def test_a_world_without_points_leaves_the_tree(islandgp: Cli, tree: Path) -> None:
    """Where a tree earns 0, one line says that there is nothing to compare."""
    text = "sequence {\n  when lap == 2 { PatrolWaypoint }\n  SeekCharger\n}\n"
    tree.write_text(text)
    nothing = ("--set", "rewards.events.leftover.per_unit=0", "--set", "rewards.events.idle.base=0")
    result = islandgp("prune", tree, "--episodes", 200, *SHORT, *nothing)
    assert (result.code, parse(result.out)) == (0, parse(text))
    assert result.err == "The tree earns 0 points in every world, so there is nothing to compare.\n"


def test_explain_draws_the_tree(islandgp: Cli, tree: Path) -> None:
    """A line per node, with its share of worlds, its points and its loss."""
    result = islandgp("explain", tree, "--worlds", 3, *SHORT)
    assert result.code == 0, result.err
    assert len(result.out.splitlines()) == 11
    assert "lap == 2" in result.out
    assert "never runs" in result.out.splitlines()[1]
    assert "without it -" in result.out


def test_explain_as_text_and_json(islandgp: Cli, tree: Path) -> None:
    """The tree with comments is a tree again; JSON has a row for each node."""
    text = islandgp("explain", tree, "--worlds", 2, "--text", *SHORT).out
    assert size(parse(text)) == 11
    assert "# never runs" in text
    rows = json.loads(islandgp("explain", tree, "--worlds", 1, "--json", *SHORT).out)
    assert len(rows) == 11
    assert rows[2] | {"loss": None} == {
        "worlds": 0, "ticks": 0, "successes": 0, "failures": 0, "aborts": 0, "points": 0,
        "loss": None,
    }  # fmt: skip
    assert rows[1]["loss"]["low"] is None  # one world has no interval


def test_the_fewest_episodes_are_enough_for_a_search(islandgp: Cli, tree: Path) -> None:
    """With fewer, every tree would stay as it is."""
    result = islandgp("prune", tree, "--episodes", LEAST_EPISODES, *SHORT)
    assert result.code == 0
    assert "; 0 episodes" not in result.err
