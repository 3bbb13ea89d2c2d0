"""What a person sees while a run goes on."""

from __future__ import annotations

from pathlib import Path

import pytest

from islandgp.resources import program
from islandgp.running.report import Progress, duration
from tests.samples import CLASSES
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


COLUMNS = ["generation", "best", "mean", "diversity", "working", *MILESTONES]


def of_five(generation: int, _: int) -> int:
    """The generations that follow one of a run of five."""
    return 4 - generation


def test_the_total_is_what_a_library_leaves(capsys: pytest.CaptureFixture[str]) -> None:
    """The search for a library takes episodes of the budget, so fewer generations follow."""
    Progress("plain", lambda g, spent: 4 - g - (spent > 0), "title", MILESTONES).show(steps()[0])
    assert capsys.readouterr().err.splitlines()[-1].split()[0] == "0/3"


def test_a_line_a_generation(capsys: pytest.CaptureFixture[str]) -> None:
    """A title, a head, and one aligned line a generation, on the error stream.

    The mutation rate of the next generation has a "!" when a crisis decided it; the last
    generation has none, and no time left.
    """
    all_steps = steps()
    progress = Progress("plain", of_five, "a title", MILESTONES)
    for step in all_steps:
        progress.show(step)
    out, err = capsys.readouterr()
    title, head, *lines = err.splitlines()
    assert (out, title) == ("", "a title")
    assert head.split() == [*COLUMNS, "mutation", "time", "left"]
    assert [line.split()[0] for line in lines] == [f"{g}/4" for g in range(5)]
    assert lines[1].split()[1] == f"{all_steps[1].record.snapshot.fitness_max:,.0f}"
    guidance = all_steps[1].record.guidance
    assert guidance is not None
    rate = f"{guidance.applied_rate:.2f}" + "!" * bool(guidance.crisis)
    assert lines[1].split()[len(COLUMNS)] == rate
    assert len(lines[-1].split()) == len(COLUMNS)


@pytest.mark.parametrize("names", [("good", "better_than_good"), ("working", "best")])
def test_each_milestone_has_a_column(
    names: tuple[str, ...], capsys: pytest.CaptureFixture[str]
) -> None:
    """In their order, also if it is called as another column; no rate if the search has none."""
    Progress("plain", of_five, "a title", names, rate=False)
    head = capsys.readouterr().err.splitlines()[1].split()
    assert head == [*COLUMNS[:5], *names, "time", "left"]


def test_a_resumed_run_shows_where_it_continues(capsys: pytest.CaptureFixture[str]) -> None:
    """The title names the generation; the rest of the run is what is still to come."""
    Progress("plain", of_five, "a title", MILESTONES, done=3).show(steps()[3])
    assert "a title (from generation 3)" in capsys.readouterr().err


def test_progress_off_is_silent(capsys: pytest.CaptureFixture[str]) -> None:
    """Nothing on either stream."""
    Progress("off", of_five, "a title", MILESTONES).show(steps()[0])
    assert capsys.readouterr() == ("", "")


def test_hints_name_a_command_that_can_be_given(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """By its path where it is not on PATH, as after `make run`."""
    script = tmp_path / ".venv/bin/islandgp"
    script.parent.mkdir(parents=True)
    script.touch(mode=0o755)
    monkeypatch.setattr("sys.executable", str(script.parent / "python"))
    monkeypatch.setenv("PATH", str(tmp_path))
    monkeypatch.chdir(tmp_path)
    assert program() == ".venv/bin/islandgp"
    (tmp_path / "other").mkdir()
    monkeypatch.chdir(tmp_path / "other")
    assert program() == str(script)
    monkeypatch.setenv("PATH", str(script.parent))
    assert program() == "islandgp"
