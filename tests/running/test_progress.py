"""What a person sees while a run goes on."""

from __future__ import annotations

import re
import sys
from io import StringIO

import pytest

from islandgp.running.progress import Progress, columns, duration, fitting, row
from tests.made import CLASSES
from tests.tracking.folders import steps

MILESTONES = CLASSES.milestones


@pytest.mark.parametrize(
    ("seconds", "text"),
    [
        (-1, "0 s"),
        (7.6, "8 s"),
        (59.4, "59 s"),
        (60, "1 min 00 s"),
        (185, "3 min 05 s"),
        (7620, "2 h 07 min"),
        (86399, "23 h 59 min"),
        (273600, "3 d 04 h"),
    ],
)
def test_durations_are_for_people(seconds: float, text: str) -> None:
    """Two units at most."""
    assert duration(seconds) == text


def test_plain_lines_where_there_is_no_terminal(capsys: pytest.CaptureFixture[str]) -> None:
    """A title, a head, and one aligned line a generation, on the error stream."""
    found = steps()
    with Progress("auto", 5, "a title", MILESTONES) as progress:
        for step in found:
            progress.show(step)
    out, err = capsys.readouterr()
    title, head, *lines = err.splitlines()
    assert (out, title) == ("", "a title")
    assert head.split() == list(columns(MILESTONES))
    assert [line.split()[0] for line in lines] == [f"{g}/4" for g in range(5)]
    assert lines[1].split()[1] == f"{found[1].record.snapshot.best:,.0f}"


def test_a_resumed_run_says_where_it_goes_on(capsys: pytest.CaptureFixture[str]) -> None:
    """The title names the generation; the rest of the run is what is still to come."""
    with Progress("plain", 5, "a title", MILESTONES, done=3) as progress:
        progress.show(steps()[3])
    assert "a title (from generation 3)" in capsys.readouterr().err


def test_progress_off_is_silent(capsys: pytest.CaptureFixture[str]) -> None:
    """Nothing on either stream."""
    with Progress("off", 5, "a title", MILESTONES) as progress:
        progress.show(steps()[0])
    assert capsys.readouterr() == ("", "")


def test_a_crisis_is_marked_at_the_rate() -> None:
    """The rate of the next generation, with a "!" when a crisis decided it."""
    step = steps()[1]
    cells = dict(zip(columns(MILESTONES), row(step, 5, 60, MILESTONES), strict=True))
    guidance = step.record.guidance
    assert guidance is not None
    assert cells["rate"] == f"{guidance.applied_rate:.2f}" + ("!" if guidance.crisis else "")
    assert cells["left"] == "1 min 00 s"
    last = row(steps()[-1], 5, 0, MILESTONES)
    assert dict(zip(columns(MILESTONES), last, strict=True))["rate"] == ""


def test_each_milestone_has_a_column() -> None:
    """Those that the configuration names, in its order, before the rate."""
    names = list(columns(("good", "better_than_good")))
    assert names[-4:-2] == ["good", "better_than_good"]


@pytest.mark.parametrize("room", [8, 40, 60, 80, 200])
def test_a_narrow_terminal_has_fewer_columns(room: int) -> None:
    """What is shown fits and keeps its order; what is left out is known; nothing is lost."""
    widths = columns(MILESTONES)
    shown, hidden = fitting(widths, room)
    assert sum(widths[name] + 1 for name in shown) - 1 <= max(room, widths["generation"])
    assert sorted([*shown, *hidden]) == sorted(widths)
    assert shown == [name for name in widths if name in shown]
    assert shown[0] == "generation"
    assert bool(hidden) == (room < 100)


def test_the_live_table_names_the_columns_that_it_leaves_out(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """At 40 columns no cell is cut, and a line says what is not shown."""

    class Terminal(StringIO):
        def isatty(self) -> bool:
            return True

    terminal = Terminal()
    monkeypatch.setattr(sys, "stderr", terminal)
    monkeypatch.setenv("COLUMNS", "40")
    monkeypatch.setenv("TERM", "xterm")
    with Progress("auto", 5, "a title", MILESTONES) as progress:
        for step in steps():
            progress.show(step)
    said = re.sub(r"\x1b\[[0-9;?]*[a-zA-Z]", "", terminal.getvalue())
    said = said.rpartition("a title")[2]
    best = [f"{step.record.snapshot.best:,.0f}" for step in steps()]
    assert all(f" {number} " in said for number in best)
    hidden = fitting(columns(MILESTONES), 40)[1]
    assert f"no room for {', '.join(hidden)}" in " ".join(said.split())
    assert "…" not in said
    assert max(map(len, said.splitlines())) <= 40
