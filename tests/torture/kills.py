"""The kill matrix: runs of three searches, killed and stopped again and again, and continued."""

from __future__ import annotations

import os
import random
import signal
import subprocess
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import product
from pathlib import Path
from time import sleep
from typing import Final

from tests.running.commands import TINY, workers
from tests.torture.lab import Ending, Lab, communicate, recorded_generations, records, start, until

SEARCHES: Final = ("racing", "paper", "map_elites")
EVALUATORS: Final = {
    "serial": ("evaluator=serial",),
    "processes": ("evaluator=processes", "evaluator.policy.workers=2"),
}
RUN: Final = (*TINY, "gp.generations=60", "world.episode.length=120", "tracking=off")
ROUNDS: Final = 2  # of all blows


@dataclass(frozen=True, slots=True)
class Blow:
    """A signal, and who gets it."""

    number: signal.Signals
    to: str  # "run", "all" its processes, or "worker"

    @property
    def ends(self) -> bool:
        """True if the command ends of it."""
        return self.to != "worker" and self.number is not signal.SIGSTOP

    def strike(self, process: subprocess.Popen[str], rng: random.Random) -> bool:
        """Sends the signal; False if nobody is there to get it."""
        try:
            if self.to == "all":
                os.killpg(process.pid, self.number)
            else:
                os.kill(
                    rng.choice(workers(process)) if self.to == "worker" else process.pid,
                    self.number,
                )
            if self.number is signal.SIGSTOP:
                sleep(0.5)
                os.killpg(process.pid, signal.SIGCONT)
        except (ProcessLookupError, IndexError):
            return False
        return True


BLOWS: Final = (
    Blow(signal.SIGKILL, "run"),
    Blow(signal.SIGKILL, "worker"),
    Blow(signal.SIGTERM, "run"),
    Blow(signal.SIGSTOP, "all"),
    Blow(signal.SIGINT, "all"),
    Blow(signal.SIGTERM, "worker"),
    Blow(signal.SIGHUP, "all"),
    Blow(signal.SIGSTOP, "worker"),
    Blow(signal.SIGTERM, "all"),
    Blow(signal.SIGKILL, "all"),
)


def killed(search: str, evaluator: str, rounds: int = ROUNDS) -> Callable[[Lab], str]:
    """The attempt of a row: one run after the other until all blows are struck."""

    def attempt(lab: Lab) -> str:
        arguments = (*RUN, f"search={search}", *EVALUATORS[evaluator])
        blows = [blow for blow in BLOWS if evaluator == "processes" or blow.to != "worker"] * rounds
        figure = counts(blows)
        rng = random.Random(f"{search} {evaluator}")
        undisturbed, home, temporary = lab.folder(), lab.folder(), lab.folder()
        code, output = communicate(start(undisturbed, *arguments))
        assert code == 0, output
        while blows:
            process = start(home, *arguments, env={"TMPDIR": str(temporary)})
            last = struck(home, process, blows, rng)
            ending = lab.end(process)
            assert_ended(ending, last)
            assert "Traceback" not in ending.output, ending.output
            assert list(temporary.iterdir()) == []
            if last != Blow(signal.SIGKILL, "all"):
                # after SIGKILL, loky's tracker removes them as soon as it gets a core
                until(
                    lambda name=f"-{process.pid}-": shared_memory(name) == [],
                    "no shared memory",
                    20,
                )
            if last is None:
                assert_same(home, undisturbed)
                home = lab.folder()
        code, output = communicate(start(home, *arguments))
        assert code == 0, output
        assert_same(home, undisturbed)
        return figure

    return attempt


def shared_memory(name: str) -> list[str]:
    """The files of shared memory with `name` in theirs."""
    return [f for f in os.listdir("/dev/shm") if name in f]


def counts(blows: Sequence[Blow]) -> str:
    """How many blows of each kind there are, for the table."""
    kinds = Counter(f"{blow.number.name.removeprefix('SIG')} to {blow.to}" for blow in blows)
    return ", ".join(f"{n} {kind}" for kind, n in kinds.items())


def struck(
    home: Path, process: subprocess.Popen[str], blows: list[Blow], rng: random.Random
) -> Blow | None:
    """Strikes a run until it ends of it, and takes the blows from the list.

    Every second one comes at any moment, the others after a generation.

    Returns:
        The blow of which the run ends; None if it ends by itself.
    """
    while blows and process.poll() is None:
        if len(blows) % 2:
            before = recorded_generations(home)
            until(
                lambda n=before: recorded_generations(home) > n or process.poll() is not None,
                "a generation written",
            )
        else:
            sleep(rng.uniform(0.5, 2))
        if blows[0].strike(process, rng):
            blow = blows.pop(0)
            if blow.ends:
                return blow
    return None


def assert_ended(ending: Ending, blow: Blow | None) -> None:
    """Asserts the exit code of a command, which may have been about to end by itself."""
    codes = {None: (0,), signal.SIGKILL: (0, -signal.SIGKILL)}
    assert ending.code in codes.get(blow and blow.number, (0, 130)), ending


def assert_same(home: Path, undisturbed: Path) -> None:
    """Asserts that two folders have the same files, and the same bytes in the records."""
    names = [
        {file.relative_to(folder) for file in folder.rglob("*")} for folder in (home, undisturbed)
    ]
    assert names[0] == names[1]
    assert records(home) == records(undisturbed)


KILLS: Final = {
    f"`search={search}`, `evaluator={evaluator}`": killed(search, evaluator)
    for search, evaluator in product(SEARCHES, EVALUATORS)
}
