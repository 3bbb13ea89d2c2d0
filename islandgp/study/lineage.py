"""Descent: survival of newcomers' lineages, and origins of the best individuals (section 2.4.2).

A newcomer is a supervisor's tree, or a random tree of a diversity slot, which fills the same slot
without injection. An individual descends from it if it is reached by a chain of parents; this does
not measure how much of the newcomer's tree is left, as crossover may keep a single leaf.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Iterator, Sequence, Set
from dataclasses import dataclass
from enum import StrEnum
from typing import Any, Final

import numpy as np

from islandgp.gp.population import Origin
from islandgp.gp.record import GenerationRecord, IndividualRecord
from islandgp.study.arms import Arm, Run
from islandgp.study.library import library_names

ADVISED: Final = (Origin.INJECTED, Origin.EDITED)
"""Origins of a supervisor's trees, and of the library's in generation 0."""
ELITE: Final = 0.1  # share of a population that is its elite: the top 3 of 30 (section 2.3)


# Where an individual comes from.
RANDOM: Final = "a random tree, as it was drawn"
BRED: Final = "bred, no injected ancestor"
HEIR: Final = "bred, with an injected ancestor"
EDITED: Final = "edited by the supervisor"
UNCHANGED: Final = "injected, unchanged: "  # prefix of the tree's source


@dataclass(frozen=True, slots=True)
class Newcomer:
    """A tree that was injected or drawn at random, and its descendants."""

    id: str
    origin: Origin  # INJECTED, EDITED or RANDOM
    generation: int  # of its first evaluation
    fitness: float  # points, in that generation
    lived: int  # generations until its last descendant; 0: no descendants
    watched: int  # generations of the run after its first evaluation
    descendants: int  # number of individuals


def newcomers(run: Run) -> tuple[Newcomer, ...]:
    """The newcomers of generations 1 and later, by generation."""
    came = list(_came(run.records))
    n, end = len(came), len(run.records) - 1
    last = np.array([generation for generation, _ in came], int)
    descendants = np.zeros_like(last)
    # The newcomers in an individual's line, a bit each: sets would take ten times the memory.
    bits = {i.id: np.packbits(np.arange(n) == k) for k, (_, i) in enumerate(came)}
    none = np.packbits(np.zeros(n, bool))
    lines: dict[str, Any] = {}
    for generation, record in enumerate(run.records):
        for i in record.individuals:
            line = np.bitwise_or.reduce([none, *(lines.get(name, none) for name in i.parents)])
            ancestors = np.unpackbits(line, count=n).astype(bool)
            last[ancestors] = generation
            descendants += ancestors
            lines[i.id] = line | bits.get(i.id, none)
    return tuple(
        Newcomer(
            id=i.id,
            origin=Origin(i.origin),
            generation=generation,
            fitness=i.fitness,
            lived=until - generation,
            watched=end - generation,
            descendants=number,
        )
        for (generation, i), until, number in zip(
            came, last.tolist(), descendants.tolist(), strict=True
        )
    )


def elite_share(run: Run, origin: Origin) -> float:
    """Share of the final elite that descends from a newcomer of an origin, in [0, 1]."""
    heirs = _with_descendants(run, (i for _, i in _came(run.records) if i.origin == origin))
    elite = final_elite(run)
    return sum(i.id in heirs for i in elite) / len(elite)


def final_elite(run: Run) -> list[IndividualRecord]:
    """The best tenth of the last generation, best first."""
    ranked = sorted(run.records[-1].individuals, key=lambda i: -i.fitness)
    return ranked[: max(1, round(ELITE * len(ranked)))]


def with_injected_ancestor(run: Run) -> set[str]:
    """Ids of the injected individuals, also those of generation 0, and of their descendants."""
    individuals = (i for record in run.records for i in record.individuals)
    return _with_descendants(run, (i for i in individuals if i.origin in ADVISED))


def _with_descendants(run: Run, ancestors: Iterable[IndividualRecord]) -> set[str]:
    """Ids of some individuals and of their descendants."""
    heirs = {i.id for i in ancestors}
    for record in run.records:
        heirs |= {i.id for i in record.individuals if not heirs.isdisjoint(i.parents)}
    return heirs


def injected_shares(run: Run) -> list[float]:
    """Share of injected individuals and their descendants in each generation."""
    heirs = with_injected_ancestor(run)
    return [sum(i.id in heirs for i in r.individuals) / len(r.individuals) for r in run.records]


def alive(newcomers: Sequence[Newcomer], generations: int) -> list[float]:
    """Share of newcomers with a descendant k = 0, 1, ... generations later (Kaplan-Meier).

    A newcomer with a living descendant in the last generation is censored.
    """
    shares, share = [], 1.0
    for k in range(generations):
        shares.append(share)
        at_risk = sum(n.lived >= k and n.watched > k for n in newcomers)  # seen in k and after it
        died = sum(n.lived == k < n.watched for n in newcomers)
        share *= 1 - died / at_risk if at_risk else 1
    return shares


def median_life(newcomers: Sequence[Newcomer], generations: int) -> int | None:
    """Generations after which half of the lineages have ended; None: more than half survive."""
    return next((k for k, s in enumerate(alive(newcomers, generations)) if s <= 0.5), None)


class Descent(StrEnum):
    """Origin of the first individual of a tier."""

    INJECTED = "an injected tree, as it was given"
    MUTATED = "an injected tree, mutated"
    EDITED = "a tree that the supervisor edited"
    DESCENDANT = "a descendant of injected trees"
    OWN = "no injected ancestor"
    NEVER = "never emerged"


def descent_of_first(run: Run, tier: str) -> Descent:
    """Origin of the first individual of a tier; of several, the fittest one."""
    heirs = with_injected_ancestor(run)
    for record in run.records:
        reached = [i for i in record.individuals if tier in i.tiers]
        if reached:
            best = max(reached, key=lambda i: i.fitness)
            if best.origin == Origin.INJECTED:
                return Descent.MUTATED if best.mutation else Descent.INJECTED
            if best.origin == Origin.EDITED:
                return Descent.EDITED
            return Descent.DESCENDANT if best.id in heirs else Descent.OWN
    return Descent.NEVER


def first_descendant(run: Run, tier: str) -> int | None:
    """The first generation with an individual of a tier that is not an advised tree; None: never.

    An advised tree is one that a supervisor injected or edited, and that has not changed since.
    """
    by_id = {i.id: i for record in run.records for i in record.individuals}
    for generation, record in enumerate(run.records):
        sources = (_original(i, by_id) for i in record.individuals if tier in i.tiers)
        if not all(_as_advised(i) for i in sources):
            return generation
    return None


def _as_advised(i: IndividualRecord) -> bool:
    """True for a tree that a supervisor injected or edited, and that was not mutated."""
    if i.origin == Origin.EDITED:
        return "+" not in i.mutation  # "edit:KIND+OPERATOR" if it was
    return i.origin == Origin.INJECTED and not i.mutation


def provenance(run: Run, individuals: Iterable[IndividualRecord]) -> list[str]:
    """RANDOM, BRED, HEIR, or UNCHANGED with a name, for each of some individuals of a run.

    A tree that was mutated when it was drawn or injected counts as bred.
    """
    by_id = {i.id: i for record in run.records for i in record.individuals}
    heirs = with_injected_ancestor(run)
    return [_source(run, _original(i, by_id), heirs) for i in individuals]


def _source(run: Run, i: IndividualRecord, heirs: Set[str]) -> str:
    if i.origin == Origin.INJECTED and not i.mutation:
        return f"{UNCHANGED}{giver(run, i)}"
    if i.origin == Origin.EDITED:
        return EDITED
    if i.id in heirs:
        return HEIR
    return RANDOM if i.origin == Origin.RANDOM and not i.mutation else BRED


def _original(i: IndividualRecord, by_id: dict[str, IndividualRecord]) -> IndividualRecord:
    while len(i.parents) == 1 and not i.mutation and i.parents[0] in by_id:
        parent = by_id[i.parents[0]]
        if parent.tree != i.tree:
            break
        i = parent
    return i


def giver(run: Run, injected: IndividualRecord) -> str:
    """The file name of an injected library tree, or else the supervisor that wrote the tree.

    The other trees of generation 0 have no supervisor: those of `start`, and those that a search
    makes from the library's branches.
    """
    generation = int(injected.id.partition(".")[0])
    guidance = run.records[generation - 1].guidance if generation else None
    if guidance is None or guidance.tree is None:
        return library_names(run.config).get(injected.tree, "no supervisor")
    return library_names(run.config).get(guidance.tree, guidance.source)


def most_injected(arms: Iterable[Arm]) -> tuple[str, str, int] | None:
    """Name, text and count of the library tree that the runs injected most often, or None."""
    runs = [run for arm in arms for run in arm.runs]
    counts = Counter(g.tree for run in runs for g in run.guidance if g.injected and g.tree)
    names = {text: name for run in runs for text, name in library_names(run.config).items()}
    from_library = [(n, names[text], text) for text, n in counts.items() if text in names]
    if not from_library:
        return None
    times, name, text = min(from_library, key=lambda count: (-count[0], count[1]))
    return name, text, times


def _came(records: Sequence[GenerationRecord]) -> Iterator[tuple[int, IndividualRecord]]:
    for generation, record in enumerate(records):
        for i in record.individuals:
            if generation and i.origin in (*ADVISED, Origin.RANDOM):
                yield generation, i
