"""`islandgp tune`, as a user runs it."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from islandgp.bt.language import parse
from islandgp.evaluation.base import Job
from islandgp.evaluation.serial import Serial
from tests.trees.shell import Cli

SHORT = ("--set", "world.episode.length=10", "--set", "evaluator=serial")
FEW = ("--worlds", 2, "--trials", 4)
TREE = """# my robot
constant low = 90  # percent

when batteryLevel < low { MoveToGarbage }
"""
BETTER = "selector { repeater 2 { PatrolWaypoint } when batteryLevel < 7.5 { SeekCharger } }\n"


def test_tune(islandgp: Cli, tmp_path: Path) -> None:
    """The tree is printed with names and comments kept, and what was done is told beside it."""
    (tmp_path / "my tree.bt").write_text(BETTER)
    first = islandgp("tune", tmp_path / "my tree.bt", *FEW, *SHORT)
    assert first.code == 0
    assert re.sub(r"[\d.]+", "", first.out) == re.sub(r"[\d.]+", "", BETTER)
    assert "4 trials in 2 worlds: " in first.err
    assert "  line 1: repeater 2 " in first.err
    assert "  line 1: batteryLevel < 7.5 " in first.err
    made = tmp_path / "tuned.bt"
    again = islandgp("tune", "-", *FEW, *SHORT, "-o", made, stdin=BETTER)
    assert again.out == ""
    assert made.read_text() == first.out
    other = islandgp("tune", "-", *FEW, *SHORT, "--seed", 5, stdin=TREE)
    assert other.out.startswith("# my robot\nconstant low = ")
    assert other.out.endswith("  # percent\n\nwhen batteryLevel < low { MoveToGarbage }\n")


def test_what_it_is_worth(islandgp: Cli, monkeypatch: pytest.MonkeyPatch) -> None:
    """Better numbers are told with an interval, from worlds that neither raced nor chose."""
    jobs: list[Job] = []
    evaluate = Serial.evaluate

    def noted(self: Serial, asked: list[Job]) -> object:
        jobs.extend(asked)
        return evaluate(self, asked)

    monkeypatch.setattr(Serial, "evaluate", noted)
    text = "when batteryLevel < 40 { PatrolWaypoint }"  # it stands still
    said = islandgp("tune", "-", "--worlds", 3, "--trials", 12, *SHORT, stdin=text)
    assert said.code == 0
    told = re.search(
        r"In 3 worlds that chose nothing: \S+ points, (\S+) to the tree as it was"
        r" \(95 %: (\S+) to (\S+)\), better in 3\.",
        said.err,
    )
    assert told is not None
    mean, low, high = (float(word.replace(",", "")) for word in told.groups())
    assert low <= mean <= high
    assert mean > 0
    written = parse(text)
    worlds = [job.seed for job in jobs if parse(job.tree) == written]
    assert len(set(worlds)) == 9  # to race, to choose and to tell
    assert len(worlds) >= 9


def test_ctrl_c_keeps_the_best(
    islandgp: Cli, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The tree is written, its worth is told, and the exit code is that of Ctrl-C."""
    evaluate = Serial.evaluate
    calls: list[int] = []

    def stopped(self: Serial, jobs: list[Job]) -> object:
        calls.append(len(jobs))
        if len(calls) == 4:
            raise KeyboardInterrupt
        return evaluate(self, jobs)

    monkeypatch.setattr(Serial, "evaluate", stopped)
    made = tmp_path / "tuned.bt"
    text = "when batteryLevel < 40 { PatrolWaypoint }"
    words = ("--worlds", 2, "--trials", 40, "-o", made)
    said = islandgp("tune", "-", *words, *SHORT, stdin=text)
    assert said.code == 130
    assert "islandgp: stopped" in said.err
    assert made.read_text() != text
    assert "worlds that chose nothing" in said.err


@pytest.mark.parametrize(
    ("text", "code", "message"),
    [
        ("PatrolWaypoint", 0, "<stdin>: there is no number to tune."),
        ("constant a = 3 PatrolWaypoint", 0, "<stdin>: there is no number to tune."),
        ("when batteryLevel < { PatrolWaypoint }", 2, "<stdin>:1:21: unexpected '{'"),
        ("when batteryLvel < 5 { PatrolWaypoint }", 2, "Did you mean batteryLevel?"),
        (
            "selector {" + "repeater 2 { PatrolWaypoint }" * 101 + "}",
            2,
            "expected at most 100 numbers to tune, found 101",
        ),
        ("", 2, "there is no tree in the text"),
    ],
)
def test_what_cannot_be_tuned(islandgp: Cli, text: str, code: int, message: str) -> None:
    """It is told in one message; a tree without numbers comes out as it is."""
    said = islandgp("tune", "-", *FEW, *SHORT, stdin=text)
    assert said.code == code
    assert message in said.err
    assert "Traceback" not in said.err
    assert said.out == (text if code == 0 else "")


def test_without_optuna(islandgp: Cli, monkeypatch: pytest.MonkeyPatch) -> None:
    """The extra that brings it is named."""
    monkeypatch.setattr("islandgp.commands.tune_command.find_spec", lambda _: None)
    said = islandgp("tune", "-", stdin=TREE)
    assert said.code == 2
    assert "pip install 'islandgp[optuna]'" in said.err
