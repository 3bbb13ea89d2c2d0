"""Results of a supervisor's edits, from a run's records."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace

from islandgp.gp.edits import EditRecord, EditTrial
from islandgp.gp.population import Origin
from islandgp.gp.record import GenerationRecord


@dataclass(frozen=True, slots=True)
class EditFate:
    """An edit with its trial and its descendants."""

    edit: EditRecord
    source: str  # name of the supervisor that advised it
    generation: int  # after which it was advised
    trial: EditTrial | None = None  # in the next generation; None: refused or not yet evaluated
    children: int = 0  # individuals with its tree as a parent
    survived_generations: int = 0  # generations until its last descendant; 0: no descendants

    @property
    def gain(self) -> float | None:
        """Points above the tree before the edit, in the same worlds; None without a trial."""
        return None if self.trial is None else self.trial.fitness - self.trial.parent_fitness


def edit_fates(records: Iterable[GenerationRecord]) -> list[EditFate]:
    """All edits of a run with their results, in the order in which they were advised.

    Args:
        records: of the generations so far, starting with the first.
    """
    fates: list[EditFate] = []
    waiting: list[int] = []  # indices of the edits evaluated in the next generation
    lines: dict[str, frozenset[int]] = {}  # the edits that an individual descends from, by id
    place: dict[str, int] = {}  # the edit whose tree an individual is, by id
    for record in records:
        g, trials = record.snapshot.generation, {t.id: t for t in record.trials}
        for i in record.individuals:
            descends = frozenset().union(*(lines.get(name, frozenset()) for name in i.parents))
            for name in set(i.parents) & place.keys():
                k = place[name]
                fates[k] = replace(fates[k], children=fates[k].children + 1)
            for k in descends:
                fates[k] = replace(fates[k], survived_generations=g - fates[k].generation - 1)
            if i.origin == Origin.EDITED and waiting:
                place[i.id] = k = waiting.pop(0)
                fates[k] = replace(fates[k], trial=trials.get(i.id))
                descends |= {k}
            if descends:
                lines[i.id] = descends
        waiting = []
        for edit in () if record.guidance is None else record.guidance.edits:
            if not edit.refused:
                waiting.append(len(fates))
            assert record.guidance is not None
            fates.append(EditFate(edit, record.guidance.source, g))
    return fates
