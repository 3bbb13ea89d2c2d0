"""What a person sees while a run goes on."""

from __future__ import annotations

from pathlib import Path

import pytest

from islandgp.records.folder import RunFolder
from islandgp.resources import program
from islandgp.running.progress import Progress, columns, duration, row
from islandgp.sweep.folder import SweepJob
from islandgp.sweep.progress import SweepStart, sweep_line
from tests.samples import CLASSES
from tests.tracking.folders import steps

MILESTONES = CLASSES.milestones


def test_a_tier_may_have_a_columns_name() -> None:
    """Tiers called `working` or `best` have columns of their own beside those of all runs."""
    assert len(columns(("working", "best"))) == len(columns(())) + 2


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


def test_a_line_a_generation(capsys: pytest.CaptureFixture[str]) -> None:
    """A title, a head, and one aligned line a generation, on the error stream."""
    all_steps = steps()
    progress = Progress("plain", 5, "a title", MILESTONES)
    progress.begin()
    for step in all_steps:
        progress.show(step)
    out, err = capsys.readouterr()
    title, head, *lines = err.splitlines()
    assert (out, title) == ("", "a title")
    assert head.split() == " ".join(columns(MILESTONES)).split()
    assert [line.split()[0] for line in lines] == [f"{g}/4" for g in range(5)]
    assert lines[1].split()[1] == f"{all_steps[1].record.snapshot.fitness_max:,.0f}"


def test_a_resumed_run_shows_where_it_continues(capsys: pytest.CaptureFixture[str]) -> None:
    """The title names the generation; the rest of the run is what is still to come."""
    progress = Progress("plain", 5, "a title", MILESTONES, done=3)
    progress.begin()
    progress.show(steps()[3])
    assert "a title (from generation 3)" in capsys.readouterr().err


def test_progress_off_is_silent(capsys: pytest.CaptureFixture[str]) -> None:
    """Nothing on either stream."""
    progress = Progress("off", 5, "a title", MILESTONES)
    progress.begin()
    progress.show(steps()[0])
    assert capsys.readouterr() == ("", "")


def test_a_crisis_is_marked_at_the_rate() -> None:
    """The rate of the next generation, with a "!" when a crisis decided it."""
    step = steps()[1]
    cells = dict(zip(columns(MILESTONES), row(step, 5, 60, MILESTONES), strict=True))
    guidance = step.record.guidance
    assert guidance is not None
    assert cells["mutation"] == f"{guidance.applied_rate:.2f}" + ("!" if guidance.crisis else "")
    assert cells["time left"] == "1 min 00 s"
    last = row(steps()[-1], 5, 0, MILESTONES)
    assert dict(zip(columns(MILESTONES), last, strict=True))["mutation"] == ""


def test_each_milestone_has_a_column() -> None:
    """Those that the configuration names, in its order, before the rate."""
    names = list(columns(("good", "better_than_good")))
    assert names[-4:-2] == ["good", "better_than_good"]


def test_the_rate_has_a_column_only_if_the_search_uses_it() -> None:
    """Without it the other columns and cells are the same."""
    names = list(columns(MILESTONES, rate=False))
    assert names == [name for name in columns(MILESTONES) if name != "mutation"]
    assert len(row(steps()[1], 5, 60, MILESTONES, rate=False)) == len(names)


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


def test_a_job_that_begins_counts_as_running(tmp_path: Path) -> None:
    """The line before it counts it, though it has not taken its folder yet."""
    runs = [RunFolder(tmp_path / name) for name in ("one", "two")]
    jobs = {run.path: SweepJob(run.path.name, run.path.name, "b", 1, (), 5, "") for run in runs}
    assert "0 of 2 done, 1 running, 0 failed" in sweep_line(SweepStart.now(jobs), runs[0])
