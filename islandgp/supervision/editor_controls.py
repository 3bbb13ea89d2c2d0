"""Control arms of `supervisor=editor`: each replaces one of its decisions.

If the choice of the branch matters, the editor beats RandomBranch; if the choice of the tree
matters, RandomTree; if the present population matters, EditorYoked and Constant.
"""

from __future__ import annotations

from typing import ClassVar, Self

import numpy as np

from islandgp.errors import SupervisionError
from islandgp.gp.record import GenerationRecord, IndividualRecord
from islandgp.plain import validate_json
from islandgp.supervision.base import GenerationView, RunContext
from islandgp.supervision.editor import Branch, Editor, EditorSettings, Requirement
from islandgp.supervision.yoked import Yoked, YokedSettings, damaged_record


class RandomBranch(Editor):
    """Adds branches to the fittest tree, drawn from those for all counters."""

    name = "editor_random_branch"

    def ranked_branches(self, counter: str, rng: np.random.Generator) -> list[Branch]:
        """Branches drawn from all; as many as the editor knows for the counter."""
        candidates = [
            branch for r in self.requirements for branch in self.candidate_branches(r.counter)
        ]
        pool = list({branch.node: branch for branch in candidates}.values())
        drawn = rng.permutation(len(pool))[: len(self.candidate_branches(counter))]
        return [pool[k] for k in drawn]


class RandomTree(Editor):
    """Adds the branch that the fittest tree needs to trees drawn from the population."""

    name = "editor_random_tree"

    def individual_to_edit(
        self, view: GenerationView, fittest: IndividualRecord, rng: np.random.Generator
    ) -> IndividualRecord:
        """An individual drawn uniformly from the population."""
        del fittest
        return view.individuals[rng.integers(len(view.individuals))]


class ConstantSettings(EditorSettings, frozen=True, extra="forbid"):
    """The counter that every edit shall raise."""

    counter: str | None = None
    """A counter in the requirements of a milestone; None: that of the first of `classes.hardest`,
    or else the first one of the easiest milestone."""


class Constant(Editor):
    """Adds branches for one and the same counter, independent of the population."""

    name = "editor_constant"
    Settings: ClassVar[type[EditorSettings]] = ConstantSettings

    @classmethod
    def make(cls, settings: EditorSettings, context: RunContext) -> Self:
        """See `Supervisor`. Raises SupervisionError if no milestone requires the counter."""
        supervisor = cls(settings, context)
        supervisor.always()
        return supervisor

    def always(self) -> Requirement:
        """The requirement of every edit. Raises SupervisionError if no milestone has it."""
        assert isinstance(self.settings, ConstantSettings)
        classes, known = self.context.classes, {r.counter: r for r in reversed(self.requirements)}
        if not known:
            raise SupervisionError(
                "Expected milestones that require a counter, found none; choose other classes, or"
                " another supervisor."
            )
        hardest = (classes.behaviours[name] for name in classes.hardest)
        counter = self.settings.counter or next(
            (c for c in hardest if c in known), next(iter(known))
        )
        if counter not in known:
            raise SupervisionError(
                f"supervisor.policy.counter: expected one of {', '.join(known)}, found {counter!r}"
            )
        return known[counter]

    def requirements_to_edit_for(self, fittest: IndividualRecord) -> list[Requirement]:
        """The same requirement for every edit."""
        del fittest
        return [self.always()] * self.context.edits


class EditorYokedSettings(EditorSettings, YokedSettings, frozen=True, extra="forbid"):
    """The other run, and the settings of the editor."""


class EditorYoked(Editor):
    """Edits for the counters that the editor of another run chose in the same generation."""

    name = "editor_yoked"
    Settings: ClassVar[type[EditorSettings]] = EditorYokedSettings
    counters: tuple[tuple[str, ...], ...] = ()  # of the other run's edits, by generation

    @classmethod
    def ready(cls, settings: EditorYokedSettings, context: RunContext) -> None:
        """Raises SupervisionError as `Yoked.ready`."""
        Yoked.ready(settings, context)

    @classmethod
    def make(cls, settings: EditorSettings, context: RunContext) -> Self:
        """See `Supervisor`. Raises SupervisionError as `ready` does."""
        assert isinstance(settings, EditorYokedSettings)
        supervisor = cls(settings, context)
        try:
            supervisor.counters = tuple(map(counters_of, Yoked.lines(settings, context)))
        except ValueError as error:
            raise damaged_record(settings.folder(context.seed), error) from None
        return supervisor

    def requirements_to_edit_for(self, fittest: IndividualRecord) -> list[Requirement]:
        """Requirements on the counters of the other run's edits after the same generation."""
        del fittest
        assert self._latest is not None
        known = {r.counter: r for r in reversed(self.requirements)}
        counters = self.counters[self._latest.snapshot.generation]
        return [known[counter] for counter in counters if counter in known]


def counters_of(line: bytes) -> tuple[str, ...]:
    """The counters of the edits in a generation's record. Raises ValueError if it is damaged."""
    guidance = validate_json(GenerationRecord, line)["guidance"]
    return () if guidance is None else tuple(guidance["notes"].get("counters", "").split())
