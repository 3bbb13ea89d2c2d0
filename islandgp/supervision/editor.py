"""A rule-based supervisor that edits trees of the population.

It compares the counters of the fittest tree with the requirements of the tiers, so it works in any
domain. For each counter that is too low it looks for a branch: in the library, by the library
tree's target; and in evaluated trees, by the action most typical of the counter. That is the action
for which the largest share of the trees with it have a counter above 0. The branch is inserted
before the first branch with an equally wide or wider guard.
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import ClassVar, Final, Literal, Self

import numpy as np
from pydantic import Field

from islandgp.bt.core.language import parse, to_text
from islandgp.bt.core.node import Node, guard_of, size, walk
from islandgp.gp.branches import branches_of
from islandgp.gp.edits import Edit, path_text
from islandgp.gp.record import IndividualRecord, fittest
from islandgp.scoring.classes import Classes
from islandgp.scoring.state import PopulationState
from islandgp.search.compose import library_branches
from islandgp.supervision.base import GenerationView, Guidance, RunContext
from islandgp.supervision.expert import (
    ExpertSettings,
    classify_pattern,
    classify_phase,
    policy_keys,
    wanted_rate,
)
from islandgp.supervision.guard_width import place_for, same_child_guard, widened
from islandgp.supervision.library import Library

EXAMPLES: Final = 5  # most trees per counter whose branches are candidates
WORD: Final = re.compile(r"\w+")

EditKey = tuple[str, str, str | None, float | None]
"""Kind, place, canonical text of the branch, and number of an edit."""


class EditorSettings(ExpertSettings, frozen=True, extra="forbid"):
    """The expert's settings, and the sources of branches."""

    sources: tuple[Literal["library", "archive"], ...] = Field(("library", "archive"), min_length=1)
    """Sources of branches, in order of priority; archive: trees that the run has evaluated."""

    @property
    def reads(self) -> dict[str, tuple[str, ...]]:
        """See `Supervisor`."""
        added = type(self).model_fields.keys() - ExpertSettings.model_fields.keys()
        library = ("library",) if "library" in self.sources else ()
        return {"rate": super().reads["rate"], "edits": (*policy_keys(added), *library)}


@dataclass(frozen=True, slots=True)
class Requirement:
    """A lower bound of a tier on one counter."""

    counter: str
    value: float  # the bound
    strict: bool  # True: count > value; False: count >= value
    milestone: int  # index of the easiest milestone that requires it; number of milestones if none

    def __str__(self) -> str:
        """The bound in words, e.g. `at least 2`."""
        return f"{'more than' if self.strict else 'at least'} {self.value:g}"

    def met(self, counters: Mapping[str, float]) -> bool:
        """True if the counters meet the bound."""
        count = counters[self.counter]
        return count > self.value if self.strict else count >= self.value


def requirements(classes: Classes) -> tuple[Requirement, ...]:
    """The distinct lower bounds on counters of the milestones' tiers, the easiest milestone first.

    A bound of more than 0 for each behaviour follows, as tiers may be defined by points alone.
    """
    bounds: list[Requirement] = []
    for k, milestone in enumerate(classes.milestones):
        for tier in (classes.tiers[name] for name in reversed(classes.needed(milestone))):
            for strict, values in ((False, tier.at_least), (True, tier.above)):
                bounds += [Requirement(c, value, strict, k) for c, value in values.items()]
    last = len(classes.milestones)
    bounds += [Requirement(c, 0.0, True, last) for c in classes.behaviours.values()]
    # Keep each bound for its easiest milestone. Tiers may bound `fitness`, which is no counter.
    easiest: dict[tuple[str, float, bool], Requirement] = {}
    for bound in bounds:
        if bound.counter != "fitness":
            easiest.setdefault((bound.counter, bound.value, bound.strict), bound)
    return tuple(easiest.values())


@dataclass(frozen=True, slots=True)
class Branch:
    """A branch that can be inserted into a tree."""

    node: Node
    source: str  # in words, e.g. "library tree single_charging"


class Editor:
    """Edits the fittest tree by deterministic rules; some control arms draw at random."""

    name = "editor"
    Settings: ClassVar[type[EditorSettings]] = EditorSettings

    @classmethod
    def make(cls, settings: EditorSettings, context: RunContext) -> Self:
        """See `Supervisor`."""
        return cls(settings, context)

    def __init__(self, settings: EditorSettings, context: RunContext) -> None:
        self.settings = settings
        self.context = context
        self.requirements = requirements(context.classes)
        self._latest: GenerationView | None = None
        self._trees: dict[int, dict[str, str]] = {}  # by generation and id; `lag` + 1 generations
        self._examples: dict[str, list[IndividualRecord]] = {}  # by counter, highest counts first
        self._trees_with: Counter[str] = Counter()  # number of evaluated trees, by action
        self._shown_with: Counter[tuple[str, str]] = Counter()
        """Number of evaluated trees with the counter above 0, by counter and action."""
        self._evaluated: Counter[str] = Counter()  # number of edits, by inserted branch
        self._improved: Counter[str] = Counter()  # number of them that improved the tree
        self._advised: set[tuple[str, EditKey]] = set()  # by tree; accepted or refused

    # Measurements of the run.

    def on_generation(self, generation: GenerationView) -> None:
        """See `GenerationListener`."""
        self._learn(generation)
        self._latest = generation
        self._trees[generation.snapshot.generation] = {i.id: i.tree for i in generation.individuals}
        counters = dict.fromkeys(r.counter for r in self.requirements)
        for individual in generation.individuals:
            names = set(WORD.findall(individual.tree))
            actions = names & self.context.schema.vocabulary.actions.keys()
            self._trees_with.update(actions)
            for counter in counters:
                if individual.counters[counter] > 0:
                    self._shown_with.update((counter, action) for action in actions)
                    self._examples.setdefault(counter, []).append(individual)
        for counter, examples in self._examples.items():
            order = sorted(examples, key=lambda i: (-i.counters[counter], i.nodes))
            self._examples[counter] = list({i.tree: i for i in reversed(order)}.values())[::-1]
            del self._examples[counter][EXAMPLES:]

    def _learn(self, generation: GenerationView) -> None:
        """Count the edits that the generation evaluated, and those that improved a tree.

        The edits are read from the record, so a resumed run has the same counts. They refer to
        individuals of generation `asked_at`.
        """
        guidance = generation.guidance
        if guidance is None or guidance.asked_at is None:
            return
        self._trees = {g: trees for g, trees in self._trees.items() if g >= guidance.asked_at}
        trees = self._trees.get(guidance.asked_at, {})
        for edit in guidance.edits:
            if edit.of in trees:
                key = (edit.kind, edit.at, edit.branch, edit.number)
                self._advised.add((trees[edit.of], key))
        accepted = [edit for edit in guidance.edits if not edit.refused]
        # There are no trials if the search evaluates no edits, or if the run stopped before.
        for edit, trial in zip(accepted, generation.trials, strict=False):
            if edit.branch is not None:
                self._evaluated[edit.branch] += 1
                self._improved[edit.branch] += trial.fitness > trial.parent_fitness

    # Advice.

    def advise(self, state: PopulationState, rng: np.random.Generator) -> Guidance:
        """See `Supervisor`. The expert's rate, and edits of the fittest tree."""
        view, settings = self._latest, self.settings
        edits: list[tuple[str, Edit]] = []
        if view is not None and view.snapshot.generation == state.now.generation:
            edits = self.edits(view, rng)
        phase = classify_phase(state, settings)
        return Guidance(
            mutation_rate=wanted_rate(state, settings),
            tree=None,
            source=self.name,
            phase=phase,
            pattern=classify_pattern(state, settings),
            reasoning="; ".join(edit.reason for _, edit in edits) or "nothing to edit",
            notes={"counters": " ".join(counter for counter, _ in edits)} if edits else {},
            edits=tuple(edit for _, edit in edits),
        )

    def edits(self, view: GenerationView, rng: np.random.Generator) -> list[tuple[str, Edit]]:
        """At most `supervisor.edits` edits, each with the counter that it should raise."""
        best = fittest(view.individuals, self.context.constraints)
        advised = set(self._advised)
        untried: dict[str, Iterator[Edit]] = {}  # by counter
        edits: list[tuple[str, Edit]] = []
        for requirement in self.requirements_to_edit_for(best):
            if len(edits) == self.context.edits:
                break
            counter = requirement.counter
            if counter not in untried:
                branches = self.ranked_branches(counter, rng)
                individual = self.individual_to_edit(view, best, rng)
                untried[counter] = self.untried_edits(individual, branches, requirement, advised)
            if (edit := next(untried[counter], None)) is not None:
                edits.append((counter, edit))
        return edits

    def untried_edits(
        self,
        individual: IndividualRecord,
        branches: Sequence[Branch],
        requirement: Requirement,
        advised: set[tuple[str, EditKey]],
    ) -> Iterator[Edit]:
        """Edits that add branches to an individual's tree and are not in `advised`.

        Each edit that it yields is added to `advised`.
        """
        for branch in branches:
            for edit in self.edits_with(individual, branch, requirement):
                text = None if edit.branch is None else to_text(edit.branch)
                key = (individual.tree, (edit.kind, edit.at, text, edit.number))
                if key not in advised:
                    advised.add(key)
                    yield edit

    def requirements_to_edit_for(self, fittest: IndividualRecord) -> list[Requirement]:
        """The requirement of each edit, in order; control arms override it.

        These are the unmet requirements, repeated, as one may need several edits.
        """
        return self.unmet(fittest) * self.context.edits

    def unmet(self, individual: IndividualRecord) -> list[Requirement]:
        """The easiest unmet requirement of each counter.

        Sorted by milestone, the easiest first; then by the share of the bound that is reached, the
        lowest first; then as `classes.hardest`.
        """
        counters = individual.counters
        missed = {r.counter: r for r in reversed(self.requirements) if not r.met(counters)}
        easiest = [r for r in self.requirements if missed.get(r.counter) is r]
        hardest = [self.context.classes.behaviours[name] for name in self.context.classes.hardest]

        def order(r: Requirement) -> tuple[int, float, int]:
            share = counters[r.counter] / r.value if r.value > 0 else 0.0
            rank = hardest.index(r.counter) if r.counter in hardest else len(hardest)
            return r.milestone, share, rank

        return sorted(easiest, key=order)

    def individual_to_edit(
        self, view: GenerationView, fittest: IndividualRecord, rng: np.random.Generator
    ) -> IndividualRecord:
        """The individual to edit; control arms override it."""
        del view, rng
        return fittest

    def ranked_branches(self, counter: str, rng: np.random.Generator) -> list[Branch]:
        """Distinct branches for a counter, the most promising first; control arms override it."""
        del rng

        def success_rate(branch: Branch) -> float:
            """The share of the branch's edits that improved a tree; 1/2 without edits."""
            text = to_text(branch.node)
            return (self._improved[text] + 1) / (self._evaluated[text] + 2)

        return sorted(self.candidate_branches(counter), key=success_rate, reverse=True)

    def candidate_branches(self, counter: str) -> list[Branch]:
        """Distinct branches that may raise a counter, in the order of the sources.

        A branch that occurs several times has the place of the last and the source of the first.
        """
        of_source = {"library": self._library_branches, "archive": self._archive_branches}
        branches = [b for source in self.settings.sources for b in of_source[source](counter)]
        return list({branch.node: branch for branch in reversed(branches)}.values())[::-1]

    def _library_branches(self, counter: str) -> list[Branch]:
        """The first guarded branch of each library tree for the counter's behaviours."""
        behaviours = [b for b, name in self.context.classes.behaviours.items() if name == counter]
        names = [name for b in behaviours for name in self.library.targets.get(b, ())]
        return [
            Branch(branch, f"library tree {name}")
            for name in dict.fromkeys(names)
            for branch in library_branches([self.library.trees[name]])[0]
        ]

    def _archive_branches(self, counter: str) -> list[Branch]:
        """Guarded branches with the action most typical of a counter, the smallest first."""
        shown_with, trees_with = self._shown_with, self._trees_with
        actions = [action for name, action in shown_with if name == counter]
        if not actions:
            return []
        action = max(actions, key=lambda a: (shown_with[counter, a] / trees_with[a], a))
        vocabulary = self.context.schema.vocabulary
        branches = [
            Branch(branch, f"individual {i.id}")
            for i in self._examples[counter]
            for branch in branches_of(parse(i.tree, vocabulary))
            if branch.guard and any(node.action == action for node in walk(branch))
        ]
        return sorted(branches, key=lambda branch: size(branch.node))

    @cached_property
    def library(self) -> Library:
        """The run's library; loaded late, as the search for a missing library takes seconds."""
        return self.context.library()

    def edits_with(
        self, individual: IndividualRecord, branch: Branch, requirement: Requirement
    ) -> Iterator[Edit]:
        """Edits that insert a branch: at the place for its guard, and in front of the whole tree.

        If the tree already has the branch, there is one edit, which widens its guard, or none.
        """
        vocabulary = self.context.schema.vocabulary
        tree = parse(individual.tree, vocabulary)
        count = individual.counters[requirement.counter]
        reason = f"{requirement.counter} {count:g}, wanted {requirement}"
        if (present := same_child_guard(tree, branch.node)) is not None:
            path, guard = present
            number = widened(guard_of(guard).condition, vocabulary)
            if number is not None:
                reason = f"{reason}: a wider guard"
                yield Edit("number", individual.id, path_text(path), number=number, reason=reason)
            return
        reason = f"{reason}: a branch of {branch.source}"
        place = place_for(tree, branch.node, vocabulary)
        if place is not None and place > 0:
            # "front" inserts before the child at the place; after the last child there is none.
            kind = "insert" if place == len(tree.children) else "front"
            yield Edit(kind, individual.id, str(place), branch.node, reason=reason)
        yield Edit("front", individual.id, branch=branch.node, reason=reason)  # before the root
