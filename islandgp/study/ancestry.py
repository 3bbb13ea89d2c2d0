"""Where the best individuals come from: drawn, bred, or injected and never changed.

An unchanged copy (an elite, a resurrected ancestor, a tournament's copy) is
what it was copied from, so it is followed back to where the tree arose.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable
from typing import Final

from islandgp.evolution.population import Origin
from islandgp.evolution.record import IndividualRecord
from islandgp.study.arms import Arm, Run
from islandgp.study.library import library
from islandgp.study.lineage import with_injected_ancestor

RANDOM: Final = "a random tree, as it was drawn"
BRED: Final = "bred, no injected ancestor"
HEIR: Final = "bred, with an injected ancestor"
GIVEN: Final = "injected, as it is: "  # and whose tree it is


def provenance(run: Run, individuals: Iterable[IndividualRecord]) -> list[str]:
    """RANDOM, BRED, HEIR, or GIVEN with a name, for each of some individuals of a run.

    A tree that was mutated when it was drawn or injected counts as bred.
    """
    known = {i.id: i for record in run.records for i in record.individuals}
    heirs = with_injected_ancestor(run)
    return [_source(run, _original(i, known), heirs) for i in individuals]


def _source(run: Run, i: IndividualRecord, heirs: frozenset[str]) -> str:
    if i.origin == Origin.INJECTED and not i.mutation:
        return f"{GIVEN}{giver(run, i)}"
    if i.id in heirs:
        return HEIR
    return RANDOM if i.origin == Origin.RANDOM and not i.mutation else BRED


def _original(i: IndividualRecord, known: dict[str, IndividualRecord]) -> IndividualRecord:
    while len(i.parents) == 1 and not i.mutation and i.parents[0] in known:
        parent = known[i.parents[0]]
        if parent.tree != i.tree:
            break
        i = parent
    return i


def giver(run: Run, injected: IndividualRecord) -> str:
    """The library tree that an injected individual is, by its file's name, else who gave it."""
    asked = run.records[int(injected.id.partition(".")[0]) - 1].guidance
    if asked is None or asked.tree is None:
        return "unknown"
    return library().get(asked.tree, asked.source)


def most_injected(arms: Iterable[Arm]) -> tuple[str, str, int] | None:
    """The library tree that all runs injected most often: name, text, times; None: none at all."""
    counts = Counter(
        g.tree for arm in arms for run in arm.runs for g in run.guidance if g.injected and g.tree
    )
    names = library()
    from_library = [(n, names[text], text) for text, n in counts.items() if text in names]
    if not from_library:
        return None
    times, name, text = min(from_library, key=lambda found: (-found[0], found[1]))
    return name, text, times
