"""Named random streams: one for each purpose of a draw.

A stream is a function of (run seed, purpose, generation, slot) and stateless between generations.
So a resumed run, another number of workers or another decision of a supervisor does not shift
other draws.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum
from typing import TypeAlias

import numpy as np

Rng: TypeAlias = np.random.Generator  # a random stream; functions consume it


class Stream(IntEnum):
    """Purpose of a stream. The numbers are part of every run's identity: never reuse one."""

    INITIAL = 1  # the random trees of generation 0, by slot
    WORLD = 2  # world seeds, by generation and episode
    SELECTION = 3  # tournaments, by generation and slot
    CROSSOVER = 4  # cut points, by generation and slot
    DIVERSITY = 5  # the random trees of the diversity slots, by generation and slot
    MUTATION = 6  # whether and how an individual mutates, by generation and slot
    SUPERVISION = 7  # a supervisor's own draws, by generation
    NETWORK = 8  # jitter between attempts of a call, by generation
    UNSEEN = 9  # a comparison's worlds for best robots, by slot; the run seed is 0
    LIBRARY = 10  # the search for single behaviours, by behaviour and slot; the run seed is 0
    VALIDATION = 11  # worlds in which a run chooses its best robot, by slot
    TEST = 13  # worlds in which a run's best trees are tested, by slot; not used for selection
    TUNING = 14  # worlds in which thresholds are tuned, by slot; generation 1: the draws of CMA-ES
    SEARCH = 15  # a search's own draws, by generation and slot
    ARCHIVE = 16  # worlds in which elites are challenged, by generation and slot
    PERTURBATION = 18  # of a world, by its seed; slot 0: its settings, 1: its sensors
    PRUNING = 19  # worlds in which the best robot is shortened, by slot; generation: the purpose
    JUDGING = 20  # of a plug-in: draws and worlds, by population and slot; the seed is 0
    ORDER = 21  # orders of the children of a random selector, by its place in the tree
    RESAMPLING = 100  # a comparison's bootstrap, by world; generation 1: a second sample; seed 0


def stream(seed: int, purpose: Stream, *, generation: int = 0, slot: int = 0) -> Rng:
    """The generator of one purpose; calling it twice gives the same draws twice."""
    key = np.random.SeedSequence(seed, spawn_key=(int(purpose), generation, slot))
    return Rng(np.random.PCG64(key))


def seed_of(seed: int, purpose: Stream, *, generation: int = 0, slot: int = 0) -> int:
    """A seed, e.g. of a world, in [0, 2**32)."""
    return int(stream(seed, purpose, generation=generation, slot=slot).integers(2**32))


@dataclass(frozen=True, slots=True)
class Streams:
    """The streams of one run: `stream` with the run's seed filled in."""

    seed: int

    def __call__(self, purpose: Stream, *, generation: int = 0, slot: int = 0) -> Rng:
        """The generator of one purpose; calling it twice gives the same draws twice."""
        return stream(self.seed, purpose, generation=generation, slot=slot)
