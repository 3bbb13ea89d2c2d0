"""Controls of `supervisor=editor`: as many edits in the same form, each without one judgement.

If the choice of the branch is what helps, the editor beats RandomBranch; if the choice of the tree
does, RandomTree; if reading the population does, the yoked and the constant one.
"""

from __future__ import annotations

from typing import ClassVar, Self

import numpy as np

from islandgp.errors import SupervisionError, brief
from islandgp.gp.record import GenerationRecord, IndividualRecord
from islandgp.plain import validate_json
from islandgp.supervision.base import GenerationView, RunContext
from islandgp.supervision.editor import Branch, Editor, EditorSettings, Requirement
from islandgp.supervision.yoked import Yoked, YokedSettings


class RandomBranch(Editor):
    """Puts branches into the fittest tree that are drawn from those for all counters."""

    name = "editor_random_branch"

    def branches(self, counter: str, rng: np.random.Generator) -> list[Branch]:
        """As many branches as the editor has for the counter, drawn from all."""
        every = [branch for r in self.requirements for branch in self.known(r.counter)]
        pool = list({branch.node: branch for branch in every}.values())
        drawn = rng.permutation(len(pool))[: len(self.known(counter))]
        return [pool[k] for k in drawn]


class RandomTree(Editor):
    """Puts the branch that the fittest tree lacks into trees that are drawn from the population."""

    name = "editor_random_tree"

    def tree(
        self, seen: GenerationView, fittest: IndividualRecord, rng: np.random.Generator
    ) -> IndividualRecord:
        """Any individual of the population is as likely as another."""
        del fittest
        return seen.individuals[rng.integers(len(seen.individuals))]


class ConstantSettings(EditorSettings, frozen=True, extra="forbid"):
    """What every edit is for."""

    counter: str | None = None
    """A counter that a milestone asks for; None: that of the first of `classes.hardest`, or else
    the first that the easiest milestone asks for."""


class Constant(Editor):
    """Gives the same advice always: a branch for one counter, whatever the fittest tree lacks."""

    name = "editor_constant"
    Settings: ClassVar[type[EditorSettings]] = ConstantSettings

    @classmethod
    def make(cls, settings: EditorSettings, context: RunContext) -> Self:
        """See `Supervisor`. Raises SupervisionError if no milestone asks for the counter."""
        made = cls(settings, context)
        made.always()
        return made

    def always(self) -> Requirement:
        """The requirement that every edit is for. Raises SupervisionError."""
        assert isinstance(self.settings, ConstantSettings)
        classes, known = self.context.classes, {r.counter: r for r in reversed(self.requirements)}
        if not known:
            raise SupervisionError(
                "Expected milestones that ask for a counter, found none; choose other classes, or"
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

    def wanted(self, fittest: IndividualRecord) -> list[Requirement]:
        """The same in each generation."""
        del fittest
        return [self.always()] * self.context.edits


class EditorYokedSettings(EditorSettings, YokedSettings, frozen=True, extra="forbid"):
    """Whose record it is."""


class EditorYoked(Editor):
    """Works in each generation on the counters that another run's editor worked on."""

    name = "editor_yoked"
    Settings: ClassVar[type[EditorSettings]] = EditorYokedSettings
    given: tuple[tuple[str, ...], ...] = ()  # counters of the edits after each generation

    @classmethod
    def ready(cls, settings: EditorYokedSettings, context: RunContext) -> None:
        """Raises SupervisionError as `Yoked.ready`."""
        Yoked.ready(settings, context)

    @classmethod
    def make(cls, settings: EditorSettings, context: RunContext) -> Self:
        """See `Supervisor`. Raises SupervisionError as `ready` does."""
        assert isinstance(settings, EditorYokedSettings)
        made = cls(settings, context)
        try:
            made.given = tuple(map(counters_of, Yoked.lines(settings, context)))
        except ValueError as error:
            raise SupervisionError(
                f"Expected the record of another run in {settings.folder(context.seed)}, found a"
                f" damaged one ({brief(error)}); run it again under another name, or set"
                " supervisor.policy.record."
            ) from None
        return made

    def wanted(self, fittest: IndividualRecord) -> list[Requirement]:
        """What the other run's editor wanted after the same generation."""
        del fittest
        assert self._now is not None
        known = {r.counter: r for r in reversed(self.requirements)}
        counters = self.given[self._now.snapshot.generation]
        return [known[counter] for counter in counters if counter in known]


def counters_of(line: bytes) -> tuple[str, ...]:
    """The counters that the edits of a generation's record are for. Raises ValueError."""
    guidance = validate_json(GenerationRecord, line)["guidance"]
    return () if guidance is None else tuple(guidance["notes"].get("counters", "").split())
