"""What a run has seen so far that a state does not tell: trees' fates, decisions' outcomes.

A chronicle is a function of the records of generations. A run that goes on and a
replay make it again from them.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final

from islandgp.evolution.population import Origin
from islandgp.evolution.record import GuidanceRecord, IndividualRecord
from islandgp.scoring.snapshot import Snapshot
from islandgp.supervision.base import Seen

KEPT: Final = 20  # injected trees and decisions that are remembered


@dataclass(frozen=True, slots=True)
class Fate:
    """A tree that was injected, and what has become of it."""

    generation: int  # in which it was evaluated first
    target: str  # what it was for
    tree: str  # as it was evaluated, perhaps after a mutation
    mutation: str  # operator, or ""
    fitness: float  # points, when it was new
    rank: int  # by fitness when it was new, from 1
    tiers: tuple[str, ...]  # that it reached when it was new, best first
    alive: frozenset[str]  # ids of the living that descend from it, itself and copies included
    most_alive: int  # the largest number of them in any generation
    last: int  # the last generation that had any
    unchanged: bool  # the very tree is among them
    best_rank: int | None  # of the fittest of them now; None: none is left


@dataclass(frozen=True, slots=True)
class Past:
    """A decision, and the generations before and after it."""

    guidance: GuidanceRecord
    before: Snapshot
    after: Snapshot


@dataclass(frozen=True, slots=True)
class Chronicle:
    """A run so far."""

    now: Seen | None = None  # the last generation
    fates: tuple[Fate, ...] = ()  # of the trees injected last, oldest first
    past: tuple[Past, ...] = ()  # the last decisions, oldest first

    def followed_by(self, seen: Seen) -> Chronicle:
        """With one generation more. Where generations before it were not told, they lack."""
        order = ranked(seen.individuals)
        ranks = {i.id: rank for rank, i in enumerate(order, 1)}
        fates = [_later(fate, seen, ranks) for fate in self.fates]
        fates += [_born(i, seen, ranks) for i in seen.individuals if i.origin == Origin.INJECTED]
        past = self.past
        if self.now is not None and seen.guidance is not None:
            past = (*past, Past(seen.guidance, self.now.snapshot, seen.snapshot))
        return Chronicle(seen, tuple(fates[-KEPT:]), past[-KEPT:])


def ranked(individuals: Sequence[IndividualRecord]) -> list[IndividualRecord]:
    """Best first; equals in slot order."""
    return sorted(individuals, key=lambda i: -i.fitness)


def _born(i: IndividualRecord, seen: Seen, ranks: dict[str, int]) -> Fate:
    target = "" if seen.guidance is None else seen.guidance.target or ""
    rank = ranks[i.id]
    return Fate(
        generation=seen.snapshot.generation,
        target=target,
        tree=i.tree,
        mutation=i.mutation,
        fitness=i.fitness,
        rank=rank,
        tiers=i.tiers,
        alive=frozenset({i.id}),
        most_alive=1,
        last=seen.snapshot.generation,
        unchanged=True,
        best_rank=rank,
    )


def _later(fate: Fate, seen: Seen, ranks: dict[str, int]) -> Fate:
    heirs = [i for i in seen.individuals if not fate.alive.isdisjoint(i.parents)]
    return replace(
        fate,
        alive=frozenset(i.id for i in heirs),
        most_alive=max(fate.most_alive, len(heirs)),
        last=seen.snapshot.generation if heirs else fate.last,
        unchanged=any(i.tree == fate.tree for i in heirs),
        best_rank=min((ranks[i.id] for i in heirs), default=None),
    )
