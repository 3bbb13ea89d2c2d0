"""Control arms of `supervisor=editor`: each replaces one of its decisions.

The editor beats RandomBranch if its choice of the branch matters, RandomTree if its choice of the
tree matters, and EditorYoked and Constant if it matters that it looks at the present population.
"""

from __future__ import annotations

import json
from typing import ClassVar, Self

import numpy as np

from islandgp.bt.core.node import Node
from islandgp.errors import SupervisionError
from islandgp.gp.record import IndividualRecord
from islandgp.supervision.base import GenerationView, RunContext
from islandgp.supervision.editor import Editor, EditorSettings, Requirement
from studies.controls.yoked import DAMAGES, Yoked, YokedSettings, damaged_record


class RandomBranch(Editor):
    """Adds branches drawn from those for all counters to the fittest tree."""

    name = "editor_random_branch"

    def branches_for(self, counter: str, rng: np.random.Generator) -> dict[Node, str]:
        """Branches drawn from those for all counters; as many as the editor has for this one."""
        pool: dict[Node, str] = {}
        for requirement in self.requirements:
            pool |= self.candidates(requirement.counter)
        pairs, number = [*pool.items()], len(self.candidates(counter))
        return dict(pairs[k] for k in rng.permutation(len(pairs))[:number])


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
    """The editor's settings, and the counter that every edit should raise."""

    counter: str | None = None
    """A counter in the requirements of a milestone. None: the counter of the first behaviour in
    `classes.hardest`, or else the first counter of the easiest milestone."""

    @property
    def reads(self) -> dict[str, tuple[str, ...]]:
        """See `Supervisor`."""
        return {**super().reads, "edits": ("library", "supervisor.policy.counter")}


class Constant(Editor):
    """Adds branches for the same counter in every generation."""

    name = "editor_constant"
    Settings: ClassVar[type[EditorSettings]] = ConstantSettings

    @classmethod
    def make(cls, settings: EditorSettings, context: RunContext) -> Self:
        """See `Supervisor`. Raises SupervisionError if no milestone requires the counter."""
        supervisor = cls(settings, context)
        supervisor.requirement()
        return supervisor

    def requirement(self) -> Requirement:
        """The requirement of every edit. Raises SupervisionError if no milestone has it."""
        assert isinstance(self.settings, ConstantSettings)
        classes = self.context.classes
        by_counter = {r.counter: r for r in reversed(self.requirements)}
        if not by_counter:
            raise SupervisionError(
                "Expected milestones that require a counter, found none; choose other classes, or"
                " another supervisor."
            )
        hardest = (classes.behaviours[name] for name in classes.hardest)
        counter = self.settings.counter or next(
            (c for c in hardest if c in by_counter), next(iter(by_counter))
        )
        if counter not in by_counter:
            raise SupervisionError(
                f"supervisor.policy.counter: expected one of {', '.join(by_counter)},"
                f" found {counter!r}"
            )
        return by_counter[counter]

    def requirements_to_edit_for(self, fittest: IndividualRecord) -> list[Requirement]:
        """The same requirement for every edit."""
        del fittest
        return [self.requirement()] * self.context.edits


class EditorYokedSettings(EditorSettings, YokedSettings, frozen=True, extra="forbid"):
    """The editor's settings, and the folder of the other run."""

    @property
    def reads(self) -> dict[str, tuple[str, ...]]:
        """See `Supervisor`."""
        names = (f"supervisor.policy.{name}" for name in YokedSettings.model_fields)
        return {**super().reads, "edits": ("library", *names)}


class EditorYoked(Editor):
    """Adds branches for the counters that another run's editor chose in the same generation."""

    name = "editor_yoked"
    Settings: ClassVar[type[EditorSettings]] = EditorYokedSettings
    counters: tuple[tuple[str, ...], ...] = ()  # of the other run's edits, by generation
    generation = 0  # the last one of this run

    @classmethod
    def check(cls, settings: EditorYokedSettings, context: RunContext) -> None:
        """Raises SupervisionError as `Yoked.check`."""
        Yoked.check(settings, context)

    @classmethod
    def make(cls, settings: EditorSettings, context: RunContext) -> Self:
        """See `Supervisor`. Raises SupervisionError as `check` does."""
        assert isinstance(settings, EditorYokedSettings)
        supervisor = cls(settings, context)
        try:
            supervisor.counters = tuple(map(counters_of, Yoked.lines(settings, context)))
        except DAMAGES as error:
            raise damaged_record(settings.folder(context.seed), error) from None
        return supervisor

    def on_generation(self, generation: GenerationView) -> None:
        """See `GenerationListener`."""
        super().on_generation(generation)
        self.generation = generation.snapshot.generation

    def requirements_to_edit_for(self, fittest: IndividualRecord) -> list[Requirement]:
        """Requirements on the counters of the other run's edits after the same generation."""
        del fittest
        by_counter = {r.counter: r for r in reversed(self.requirements)}
        counters = self.counters[self.generation]
        return [by_counter[counter] for counter in counters if counter in by_counter]


def counters_of(line: bytes) -> tuple[str, ...]:
    """The counters of the edits in a generation's record. Raises one of DAMAGES."""
    guidance = json.loads(line)["guidance"]
    return () if guidance is None else tuple(guidance["notes"].get("counters", "").split())
