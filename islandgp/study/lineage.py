"""What became of newcomers: survival, descendants and share of the elite (section 2.4.2).

A newcomer is a supervisor's tree, or a random tree of a diversity slot, which
is what stands in the same slot without injection. An individual descends from
it when a chain of parents leads there. That says nothing of how much of the
newcomer's tree is left: crossover may keep one leaf of it.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from enum import StrEnum
from typing import Final

from islandgp.evolution.population import Origin
from islandgp.evolution.record import GenerationRecord, IndividualRecord
from islandgp.scoring.classify import Tier
from islandgp.study.arms import Run

ELITE: Final = 0.1  # share of a population that is its elite: the top 3 of 30 (section 2.3)


@dataclass(frozen=True, slots=True)
class Newcomer:
    """One tree that came from outside, and what became of it."""

    id: str
    origin: Origin  # INJECTED or RANDOM
    generation: int  # in which it came
    fitness: float  # points, when it came
    lived: int  # generations until its last descendant; 0: it had none
    watched: int  # generations of the run after it came
    descendants: int  # individuals


def newcomers(run: Run) -> tuple[Newcomer, ...]:
    """The newcomers of generations 1 and later, in the order in which they came."""
    came = list(_came(run.records))
    last = [generation for generation, _ in came]
    descendants = [0] * len(came)
    for generation, _, ancestors in _walk(run.records, [i.id for _, i in came]):
        for k in _bits(ancestors):
            last[k] = generation
            descendants[k] += 1
    end = len(run.records) - 1
    return tuple(
        Newcomer(
            id=i.id,
            origin=Origin(i.origin),
            generation=generation,
            fitness=i.fitness,
            lived=last[k] - generation,
            watched=end - generation,
            descendants=descendants[k] - 1,
        )
        for k, (generation, i) in enumerate(came)
    )


def elite_share(run: Run, origin: Origin) -> float:
    """Share of the final elite that descends from a newcomer of an origin, in [0, 1]."""
    ids = [i.id for _, i in _came(run.records) if i.origin == origin]
    descends = {i.id for _, i, _ in _walk(run.records, ids)}
    elite = final_elite(run)
    return sum(i.id in descends for i in elite) / len(elite)


def final_elite(run: Run) -> list[IndividualRecord]:
    """The best tenth of the last generation, best first."""
    ranked = sorted(run.records[-1].individuals, key=lambda i: -i.fitness)
    return ranked[: max(1, round(ELITE * len(ranked)))]


def with_injected_ancestor(run: Run) -> frozenset[str]:
    """The ids of all individuals that descend from an injected tree, or are one."""
    ids = [i.id for _, i in _came(run.records) if i.origin == Origin.INJECTED]
    return frozenset(i.id for _, i, _ in _walk(run.records, ids))


def injected_shares(run: Run) -> list[float]:
    """Which share of each generation descends from an injected tree, or is one."""
    heirs = with_injected_ancestor(run)
    return [sum(i.id in heirs for i in r.individuals) / len(r.individuals) for r in run.records]


def alive(found: Sequence[Newcomer], generations: int) -> list[float]:
    """Share of newcomers with a descendant k = 0, 1, ... generations later (Kaplan-Meier).

    A newcomer whose line lives in the last generation is censored there.
    """
    shares, share = [], 1.0
    for k in range(generations):
        shares.append(share)
        at_risk = sum(n.lived >= k and n.watched > k for n in found)  # seen in k and after it
        died = sum(n.lived == k < n.watched for n in found)
        share *= 1 - died / at_risk if at_risk else 1
    return shares


def median_life(found: Sequence[Newcomer], generations: int) -> int | None:
    """Generations after which half of the lines have ended; None: more than half last."""
    return next((k for k, s in enumerate(alive(found, generations)) if s <= 0.5), None)


class Source(StrEnum):
    """Where the first individual of a tier came from."""

    INJECTED = "an injected tree, as it was given"
    MUTATED = "an injected tree, mutated"
    DESCENDANT = "a descendant of injected trees"
    OWN = "no injected ancestor"
    NEVER = "never emerged"


def source_of_first(run: Run, tier: Tier) -> Source:
    """Where the first individual of a tier came from; the fittest, if there are several."""
    heirs = with_injected_ancestor(run)
    for record in run.records:
        reached = [i for i in record.individuals if tier in i.tiers]
        if reached:
            best = max(reached, key=lambda i: i.fitness)
            if best.origin == Origin.INJECTED:
                return Source.MUTATED if best.mutation else Source.INJECTED
            return Source.DESCENDANT if best.id in heirs else Source.OWN
    return Source.NEVER


def _came(records: Sequence[GenerationRecord]) -> Iterator[tuple[int, IndividualRecord]]:
    for generation, record in enumerate(records):
        for i in record.individuals:
            if generation and i.origin in (Origin.INJECTED, Origin.RANDOM):
                yield generation, i


def _walk(
    records: Sequence[GenerationRecord], ids: Sequence[str]
) -> Iterator[tuple[int, IndividualRecord, int]]:
    """Each individual with its ancestors among `ids`, itself included, as bits."""
    bit = {name: 1 << k for k, name in enumerate(ids)}
    known: dict[str, int] = {}
    for generation, record in enumerate(records):
        for i in record.individuals:
            ancestors = bit.get(i.id, 0)
            for parent in i.parents:
                ancestors |= known.get(parent, 0)
            known[i.id] = ancestors
            if ancestors:
                yield generation, i, ancestors


def _bits(mask: int) -> Iterator[int]:
    while mask:
        low = mask & -mask
        yield low.bit_length() - 1
        mask ^= low
