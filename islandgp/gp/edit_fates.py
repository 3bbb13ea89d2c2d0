"""Results of a supervisor's edits, from a run's records."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace

from islandgp.gp.edits import EditRecord, EditTrial
from islandgp.gp.population import Origin
from islandgp.gp.record import GenerationRecord


@dataclass(frozen=True, slots=True)
class EditFate:
    """An edit and what became of it."""

    edit: EditRecord
    source: str  # who advised it
    generation: int  # after which it was advised
    trial: EditTrial | None = None  # in the generation after; None: refused, or not evaluated yet
    children: int = 0  # individuals of which its tree is a parent
    lived: int = 0  # generations until its last descendant; 0: it had none

    @property
    def gain(self) -> float | None:
        """Points more than the tree that was edited, in the same worlds; None without a trial."""
        return None if self.trial is None else self.trial.fitness - self.trial.parent_fitness


def edit_fates(records: Iterable[GenerationRecord]) -> list[EditFate]:
    """The fates of all edits of a run, in the order in which they were advised.

    Args:
        records: of the generations so far, from the first on.
    """
    fates: list[EditFate] = []
    waiting: list[int] = []  # indices of the edits whose trees come next
    lines: dict[str, frozenset[int]] = {}  # by individual, the edits that it descends from
    place: dict[str, int] = {}  # by individual, the edit whose tree it is
    for record in records:
        g, trials = record.snapshot.generation, {t.id: t for t in record.trials}
        for i in record.individuals:
            descends = frozenset().union(*(lines.get(name, frozenset()) for name in i.parents))
            for name in set(i.parents) & place.keys():
                k = place[name]
                fates[k] = replace(fates[k], children=fates[k].children + 1)
            for k in descends:
                fates[k] = replace(fates[k], lived=g - fates[k].generation - 1)
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
