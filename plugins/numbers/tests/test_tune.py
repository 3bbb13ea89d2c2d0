"""`islandgp tune`, as a user runs it."""

from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import Path
from typing import ClassVar

import pytest

from islandgp.domain import Outcome
from islandgp.evaluation.base import Job
from islandgp.evaluation.serial import Serial
from tests.samples import outcome
from tests.trees.shell import Cli

SHORT = ("--set", "world.episode.length=10", "--set", "evaluator=serial")
FEW = ("--worlds", 2, "--episodes", 60)  # two generations
TREE = """# my robot
constant low = 90.0  # percent

selector { repeater 02 { when batteryLevel < low { MoveToGarbage } } PatrolWaypoint }
"""
NEAR = "when batteryLevel < 60 { PatrolWaypoint }"


class Awake(Serial):
    """Points are highest at one threshold of the battery, in any world; no simulator is needed."""

    jobs: ClassVar[list[Job]] = []
    ends: ClassVar[int] = 10**9  # jobs that are run before Ctrl-C

    def evaluate(self, jobs: Sequence[Job]) -> list[Outcome]:
        """See `Evaluator`."""
        self.jobs.extend(jobs)
        if len(self.jobs) > self.ends:
            raise KeyboardInterrupt
        return [outcome(job.seed % 100 - abs(threshold(job.tree) - 63.4)) for job in jobs]


def threshold(tree: str) -> float:
    """Of its only condition."""
    match = re.search(r"batteryLevel < ([\d.]+)", tree)
    assert match is not None
    return float(match[1])


@pytest.fixture
def awake(monkeypatch: pytest.MonkeyPatch) -> type[Awake]:
    """The evaluator of commands, without its jobs."""
    monkeypatch.setattr(Awake, "jobs", [])
    monkeypatch.setattr(Serial, "evaluate", Awake.evaluate)
    monkeypatch.setattr(Serial, "jobs", Awake.jobs, raising=False)
    monkeypatch.setattr(Serial, "ends", 10**9, raising=False)
    return Awake


def test_tune(islandgp: Cli, tmp_path: Path, awake: type[Awake]) -> None:
    """One number changes, all else stays to the letter; before, after and cost are reported."""
    file, tuned = tmp_path / "my tree.bt", tmp_path / "tuned.bt"
    file.write_text(TREE)
    first = islandgp("tune", file, "--worlds", 4, "--episodes", 1_200, *SHORT)
    assert first.code == 0
    value = re.findall(r"low = ([\d.]+)", first.out)[0]
    assert abs(float(value) - 63.4) < 1
    assert first.out == TREE.replace("90.0", value)
    assert f"  line 2: low = 90 becomes {value}\n" in first.err
    assert "Numbers to tune: 1, in at most 1,200 episodes: 20 generations of 12 trees" in first.err
    numbers = r"[-+\d.,]+ points \(95 %: [-+\d.,]+ to [-+\d.,]+\)"
    for line in (f"before: {numbers}", f"after: {numbers}", f"difference: {numbers}, better in 60"):
        assert re.search(line, first.err)
    cost = re.search(
        r"Cost: ([\d,]+) episodes \(([\d,]+) search, (\d+) race, 120 comparison\), [\d.]+ s",
        first.err,
    )
    assert cost is not None
    total, search, race = (int(word.replace(",", "")) for word in cost.groups())
    assert total == len(awake.jobs) == search + race + 120 <= 1_200

    second = islandgp("tune", file, "--worlds", 4, "--episodes", 1_200, *SHORT, "-o", tuned)
    assert (second.out, tuned.read_text()) == ("", first.out)


def test_the_file_itself_is_tuned(islandgp: Cli, tmp_path: Path, awake: type[Awake]) -> None:  # noqa: ARG001 -- the fixture is what it does
    """`-o` may name the file that is read."""
    file = tmp_path / "a.bt"
    file.write_text(TREE)
    assert islandgp("tune", file, "-o", file, "--episodes", 1_200, *SHORT).code == 0
    assert file.read_text() != TREE
    assert re.sub(r"low = [\d.]+", "low = 90.0", file.read_text()) == TREE


@pytest.mark.slow
def test_in_the_simulator(islandgp: Cli) -> None:
    """The bytes do not depend on the number of workers."""
    options = ("--episodes", 400, "--worlds", 4, "--set", "world.episode.length=10")
    one = islandgp("tune", "-", *options, "--set", "evaluator=serial", stdin=NEAR)
    two = islandgp("tune", "-", *options, "--set", "evaluator.policy.workers=2", stdin=NEAR)
    assert one.code == two.code == 0
    assert one.out == two.out
    assert one.out != NEAR  # the battery has more when it starts
    assert one.err.rpartition(",")[0] == two.err.rpartition(",")[0]  # but for the seconds


def test_a_tree_without_a_better_one_stays_as_it_is(islandgp: Cli, awake: type[Awake]) -> None:  # noqa: ARG001 -- the fixture is what it does
    """The text comes out as it was, to the byte."""
    text = "when  batteryLevel<63.40 { MoveToGarbage }\r\n"
    result = islandgp("tune", "-", "--episodes", 400, *SHORT, stdin=text)
    assert (result.code, result.out) == (0, text)
    assert "line 1: batteryLevel < 63.4 stays" in result.err
    assert "Nothing better was found" in result.err


def test_ctrl_c_writes_nothing(
    islandgp: Cli, tmp_path: Path, awake: type[Awake], monkeypatch: pytest.MonkeyPatch
) -> None:
    """In the search, the race or the comparison: the file stays, the exit code is 130."""
    file = tmp_path / "a.bt"
    file.write_text(TREE)
    arguments = ("tune", file, "--worlds", 4, "--episodes", 600, *SHORT)
    assert islandgp(*arguments).code == 0
    episodes = len(awake.jobs)  # 60 of them compare
    for ends in (10, episodes - 61, episodes - 1):
        awake.jobs.clear()
        monkeypatch.setattr(Serial, "ends", ends)
        result = islandgp(*arguments, "-o", file)
        assert (result.code, result.out) == (130, "")
        assert "islandgp: stopped" in result.err
        assert len(awake.jobs) > ends
        assert (list(tmp_path.iterdir()), file.read_text()) == ([file], TREE)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (("--episodes", 59), "Expected at least 60 episodes: a generation is 12 trees in 4"),
        (("--episodes", 31, "--worlds", 2), "Expected at least 32 episodes"),
        (("--worlds", 1), "1 is not in the range"),
        (("--stage", 99), "--stage: expected 1 to "),
    ],
)
def test_budgets_that_are_too_small(
    islandgp: Cli, tmp_path: Path, options: tuple[object, ...], message: str
) -> None:
    """One error, before any episode, and no file."""
    result = islandgp("tune", "-", *options, "-o", tmp_path / "new.bt", stdin=TREE)
    assert (result.code, result.out) == (2, "")
    assert message in result.err
    assert "Traceback" not in result.err
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("constant a = 3 PatrolWaypoint", "<stdin>: expected 1 to 100 numbers to tune"),
        ("when batteryLevel == 3 { PatrolWaypoint }", "<stdin>: expected 1 to 100 numbers to tune"),
        ("when batteryLevel < { PatrolWaypoint }", "<stdin>:1:21: unexpected '{'"),
        ("when batteryLvel < 5 { PatrolWaypoint }", "Did you mean batteryLevel?"),
        ("selector {" + "when batteryLevel < 2 { PatrolWaypoint }" * 101 + "}", "found 101; give"),
        ("", "the text is empty"),
    ],
)
def test_what_cannot_be_tuned(islandgp: Cli, text: str, message: str) -> None:
    """One message, and no tree."""
    result = islandgp("tune", "-", *FEW, *SHORT, stdin=text)
    assert (result.code, result.out) == (2, "")
    assert message in result.err
    assert "Traceback" not in result.err
