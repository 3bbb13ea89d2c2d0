"""A small part of `make torture`, and the page that holds its results."""

from __future__ import annotations

import errno
import json
import os
import signal
import sys
from pathlib import Path

import pytest

from islandgp.running.console import as_ctrl_c, shortage
from tests.torture import __main__ as torture
from tests.torture import page
from tests.torture.__main__ import PARTS, main, rows
from tests.torture.disks import limited
from tests.torture.kills import EVALUATORS, SEARCHES, killed
from tests.torture.lab import QUICK, Lab, Missing, assert_refused, records


def test_the_page_holds_the_results() -> None:
    """docs/reliability.md shows tests/torture/results.json; `make torture` writes both."""
    text = page.PAGE.read_text(encoding="utf-8")
    results = page.results()
    assert page.with_tables(text, results) == text
    assert {(row["part"], row["name"]) for row in results} <= set(rows())
    assert [row["name"] for row in results if row["failure"]] == []
    for part in PARTS:
        assert f"<!-- begin {part} -->" in text


def test_a_broken_promise_is_marked_in_the_page() -> None:
    """A row that failed, or that could not be tried, is marked."""
    row = {**page.results()[0], "failure": "AssertionError: lost"}
    assert "**broken**" in page.faults([row])
    assert "not tried: no disk" in page.faults([{**row, "failure": "", "missing": "no disk"}])


def test_a_row_that_could_not_be_tried_did_not_hold(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """It is counted by itself, and the exit code is 3; a broken promise comes first."""

    def lacking(_: Lab) -> None:
        raise Missing("no disk")

    def broken(_: Lab) -> None:
        raise AssertionError("lost")

    monkeypatch.setattr(torture, "save", lambda _: None)
    monkeypatch.setattr(torture, "write_page", lambda: None)
    monkeypatch.setattr(torture, "with_own_mounts", lambda: None)
    monkeypatch.setattr(torture.signal, "signal", lambda *_: None)
    rows = {"a": lambda _: None, "b": lacking, "c": broken}
    for names, code, line in (
        ("a", 0, "1 of 1 rows held"),
        ("ab", 3, "1 of 2 rows held, 1 not tried"),
        ("abc", 1, "1 of 3 rows held, 1 broken, 1 not tried"),
    ):
        monkeypatch.setitem(PARTS, "faults", {name: rows[name] for name in names})
        assert main(["faults"]) == code
        assert capsys.readouterr().out.splitlines()[-1] == line


def test_a_summary_is_compared_without_its_seconds(tmp_path: Path) -> None:
    """Another best robot is a difference; another duration is none."""
    file = tmp_path / "runs/a/one/summary.json"
    file.parent.mkdir(parents=True)

    def of(**summary: object) -> dict[str, bytes]:
        file.write_text(json.dumps(summary), encoding="utf-8")
        return records(tmp_path)

    assert of(best=1, seconds=2.0) == of(best=1, seconds=3.0) != of(best=2, seconds=2.0)


def test_an_unknown_part(capsys: pytest.CaptureFixture[str]) -> None:
    """Exit code 2, and the parts there are."""
    with pytest.raises(SystemExit) as stopped:
        main(["fault"])
    assert stopped.value.code == 2
    assert "there is no part fault; there are faults, " in capsys.readouterr().err


@pytest.mark.slow
@pytest.mark.skipif(sys.platform != "linux", reason="looks into /proc and /dev/shm")
@pytest.mark.parametrize("evaluator", EVALUATORS)
@pytest.mark.parametrize("search", SEARCHES)
def test_killed_and_stopped_runs_end_the_same(search: str, evaluator: str, tmp_path: Path) -> None:
    """Each signal of the kill matrix once: the same bytes, and nothing is left."""
    killed(search, evaluator, rounds=1)(Lab(tmp_path))


@pytest.mark.slow
@pytest.mark.skipif(sys.platform != "linux", reason="needs a limit of bash's and /proc")
def test_files_that_may_not_grow(tmp_path: Path) -> None:
    """Exit code 2 and a message; with room, the same command makes the same records."""
    lab = Lab(tmp_path)
    home = lab.folder()
    ending = lab.run(home, *QUICK, prefix=limited("ulimit -f 16"))
    assert_refused(ending, "File too large", "repeat the command")
    lab.assert_finishes(home, QUICK)


@pytest.mark.parametrize(
    "error",
    [
        MemoryError(),
        RuntimeError("can't start new thread"),
        OSError(errno.EMFILE, "Too many open files"),
        ImportError("lib.so: failed to map segment from shared object"),
    ],
)
def test_a_lack_of_the_system_has_a_message(error: Exception) -> None:
    """Also where another error came of it."""
    later = ValueError("something else")
    later.__cause__ = error
    for exception in (error, later):
        assert shortage(exception).startswith("Expected enough memory, processes and open files")
        assert f"found: {str(error) or 'no more memory'};" in shortage(exception)
    assert shortage(FileNotFoundError(errno.ENOENT, "gone")) == ""


@pytest.mark.skipif(os.name != "posix", reason="needs SIGTERM")
def test_an_error_that_a_signal_led_to_counts_as_ctrl_c() -> None:
    """Interrupted libraries raise their own errors; one without a signal stays."""

    def interrupted() -> None:
        try:
            os.kill(os.getpid(), signal.SIGTERM)
            signal.pause()
        except KeyboardInterrupt:
            raise AttributeError("half of an object") from None

    with pytest.raises(KeyboardInterrupt), as_ctrl_c("SIGTERM"):
        interrupted()
    with pytest.raises(AttributeError), as_ctrl_c("SIGTERM"):
        raise AttributeError("no signal")
