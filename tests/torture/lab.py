"""Commands under adverse conditions, and what they must leave behind."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from time import monotonic, sleep
from typing import Final

from tests.running.commands import ROOT, TINY, fake, group_members

RECORDS: Final = ("generations.jsonl", "best.bt", "lineage.csv")
BASE: Final = (*TINY, "gp.generations=12", "tracking=off")
QUICK: Final = (*BASE, *fake("Instant"))
SLOW: Final = (*BASE, *fake("Slow", seconds=0.15))
REAL: Final = (*BASE, "world.episode.length=20", "evaluator.policy.workers=2")
"""A run without a simulator, one that takes seconds, and one with two workers."""

ALLOWED: Final = 120.0  # s that any command of a case may take


class Missing(Exception):
    """What this machine lacks for a case."""


@dataclass(frozen=True, slots=True)
class Ending:
    """How a command ended."""

    code: int
    output: str  # both streams
    seconds: float


@dataclass(slots=True)
class Lab:
    """A folder for experiments, and what has been counted in it."""

    root: Path
    cases: int = 0  # commands that met a fault
    slowest: float = 0.0  # s that one of them took
    _folders: int = 0
    _expected: dict[tuple[str, ...], dict[str, bytes]] = field(default_factory=dict)

    def folder(self) -> Path:
        """A new empty folder."""
        self._folders += 1
        new = self.root / f"{self._folders}"
        new.mkdir()
        return new

    def run(
        self,
        home: Path,
        *arguments: str,
        prefix: Sequence[str] = (),
        env: Mapping[str, str] | None = None,
    ) -> Ending:
        """A command that meets a fault, to its end; `prefix` is the command of a wrapper.

        Raises AssertionError where it does not end in time, or leaves a process behind.
        """
        return self.end(start(home, *arguments, prefix=prefix, env=env))

    def end(self, process: subprocess.Popen[str]) -> Ending:
        """The same for one that has been started."""
        began = monotonic()
        try:
            output, _ = process.communicate(timeout=ALLOWED)
        except subprocess.TimeoutExpired:
            os.killpg(process.pid, signal.SIGKILL)
            output, _ = process.communicate()
            raise AssertionError(f"it did not end in {ALLOWED:g} s: {output}") from None
        ending = Ending(process.returncode, output, monotonic() - began)
        self.cases += 1
        self.slowest = max(self.slowest, ending.seconds)
        until(lambda: not group_members(process.pid), "its processes have ended")
        return ending

    def expected(self, arguments: Sequence[str]) -> dict[str, bytes]:
        """The records of a command that nothing disturbs."""
        key = tuple(arguments)
        if key not in self._expected:
            home = self.folder()
            code, output = communicate(start(home, *arguments))
            assert code == 0, output
            self._expected[key] = records(home)
        return self._expected[key]

    def assert_same(self, home: Path, arguments: Sequence[str]) -> None:
        """Asserts that a folder holds the run's records as if nothing had happened."""
        actual = records(home)
        assert actual.keys() == self.expected(arguments).keys(), sorted(actual)
        assert [n for n, data in actual.items() if data != self.expected(arguments)[n]] == []
        assert [str(f) for f in home.rglob(".*.tmp")] == []

    def assert_finishes(self, home: Path, arguments: Sequence[str]) -> None:
        """Asserts that the same command, undisturbed now, makes the run what it should be."""
        code, output = communicate(start(home, *arguments))
        assert code == 0, output
        assert "Traceback" not in output, output
        self.assert_same(home, arguments)


def start(
    home: Path,
    *arguments: str,
    prefix: Sequence[str] = (),
    env: Mapping[str, str] | None = None,
) -> subprocess.Popen[str]:
    """`PREFIX python -m islandgp ARGUMENTS` in `home`, leader of its own process group."""
    return subprocess.Popen(
        [*prefix, sys.executable, "-m", "islandgp", *arguments],
        cwd=home,
        env={**os.environ, "PYTHONPATH": str(ROOT), **(env or {})},
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        errors="replace",
        start_new_session=True,
    )


def communicate(process: subprocess.Popen[str]) -> tuple[int, str]:
    """Exit code and output of a command that nothing disturbs."""
    output, _ = process.communicate(timeout=300)
    return process.returncode, output


def records(home: Path) -> dict[str, bytes]:
    """The records of all runs below a folder, by run and file; finished or not.

    Of `summary.json` all but the seconds, which no two runs have in common.
    """
    files = [path for name in RECORDS for path in (home / "runs").rglob(name)]
    named = {f"{path.parent.name}/{path.name}": path.read_bytes() for path in files}
    for path in (home / "runs").rglob("summary.json"):
        summary = json.loads(path.read_bytes())
        del summary["seconds"]
        named[f"{path.parent.name}/{path.name}"] = json.dumps(summary).encode()
    return named


def assert_refused(ending: Ending, *parts: str) -> None:
    """Asserts exit code 2 and a message instead of a traceback, with `parts` in it."""
    assert ending.code == 2, (ending.code, ending.output)
    assert "islandgp: " in ending.output, ending.output
    assert "Traceback" not in ending.output, ending.output
    assert [part for part in parts if part not in ending.output] == [], ending.output


def until(happened: Callable[[], bool], condition: str, seconds: float = 180) -> None:
    """Waits until it has happened; raises AssertionError where it takes too long."""
    end = monotonic() + seconds
    while not happened():
        assert monotonic() < end, f"not in {seconds:g} s: {condition}"
        sleep(0.01)


def under_way(home: Path, process: subprocess.Popen[str], generations: int = 3) -> Path:
    """Waits for a run's first generations; returns its folder."""

    def has_generations() -> bool:
        assert process.poll() is None, process.communicate()[0]
        files = list((home / "runs").rglob("generations.jsonl"))
        return bool(files) and files[0].read_bytes().count(b"\n") >= generations

    until(has_generations, f"{generations} generations written")
    return next((home / "runs").rglob("generations.jsonl")).parent


def recorded_generations(home: Path) -> int:
    """The number of generations of the run below a folder."""
    return sum(f.read_bytes().count(b"\n") for f in (home / "runs").rglob("generations.jsonl"))
