"""Where an episode's time goes, by part: a sampling profile, which slows nothing down.

Now and then the processor's own clock interrupts, and the part that is at work
is noted. With n samples a share of p percent is good to about 100 / sqrt(n)
percentage points.
"""

from __future__ import annotations

import signal
from collections import Counter
from collections.abc import Iterator
from contextlib import contextmanager
from itertools import islice
from types import FrameType
from typing import Final

from benchmarks.figure import Effort, Figure, Missing
from benchmarks.pinned import SEED, example, points, settings
from islandgp.bt.core.node import Node
from islandgp.domains.island.episode import run_episode
from islandgp.search.paper import first_population
from islandgp.seeding import Streams

EVERY: Final = 0.001  # s of processor time; the system may round it up
ROUNDS: Final = {Effort.TINY: 1, Effort.QUICK: 1, Effort.FULL: 4}
BATCH: Final = {Effort.TINY: 10, Effort.QUICK: 30, Effort.FULL: 30}  # episodes a round

PARTS: Final[dict[str, tuple[str, tuple[str, ...]]]] = {
    # name: what it is, and what "path:function" in it holds
    "motion": (
        "compiled functions between two ticks: motion, sensing, the schedule",
        ("island/episode.py:run_episode",),
    ),
    "tree": (
        "the tree and its actions",
        ("islandgp/bt/", "island/vocabulary.py", "island/state.py:perform"),
    ),
    "account": (
        "the account of events",
        ("island/state.py:count_events", "island/events.py", "islandgp/scoring/"),
    ),
    "rest": ("building the island, all else", ("",)),
}


def measure(effort: Effort) -> list[Figure]:
    """The all-rounder, and the random trees of a run's first generation."""
    if not hasattr(signal, "setitimer"):
        raise Missing("this system has no timer of processor time")
    count = BATCH[effort]
    plan = settings("search=paper").plan(settings().make_domain())
    population = islice(first_population(plan, Streams(SEED)), count)
    figures = _shares("all_rounder", [example("all_rounder")] * count, ROUNDS[effort])
    return figures + _shares("random", [i.tree for i in population], 2 * ROUNDS[effort])


def _shares(kind: str, trees: list[Node], rounds: int) -> list[Figure]:
    world, award, counts = settings().world, points(), Counter[str]()
    with _sampling(counts):
        for _ in range(rounds):
            for seed, tree in enumerate(trees):
                run_episode(tree, world, seed % 5, award)
    whose = "all-rounder" if kind == "all_rounder" else "random trees"
    samples = sum(counts.values())
    return [
        Figure(f"{kind}_{part}", 100 * counts[part] / max(1, samples), "%", f"{whose}: {meaning}")
        for part, (meaning, _) in PARTS.items()
    ] + [Figure(f"{kind}_samples", samples, "", f"{whose}: samples behind these shares")]


@contextmanager
def _sampling(counts: Counter[str]) -> Iterator[None]:
    """Counts the parts that are seen at work."""

    def look(number: int, frame: FrameType | None) -> None:  # noqa: ARG001 -- a handler's
        if frame is not None:
            counts[_part(frame)] += 1

    before = signal.signal(signal.SIGPROF, look)
    signal.setitimer(signal.ITIMER_PROF, EVERY, EVERY)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_PROF, 0)
        signal.signal(signal.SIGPROF, before)


def _part(frame: FrameType) -> str:
    at = f"{frame.f_code.co_filename}:{frame.f_code.co_name}".replace("\\", "/")
    return next(part for part, (_, places) in PARTS.items() if any(p in at for p in places))
