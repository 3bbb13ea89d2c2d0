"""Commands of the documentation in this process or another, and what they leave behind."""

from __future__ import annotations

import os
import shlex
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from contextlib import redirect_stdout
from io import StringIO
from pathlib import Path

import pytest

from islandgp.cli import main

ROOT = Path(__file__).resolve().parents[2]
Command = Callable[..., str]
"""Runs `islandgp` with these arguments, which must succeed; returns what it printed."""

TINY = ("supervisor=baseline", "gp.population=8", "gp.generations=6", "progress=plain")


def fake(kind: str, **policy: object) -> list[str]:
    """Overrides that choose an evaluator of `tests.running.evaluators`."""
    return [
        "evaluator=serial",
        f"evaluator.factory=tests.running.evaluators:{kind}",
        *(f"+evaluator.policy.{key}={value}" for key, value in policy.items()),
    ]


def in_process(cwd: Path) -> Command:
    """Runs `islandgp` in this process, in the folder `cwd`; returns what it printed."""

    def command(*arguments: str) -> str:
        before = set(sys.modules)
        with pytest.MonkeyPatch.context() as patch, redirect_stdout(StringIO()) as out:
            patch.chdir(cwd)
            patch.setattr(sys, "argv", ["islandgp", *arguments])
            patch.setattr(sys, "path", sys.path.copy())
            code: object = 0
            try:
                main()
            except SystemExit as stop:
                code = stop.code
        assert not code, f"{shlex.join(arguments)}\n{out.getvalue()}"
        for name in set(sys.modules) - before:
            if str(getattr(sys.modules[name], "__file__", "")).startswith(str(cwd)):
                del sys.modules[name]
        return out.getvalue()

    return command


def start(cwd: Path, *arguments: str) -> subprocess.Popen[str]:
    """`python -m islandgp ARGUMENTS` in `cwd`, leader of its own process group."""
    return subprocess.Popen(
        [sys.executable, "-m", "islandgp", *arguments],
        cwd=cwd,
        env={**os.environ, "PYTHONPATH": str(ROOT)},
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        start_new_session=True,
    )


def finish(process: subprocess.Popen[str], seconds: float = 120) -> tuple[int, str]:
    """Its exit code and everything it printed."""
    try:
        output, _ = process.communicate(timeout=seconds)
    except subprocess.TimeoutExpired:
        kill_group(process)
        raise
    return process.returncode, output


def kill_group(process: subprocess.Popen[str]) -> None:
    """`kill -9` of the whole process group."""
    os.killpg(process.pid, signal.SIGKILL)
    process.communicate()


def wait_until(happened: Callable[[], bool], process: subprocess.Popen[str]) -> None:
    """Looks until it has happened, or the process has ended."""
    end = time.monotonic() + 60
    while not happened() and process.poll() is None:
        assert time.monotonic() < end, "nothing happened in 60 s"
        time.sleep(0.01)


def lines(file: Path) -> int:
    """How many lines a file has, 0 when it is not there."""
    return file.read_bytes().count(b"\n") if file.exists() else 0


def group_members(group: int) -> list[str]:
    """The command lines of the processes of a group that still run (Linux)."""
    return [line for _, line in processes(group).values()]


def processes(group: int) -> dict[int, tuple[int, str]]:
    """The processes of a group that still run: parent and command line by number (Linux)."""
    running = {}
    for stat in Path("/proc").glob("[0-9]*/stat"):
        try:
            fields = stat.read_text().rpartition(")")[2].split()
            line = (stat.parent / "cmdline").read_text().replace("\0", " ")
        except OSError:
            continue  # it ended while we looked
        # Without a command line it is on its way out: its memory is gone already.
        if int(fields[2]) == group and fields[0] not in "ZX" and line:
            running[int(stat.parent.name)] = int(fields[1]), line
    return running


def workers(run: subprocess.Popen[str]) -> list[int]:
    """The processes in which a run's episodes run."""
    return sorted(n for n, (_, line) in processes(run.pid).items() if "popen_loky" in line)
