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
from collections.abc import Iterator, Mapping, Set
from dataclasses import dataclass
from functools import cached_property
from typing import ClassVar, Final, Self

import numpy as np

from islandgp.bt.core.condition import Condition, ConditionExpr
from islandgp.bt.core.language import parse, to_text
from islandgp.bt.core.node import Node, guard_of, size, walk
from islandgp.bt.core.vocabulary import Vocabulary
from islandgp.gp.branches import branches_of, fine
from islandgp.gp.edits import Edit, EditRecord, as_record, is_selector, nodes_with_paths, path_text
from islandgp.gp.record import IndividualRecord, fittest
from islandgp.scoring.classes import Classes
from islandgp.scoring.state import PopulationState
from islandgp.search.compose import library_branches
from islandgp.supervision.base import GenerationView, Guidance, RunContext
from islandgp.supervision.expert import (
    ExpertSettings,
    classify_pattern,
    classify_phase,
    wanted_rate,
)
from islandgp.supervision.library import Library

EXAMPLES: Final = 5  # most trees per counter whose branches are candidates
WIDENING_STEP: Final = 0.15  # step by which a guard is widened, as a share of its key's range
WORD: Final = re.compile(r"\w+")


class EditorSettings(ExpertSettings, frozen=True, extra="forbid"):
    """The expert's settings, for the mutation rate."""

    @property
    def reads(self) -> dict[str, tuple[str, ...]]:
        """See `Supervisor`."""
        return {"rate": super().reads["rate"], "edits": ("library",)}


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
    bounds = [
        Requirement(counter, value, strict, k)
        for k, milestone in enumerate(classes.milestones)
        for tier in (classes.tiers[name] for name in reversed(classes.needed(milestone)))
        for strict, values in ((False, tier.at_least), (True, tier.above))
        for counter, value in values.items()
        if counter != "fitness"
    ]
    last = len(classes.milestones)
    bounds += [Requirement(c, 0.0, True, last) for c in classes.behaviours.values()]
    easiest: dict[tuple[str, float, bool], Requirement] = {}
    for bound in bounds:
        easiest.setdefault((bound.counter, bound.value, bound.strict), bound)
    return tuple(easiest.values())


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
        self._examples: dict[str, list[IndividualRecord]] = {}  # by counter, highest counts first
        self._seen: list[tuple[Set[str], IndividualRecord]] = []  # the actions of each tree so far
        self._evaluated: Counter[str] = Counter()  # number of edits, by inserted branch
        self._improved: Counter[str] = Counter()  # number of them that improved the tree
        self._advised: set[tuple[object, ...]] = set()  # `_change` of edits, accepted or refused

    # Measurements of the run.

    def on_generation(self, generation: GenerationView) -> None:
        """See `GenerationListener`."""
        self._remember_edits(generation)
        self._latest = generation
        counters = dict.fromkeys(r.counter for r in self.requirements)
        for individual in generation.individuals:
            names = set(WORD.findall(individual.tree))
            actions = names & self.context.schema.vocabulary.actions.keys()
            self._seen.append((actions, individual))
            for counter in counters:
                if individual.counters[counter] > 0:
                    self._examples.setdefault(counter, []).append(individual)
        for counter, examples in self._examples.items():
            order = sorted(examples, key=lambda i: (-i.counters[counter], i.nodes))
            distinct = {i.tree: i for i in reversed(order)}
            self._examples[counter] = [*distinct.values()][::-1][:EXAMPLES]

    def _remember_edits(self, generation: GenerationView) -> None:
        """Remembers edits of the record and what they improved, so a resumed run does the same.

        They refer to individuals of the generation before.
        """
        if self._latest is not None and generation.guidance is not None:
            trees = {i.id: i.tree for i in self._latest.individuals}
            edits = generation.guidance.edits
            self._advised |= {_change(trees[e.of], e) for e in edits if e.of in trees}
            accepted = [edit for edit in edits if not edit.refused]
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
        return Guidance(
            mutation_rate=wanted_rate(state, settings),
            tree=None,
            source=self.name,
            phase=classify_phase(state, settings),
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
                branches = self.branches_for(counter, rng)
                individual = self.individual_to_edit(view, best, rng)
                untried[counter] = self._untried(individual, branches, requirement, advised)
            if (edit := next(untried[counter], None)) is not None:
                edits.append((counter, edit))
        return edits

    def _untried(
        self,
        individual: IndividualRecord,
        branches: Mapping[Node, str],
        requirement: Requirement,
        advised: set[tuple[object, ...]],
    ) -> Iterator[Edit]:
        """Edits that add branches to an individual's tree and are not in `advised`, then added."""
        for branch, source in branches.items():
            for edit in self._edits_with(individual, branch, source, requirement):
                change = _change(individual.tree, as_record(edit, ""))
                if change not in advised:
                    advised.add(change)
                    yield edit

    def requirements_to_edit_for(self, fittest: IndividualRecord) -> list[Requirement]:
        """The requirement of each edit, in order; control arms override it.

        These are the unmet requirements, repeated, as one may need several edits: of each counter
        the easiest, sorted by milestone, the easiest first; then by the share of the bound that is
        reached, the lowest first; then as `classes.hardest`.
        """
        counters, classes = fittest.counters, self.context.classes
        missed = {r.counter: r for r in reversed(self.requirements) if not r.met(counters)}
        hardest = [classes.behaviours[name] for name in classes.hardest]

        def order(r: Requirement) -> tuple[int, float, int, int]:
            share = counters[r.counter] / r.value if r.value > 0 else 0.0
            rank = hardest.index(r.counter) if r.counter in hardest else len(hardest)
            return r.milestone, share, rank, self.requirements.index(r)

        return sorted(missed.values(), key=order) * self.context.edits

    def individual_to_edit(
        self, view: GenerationView, fittest: IndividualRecord, rng: np.random.Generator
    ) -> IndividualRecord:
        """The individual to edit; control arms override it."""
        del view, rng
        return fittest

    def branches_for(self, counter: str, rng: np.random.Generator) -> Mapping[Node, str]:
        """Branches for a counter, each with its source in words; control arms override it.

        Those whose edits improved a tree most often come first.
        """
        del rng
        sources = self.candidates(counter)

        def success_rate(branch: Node) -> float:
            """The share of the branch's edits that improved a tree; 1/2 without edits."""
            text = to_text(branch)
            return (self._improved[text] + 1) / (self._evaluated[text] + 2)

        return {b: sources[b] for b in sorted(sources, key=success_rate, reverse=True)}

    def candidates(self, counter: str) -> dict[Node, str]:
        """Branches that may raise a counter: of the library, then of trees of the run.

        One that occurs several times has the place of the last and the source of the first.
        """
        found = [*self._library_branches(counter), *self._evaluated_branches(counter)]
        sources = dict(reversed(found))
        return {branch: sources[branch] for branch in reversed(sources)}

    def _library_branches(self, counter: str) -> Iterator[tuple[Node, str]]:
        """The first guarded branch of each library tree for the counter's behaviours."""
        behaviours = [b for b, name in self.context.classes.behaviours.items() if name == counter]
        names = [name for b in behaviours for name in self.library.targets.get(b, ())]
        for name in dict.fromkeys(names):
            for branch in library_branches([self.library.trees[name]])[0]:
                yield branch, f"library tree {name}"

    def _evaluated_branches(self, counter: str) -> list[tuple[Node, str]]:
        """Guarded branches with the action most typical of a counter, the smallest first."""
        number = Counter(a for actions, _ in self._seen for a in actions)
        shown = Counter(a for actions, i in self._seen if i.counters[counter] > 0 for a in actions)
        if not shown:
            return []
        action = max(shown, key=lambda a: (shown[a] / number[a], a))
        branches = [
            (branch, f"individual {i.id}")
            for i in self._examples[counter]
            for branch in branches_of(parse(i.tree, self.context.schema.vocabulary))
            if branch.guard and any(node.action == action for node in walk(branch))
        ]
        return sorted(branches, key=lambda pair: size(pair[0]))

    @cached_property
    def library(self) -> Library:
        """The run's library; loaded late, as the search for a missing library takes seconds."""
        return self.context.library()

    def _edits_with(
        self, individual: IndividualRecord, branch: Node, source: str, requirement: Requirement
    ) -> Iterator[Edit]:
        """Edits that insert a branch: at the place for its guard, and in front of the whole tree.

        If the tree already has the branch, there is one edit, which widens its guard, or none.
        """
        vocabulary = self.context.schema.vocabulary
        tree = parse(individual.tree, vocabulary)
        count = individual.counters[requirement.counter]
        reason = f"{requirement.counter} {count:g}, wanted {requirement}"
        alike = [(p, n) for p, n in nodes_with_paths(tree) if n.guard and branch.guard]
        present = next(((p, n) for p, n in alike if n.children == branch.children), None)
        if present is not None:
            path, guard = present
            number = widened(guard_of(guard).condition, vocabulary)
            if number is not None:
                reason = f"{reason}: a wider guard"
                yield Edit("number", individual.id, path_text(path), number=number, reason=reason)
            return
        reason = f"{reason}: a branch of {source}"
        place = place_for(tree, branch, vocabulary)
        if place is not None and place > 0:
            # "front" inserts before the child at the place; after the last child there is none.
            kind = "insert" if place == len(tree.children) else "front"
            yield Edit(kind, individual.id, str(place), branch, reason=reason)
        yield Edit("front", individual.id, branch=branch, reason=reason)  # before the root


def _change(tree: str, edit: EditRecord) -> tuple[object, ...]:
    """What an edit changes in a tree."""
    return tree, edit.kind, edit.at, edit.branch, edit.number


def width(expr: ConditionExpr, vocabulary: Vocabulary) -> float:
    """Share of blackboards on which a condition holds, in [0, 1], for uniformly distributed values.

    A flag and a comparison of two keys hold on half of them. A joined condition is estimated from
    its parts: `and` by the narrowest, `or` by the widest, as the parts may depend on each other.
    """
    if not isinstance(expr, Condition):
        parts = [width(part, vocabulary) for part in expr.parts]
        if expr.word == "not":
            return 1 - parts[0]
        return min(parts) if expr.word == "and" else max(parts)
    if expr.operator in ("is", "not") or not expr.single:
        return 0.5
    key = vocabulary.keys[expr.key]
    if key.words:
        return 1 / len(key.words) if expr.operator == "==" else 1 - 1 / len(key.words)
    below = min(1.0, max(0.0, (expr.number - key.low) / (key.high - key.low)))
    equal = min(1.0, key.step / (key.high - key.low))
    shares = {"<": below, ">": 1 - below, "=": equal, "!": 1 - equal}
    return shares[expr.operator[0]]


def guard_width(branch: Node, vocabulary: Vocabulary) -> float:
    """The width of a branch's guard, in [0, 1]; 1 without a guard."""
    return width(branch.guard.condition, vocabulary) if branch.guard else 1.0


def place_for(tree: Node, branch: Node, vocabulary: Vocabulary) -> int | None:
    """The index at which to insert a branch among the root's children.

    It is inserted before the first child with an equally wide or wider guard. None if the root is
    not a selector.
    """
    if not is_selector(tree):
        return None
    width = guard_width(branch, vocabulary)
    wider = (k for k, c in enumerate(tree.children) if guard_width(c, vocabulary) >= width)
    return next(wider, len(tree.children))


def widened(expr: ConditionExpr, vocabulary: Vocabulary) -> float | None:
    """The number of a comparison, moved so that it holds more often.

    None for another condition, and if the number is at the end of the key's range.
    """
    if not isinstance(expr, Condition) or not expr.single:
        return None
    if expr.operator not in ("<", "<=", ">", ">="):
        return None
    key = vocabulary.keys[expr.key]
    step = WIDENING_STEP * (key.high - key.low) * (1 if expr.operator in ("<", "<=") else -1)
    number = fine(expr.number + step, key)
    return None if number == expr.number else number
