"""A user's supervisor with a fault: the message names its class and the remedy."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest

from islandgp.records.folder import RunFolder
from islandgp.running.app import main
from tests.profiles import sweep
from tests.running.commands import TINY, fake

WELL = """\
from islandgp.supervision.base import Guidance
from islandgp.supervision.baseline import Baseline

class Mine(Baseline):
    def advise(self, state, rng):
        return Guidance(0.2, None, "mine")
"""

FAULTS = [
    # source of the module, and the start of the error that it raises
    (WELL.replace("def advise(", "def advise"), "SyntaxError"),
    ("import math\nmath.lgamma\nwrong_name\n", "NameError: name 'wrong_name'"),
    (WELL.replace("return Guid", "1 / 0 #"), "ZeroDivisionError: division by zero"),
    (WELL.replace("state, rng", "state"), "TypeError: Mine.advise() takes 2"),
    (WELL + "    @classmethod\n    def make(cls, a, b): return a.nothing\n", "AttributeError"),
    (
        WELL + "    @classmethod\n    def check(cls, *a): raise OSError('no disk')\n",
        "OSError: no disk",
    ),
    (WELL + "    def start(self): return {}['x']\n    spent = close = dict\n", "KeyError: 'x'"),
    (WELL + "    def spent(self): return {}['x']\n    start = close = str\n", "KeyError: 'x'"),
]


@pytest.fixture
def cwd(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A working folder whose modules can be imported."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.syspath_prepend(str(tmp_path))
    monkeypatch.setattr(sys, "dont_write_bytecode", True)
    monkeypatch.delitem(sys.modules, "mysup", raising=False)
    return tmp_path


def command(cwd: Path, source: str, *options: str) -> int:
    """The exit code of a run with a supervisor of that source."""
    (cwd / "mysup.py").write_text(source, encoding="utf-8")
    sys.modules.pop("mysup", None)
    supervisor = ["supervisor=baseline", "supervisor.factory=mysup:Mine"]
    return main([*TINY, "tracking=off", *fake("Instant"), *supervisor, *options])


@sweep(("source", "error"), FAULTS, ids=[error[:14] for _, error in FAULTS], quick=4)
def test_an_error_of_a_custom_class_names_the_class(
    cwd: Path, source: str, error: str, capsys: pytest.CaptureFixture[str]
) -> None:
    """Exit code 2, the traceback into the file, and at the end one line that names the class."""
    assert command(cwd, source) == 2
    output = capsys.readouterr().err
    assert output.count("Traceback") == 1
    assert "mysup.py" in output or "takes 2" in error  # who calls it wrongly is not in the file
    last = output.splitlines()[-1]
    assert last.startswith(f"islandgp: mysup:Mine failed ({error}")
    assert "this is a bug in that class, not in islandgp" in last
    assert "a bug in islandgp" not in output


def test_settings_that_are_no_pydantic_model(cwd: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Reported before anything is called, in one line."""
    assert command(cwd, WELL + "    class Settings:\n        rate = 1\n") == 2
    (line,) = capsys.readouterr().err.splitlines()
    start = "islandgp: supervisor.factory: expected Settings to be a pydantic model, found <class"
    assert line.startswith(start)
    assert "mysup.Mine.Settings" in line


def test_a_class_that_is_no_supervisor(cwd: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """As when `make` has no return."""
    source = WELL + "    @classmethod\n    def make(cls, a, b): pass\n"
    assert command(cwd, source) == 2
    last = capsys.readouterr().err.splitlines()[-1]
    assert "mysup:Mine failed (TypeError: expected make to return a supervisor" in last


@pytest.mark.slow
def test_a_job_of_a_sweep_names_the_class_too(
    cwd: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """The reason is the line, the traceback is in the job's folder; a mended class goes on."""
    source = WELL.replace("return", "if state.now.generation == 2: 1 / 0\n        return")
    assert command(cwd, source, "seed=4", "-m") == 1
    errors = capsys.readouterr().err
    assert "mysup:Mine failed (ZeroDivisionError: division by zero, in " in errors
    assert "Traceback" not in errors
    (error,) = cwd.rglob("error.txt")
    assert "mysup.py" in error.read_text(encoding="utf-8")
    assert RunFolder(error.parent).completed_generations() == 2
    assert command(cwd, WELL, "seed=4", "-m") == 0


def test_a_module_may_replace_a_class(cwd: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Its faults are reported with its name."""
    source = (
        WELL + "Settings = Mine.Settings\nadvise = None.__class__\ndef make(*a): raise OSError\n"
    )
    assert command(cwd, source, "supervisor.factory=mysup") == 2
    assert "islandgp: mysup failed (OSError" in capsys.readouterr().err.splitlines()[-1]


def test_a_supervisor_of_ours_is_not_blamed_on_the_user(
    cwd: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """An error in the package's own code has exit code 1 and is reported as a bug."""
    monkeypatch.setattr("islandgp.supervision.baseline.Guidance", None)
    options = ["supervisor=baseline", "name=ours"]
    assert main([*TINY, "tracking=off", *fake("Instant"), *options]) == 1
    assert "this is a bug in islandgp" in capsys.readouterr().err.splitlines()[-1]
    assert (cwd / "runs" / "ours").exists()
