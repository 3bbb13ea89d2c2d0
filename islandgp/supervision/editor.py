"""A supervisor by rules that edits living trees: what does the fittest robot lack, who has it?

It goes by what the run has measured, so it works in any domain. Tiers ask for counters. For a
counter of which the fittest tree has too little a branch is looked for: in the library, by what its
trees are for, and in trees that had the counter above 0, by the action that goes with it. The
branch is put where its guard belongs, the narrowest guard first.
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

from islandgp.bt.core.condition import Condition, ConditionExpr
from islandgp.bt.core.kinds import kind_of
from islandgp.bt.core.language import parse, to_text
from islandgp.bt.core.node import FAILURE, Node, guard_of, size, walk
from islandgp.bt.core.vocabulary import Vocabulary
from islandgp.gp.branches import branches_of, fine
from islandgp.gp.edits import Edit, Path, nodes_with_paths, written
from islandgp.gp.record import IndividualRecord
from islandgp.scoring.classes import Classes
from islandgp.scoring.constraints import Constraints, merit, violation
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

WIDER: Final = 0.15  # by which a guard is widened, as a share of its key's range
DONORS: Final = 5  # trees for each counter whose branches are looked at
Key = tuple[str, str, str | None, float | None]
"""Kind, place, branch and number of an edit."""
WORD: Final = re.compile(r"\w+")


class EditorSettings(ExpertSettings, frozen=True, extra="forbid"):
    """The expert's rates, and where branches come from."""

    sources: tuple[Literal["library", "archive"], ...] = Field(("library", "archive"), min_length=1)
    """Where branches are looked for, in this order; archive: trees that the run has evaluated."""


@dataclass(frozen=True, slots=True)
class Requirement:
    """What a tier asks of one counter."""

    counter: str
    value: float  # the least, or what it must exceed
    exceeds: bool  # whether the value itself is too little
    milestone: int  # index of the easiest milestone that asks for it; of none: their number

    def __str__(self) -> str:
        """For people: `at least 2`."""
        return f"{'more than' if self.exceeds else 'at least'} {self.value:g}"

    def met(self, counters: Mapping[str, float]) -> bool:
        """Whether these counters are enough."""
        found = counters[self.counter]
        return found > self.value if self.exceeds else found >= self.value


def requirements(classes: Classes) -> tuple[Requirement, ...]:
    """What the milestones' tiers ask of counters, those of the easiest first, each once.

    Then that each behaviour is shown: tiers may ask for nothing but points.
    """
    found: list[Requirement] = []
    for k, milestone in enumerate(classes.milestones):
        for tier in (classes.tiers[name] for name in reversed(classes.needed(milestone))):
            for exceeds, asked in ((False, tier.at_least), (True, tier.above)):
                found += [Requirement(c, value, exceeds, k) for c, value in asked.items()]
    last = len(classes.milestones)
    found += [Requirement(c, 0.0, True, last) for c in classes.behaviours.values()]
    once = {(r.counter, r.value, r.exceeds): r for r in reversed(found) if r.counter != "fitness"}
    return tuple(r for r in found if r in once.values())


@dataclass(frozen=True, slots=True)
class Branch:
    """A branch that may be put into a tree."""

    node: Node
    source: str  # for people, e.g. "library tree single_charging"


def width(expr: ConditionExpr, vocabulary: Vocabulary) -> float:
    """Share of the blackboards on which a condition holds, if values were spread evenly.

    A flag holds on half of them. In [0, 1].
    """
    if not isinstance(expr, Condition):
        parts = [width(part, vocabulary) for part in expr.parts]
        if expr.word == "not":
            return 1 - parts[0]
        return min(parts) if expr.word == "and" else max(parts)
    key = vocabulary.keys[expr.key]
    if expr.operator in ("is", "not"):
        return 0.5
    below = min(1.0, max(0.0, (expr.number - key.low) / (key.high - key.low)))
    equal = min(1.0, key.step / (key.high - key.low))
    return {"<": below, "<=": below, ">": 1 - below, ">=": 1 - below, "==": equal, "!=": 1 - equal}[
        expr.operator
    ]


def urgency(branch: Node, vocabulary: Vocabulary) -> float:
    """How far in front a branch belongs: the width of its guard, 1 without one; least first."""
    return width(branch.guard.condition, vocabulary) if branch.guard else 1.0


def place_for(tree: Node, branch: Node, vocabulary: Vocabulary) -> int | None:
    """The index among the root's children at which a branch belongs; None: the root is no selector.

    It stands before the first child whose guard is as wide, or wider.
    """
    if kind_of(tree).hands_over != FAILURE:
        return None
    wide = urgency(branch, vocabulary)
    wider = (k for k, child in enumerate(tree.children) if urgency(child, vocabulary) >= wide)
    return next(wider, len(tree.children))


def guard_above(tree: Node, branch: Node) -> tuple[Path, Node] | None:
    """The path and the node of the first guard in a tree that guards what a branch guards."""
    if not branch.guard:
        return None
    for path, node in nodes_with_paths(tree):
        if node.guard and node.children == branch.children:
            return path, node
    return None


def widened(expr: ConditionExpr, vocabulary: Vocabulary) -> float | None:
    """The number of a single comparison, moved so that it holds more often; None: it cannot be."""
    if not isinstance(expr, Condition) or expr.operator not in ("<", "<=", ">", ">="):
        return None
    key = vocabulary.keys[expr.key]
    by = WIDER * (key.high - key.low) * (1 if expr.operator in ("<", "<=") else -1)
    number = fine(expr.number + by, key)
    return None if number == expr.number else number


def best_of(individuals: Sequence[IndividualRecord], constraints: Constraints) -> IndividualRecord:
    """The fittest of those that keep all constraints; if there is none, the one that breaks least.

    Of equals the first.
    """
    return max(individuals, key=lambda i: merit(i.fitness, violation(i.counters, constraints)))


class Editor:
    """See the module. Deterministic, but for the controls that draw."""

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
        self._now: GenerationView | None = None
        self._donors: dict[str, list[IndividualRecord]] = {}  # by counter, the most counts first
        self._with: Counter[tuple[str, str]] = Counter()  # trees by counter they have, and action
        self._all: Counter[str] = Counter()  # trees by action
        self._tried: Counter[str] = Counter()  # edits by the branch that they put in
        self._gained: Counter[str] = Counter()  # those that were better than the tree before
        self._done: set[tuple[str, Key]] = set()  # the edits that were taken, by tree

    # What the run has measured.

    def on_generation(self, generation: GenerationView) -> None:
        """See `GenerationListener`."""
        self._learn(generation)
        self._now = generation
        counters = dict.fromkeys(r.counter for r in self.requirements)
        for i in generation.individuals:
            actions = set(WORD.findall(i.tree)) & self.context.schema.vocabulary.actions.keys()
            self._all.update(actions)
            for counter in counters:
                if i.counters[counter] > 0:
                    self._with.update((counter, action) for action in actions)
                    self._donors.setdefault(counter, []).append(i)
        for counter, donors in self._donors.items():
            order = sorted(donors, key=lambda i: (-i.counters[counter], i.nodes))
            self._donors[counter] = list({i.tree: i for i in reversed(order)}.values())[::-1]
            del self._donors[counter][DONORS:]

    def _learn(self, generation: GenerationView) -> None:
        """Which edits were taken, and which branches made a tree better in the same world."""
        if self._now is None or generation.guidance is None:
            return
        trees = {i.id: i.tree for i in self._now.individuals}
        made = [edit for edit in generation.guidance.edits if not edit.refused]
        for edit, trial in zip(made, generation.trials, strict=False):
            if edit.of in trees:
                self._done.add((trees[edit.of], (edit.kind, edit.at, edit.branch, edit.number)))
            if edit.branch is not None:
                self._tried[edit.branch] += 1
                self._gained[edit.branch] += trial.fitness > trial.parent_fitness

    # What is advised.

    def advise(self, state: PopulationState, rng: np.random.Generator) -> Guidance:
        """The expert's rate, and edits of the best tree."""
        seen, how = self._now, self.settings
        found: list[tuple[str, Edit]] = []
        if seen is not None and seen.snapshot.generation == state.now.generation:
            found = self.edits(seen, rng)
        phase = classify_phase(state, how)
        return Guidance(
            mutation_rate=wanted_rate(state, how),
            tree=None,
            source=self.name,
            phase=phase,
            pattern=classify_pattern(state, how),
            reasoning="; ".join(edit.reason for _, edit in found) or "nothing to edit",
            notes={"counters": " ".join(counter for counter, _ in found)} if found else {},
            edits=tuple(edit for _, edit in found),
        )

    def edits(self, seen: GenerationView, rng: np.random.Generator) -> list[tuple[str, Edit]]:
        """At most as many as the run takes, each with the counter that it is for."""
        fittest = best_of(seen.individuals, self.context.constraints)
        each: dict[str, Iterator[Edit]] = {}
        found: list[tuple[str, Edit]] = []
        for r in self.wanted(fittest):
            if len(found) == self.context.edits:
                break
            if r.counter not in each:
                branches = self.branches(r.counter, rng)
                each[r.counter] = self.new(self.tree(seen, fittest, rng), branches, r)
            if (edit := next(each[r.counter], None)) is not None:
                found.append((r.counter, edit))
        return found

    def new(
        self, i: IndividualRecord, branches: Sequence[Branch], r: Requirement
    ) -> Iterator[Edit]:
        """The edits that put these branches into a tree, without those that it had already."""
        done = {edit for tree, edit in self._done if tree == i.tree}
        for edit in (edit for branch in branches for edit in self.ways(i, branch, r)):
            text = None if edit.branch is None else to_text(edit.branch)
            if (key := (edit.kind, edit.at, text, edit.number)) not in done:
                done.add(key)
                yield edit

    def wanted(self, fittest: IndividualRecord) -> list[Requirement]:
        """What the edits are for, in turn; controls ask for something else."""
        return self.unmet(fittest) * self.context.edits

    def unmet(self, i: IndividualRecord) -> list[Requirement]:
        """What a tree does not meet: of the easiest milestone first, the furthest away first."""
        missed = {r.counter: r for r in reversed(self.requirements) if not r.met(i.counters)}
        easiest = [r for r in self.requirements if missed.get(r.counter) is r]
        hardest = [self.context.classes.behaviours[name] for name in self.context.classes.hardest]

        def order(r: Requirement) -> tuple[int, float, int]:
            share = i.counters[r.counter] / r.value if r.value > 0 else 0.0
            rank = hardest.index(r.counter) if r.counter in hardest else len(hardest)
            return r.milestone, share, rank

        return sorted(easiest, key=order)

    def tree(
        self, seen: GenerationView, fittest: IndividualRecord, rng: np.random.Generator
    ) -> IndividualRecord:
        """The individual that is edited; controls take another one."""
        del seen, rng
        return fittest

    def branches(self, counter: str, rng: np.random.Generator) -> list[Branch]:
        """Branches for a counter, each once, the most promising first; controls draw others."""
        del rng
        found = self.known(counter)

        def promise(branch: Branch) -> float:
            text = to_text(branch.node)
            return (self._gained[text] + 1) / (self._tried[text] + 2)

        return sorted(found, key=promise, reverse=True)

    def known(self, counter: str) -> list[Branch]:
        """Branches that should raise a counter, in the order of the sources."""
        of = {"library": self._of_library, "archive": self._of_archive}
        found = [branch for source in self.settings.sources for branch in of[source](counter)]
        return list({branch.node: branch for branch in reversed(found)}.values())[::-1]

    def _of_library(self, counter: str) -> list[Branch]:
        """The first guarded branch of each library tree for the counter's behaviours."""
        behaviours = [b for b, name in self.context.classes.behaviours.items() if name == counter]
        names = [name for b in behaviours for name in self.library.targets.get(b, ())]
        return [
            Branch(branch, f"library tree {name}")
            for name in dict.fromkeys(names)
            for branch in library_branches([self.library.trees[name]])[0]
        ]

    def _of_archive(self, counter: str) -> list[Branch]:
        """Guarded branches with the action that goes with a counter, the smallest first."""
        shown = [action for name, action in self._with if name == counter]
        if not shown:
            return []
        action = max(shown, key=lambda a: (self._with[counter, a] / self._all[a], a))
        found = [
            Branch(branch, f"individual {i.id}")
            for i in self._donors[counter]
            for branch in branches_of(parse(i.tree))
            if branch.guard and any(node.action == action for node in walk(branch))
        ]
        return sorted(found, key=lambda branch: size(branch.node))

    @cached_property
    def library(self) -> Library:
        """The run's library; to find one may take a while."""
        return self.context.library()

    def ways(self, i: IndividualRecord, branch: Branch, r: Requirement) -> Iterator[Edit]:
        """The edits that put a branch where its guard belongs, or in front of the whole tree.

        Where the tree has the branch already, its guard is widened instead.
        """
        tree, words = parse(i.tree), self.context.schema.vocabulary
        why = f"{r.counter} {i.counters[r.counter]:g}, wanted {r}"
        if (own := guard_above(tree, branch.node)) is not None:
            at, number = written(own[0]), widened(guard_of(own[1]).condition, words)
            if number is not None:
                yield Edit("number", i.id, at, number=number, reason=f"{why}: a wider guard")
            return
        why = f"{why}: a branch of {branch.source}"
        place = place_for(tree, branch.node, words)
        if place is not None and place > 0:
            kind = "insert" if place == len(tree.children) else "front"
            yield Edit(kind, i.id, str(place), branch.node, reason=why)
        yield Edit("front", i.id, branch=branch.node, reason=why)
