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
class Done:
    """How a command ended."""

    code: int
    said: str  # both streams
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
        made = self.root / f"{self._folders}"
        made.mkdir()
        return made

    def run(
        self,
        home: Path,
        *words: str,
        prefix: Sequence[str] = (),
        env: Mapping[str, str] | None = None,
    ) -> Done:
        """A command that meets a fault, to its end; `prefix` are the words of a wrapper.

        Raises AssertionError where it does not end in time, or leaves a process behind.
        """
        return self.end(start(home, *words, prefix=prefix, env=env))

    def end(self, process: subprocess.Popen[str]) -> Done:
        """The same for one that has been started."""
        began = monotonic()
        try:
            said, _ = process.communicate(timeout=ALLOWED)
        except subprocess.TimeoutExpired:
            os.killpg(process.pid, signal.SIGKILL)
            said, _ = process.communicate()
            raise AssertionError(f"it did not end in {ALLOWED:g} s: {said}") from None
        done = Done(process.returncode, said, monotonic() - began)
        self.cases += 1
        self.slowest = max(self.slowest, done.seconds)
        until(lambda: not group_members(process.pid), "its processes have ended")
        return done

    def expected(self, words: Sequence[str]) -> dict[str, bytes]:
        """The records of a command that nothing disturbs."""
        key = tuple(words)
        if key not in self._expected:
            home = self.folder()
            code, said = communicate(start(home, *words))
            assert code == 0, said
            self._expected[key] = records(home)
        return self._expected[key]

    def assert_same(self, home: Path, words: Sequence[str]) -> None:
        """Asserts that a folder holds the run's records as if nothing had happened."""
        found = records(home)
        assert found.keys() == self.expected(words).keys(), sorted(found)
        assert [n for n, data in found.items() if data != self.expected(words)[n]] == []
        assert [str(f) for f in home.rglob(".*.tmp")] == []

    def assert_finishes(self, home: Path, words: Sequence[str]) -> None:
        """Asserts that the same command, undisturbed now, makes the run what it should be."""
        code, said = communicate(start(home, *words))
        assert code == 0, said
        assert "Traceback" not in said, said
        self.assert_same(home, words)


def start(
    home: Path,
    *words: str,
    prefix: Sequence[str] = (),
    env: Mapping[str, str] | None = None,
) -> subprocess.Popen[str]:
    """`PREFIX python -m islandgp WORDS` in `home`, leader of its own process group."""
    return subprocess.Popen(
        [*prefix, sys.executable, "-m", "islandgp", *words],
        cwd=home,
        env={**os.environ, "PYTHONPATH": str(ROOT), **(env or {})},
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        errors="replace",
        start_new_session=True,
    )


def communicate(process: subprocess.Popen[str]) -> tuple[int, str]:
    """Exit code and words of a command that nothing disturbs."""
    said, _ = process.communicate(timeout=300)
    return process.returncode, said


def records(home: Path) -> dict[str, bytes]:
    """The records of all runs below a folder, by run and file; finished or not.

    Of `summary.json` all but the seconds, which no two runs have in common.
    """
    found = [path for name in RECORDS for path in (home / "runs").rglob(name)]
    named = {f"{path.parent.name}/{path.name}": path.read_bytes() for path in found}
    for path in (home / "runs").rglob("summary.json"):
        summary = json.loads(path.read_bytes())
        del summary["seconds"]
        named[f"{path.parent.name}/{path.name}"] = json.dumps(summary).encode()
    return named


def assert_refused(done: Done, *parts: str) -> None:
    """Asserts exit code 2 and words instead of a traceback, `parts` among them."""
    assert done.code == 2, (done.code, done.said)
    assert "islandgp: " in done.said, done.said
    assert "Traceback" not in done.said, done.said
    assert [part for part in parts if part not in done.said] == [], done.said


def until(happened: Callable[[], bool], what: str, seconds: float = 180) -> None:
    """Waits until it has happened; raises AssertionError where it takes too long."""
    end = monotonic() + seconds
    while not happened():
        assert monotonic() < end, f"not in {seconds:g} s: {what}"
        sleep(0.01)


def under_way(home: Path, process: subprocess.Popen[str], generations: int = 3) -> Path:
    """Waits for a run's first generations; returns its folder."""

    def written() -> bool:
        assert process.poll() is None, process.communicate()[0]
        files = list((home / "runs").rglob("generations.jsonl"))
        return bool(files) and files[0].read_bytes().count(b"\n") >= generations

    until(written, f"{generations} generations written")
    return next((home / "runs").rglob("generations.jsonl")).parent
