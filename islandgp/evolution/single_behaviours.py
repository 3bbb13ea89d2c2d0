"""Searches a tree for each single behaviour: a library for domains without one.

The search maximises the behaviour's counter alone, then removes nodes that the counter does not
depend on. It is the same for every seed of a sweep.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from math import inf
from statistics import fmean
from typing import Final

from islandgp.bt.analysis.simplify import simplify
from islandgp.bt.core.kinds import kind_of
from islandgp.bt.core.language import to_text
from islandgp.bt.core.node import Limits, Node, replace_at, size, spliced, walk, within
from islandgp.domain import Outcome
from islandgp.evaluation.base import Evaluator, evaluated
from islandgp.gp.random_trees import TreeSpace, random_tree
from islandgp.gp.selection import by_rank
from islandgp.gp.variation import CROSSOVERS, MutationSettings, mutate
from islandgp.scoring.classes import Classes
from islandgp.seeding import Rng, Stream, seed_of, stream

COMPACT: Final = Limits(max_depth=4, max_nodes=12)  # section 2.4.6: trees of about ten nodes
POOL: Final = 200  # random trees at the start
ROUNDS: Final = 15  # of variation, per behaviour
CHILDREN: Final = 30  # per round
PARENTS: Final = 40  # the best trees so far, from which parents are drawn by rank
WORLDS: Final = 2  # per tree
POOL_SHARE: Final = 0.4  # of limited episodes, for the trees at the start
PRUNING_SHARE: Final = 0.2  # of a behaviour's limited episodes, to shorten its tree

Score = tuple[float, int, float, int]


def single_behaviours(
    classes: Classes,
    space: TreeSpace,
    mutation: MutationSettings,
    evaluator: Evaluator,
    stages: Sequence[int],
    *,
    most: float = inf,
) -> Iterator[tuple[int, str, Node | None, int]]:
    """Searches a compact tree for each behaviour, in a stage after the other until it is found.

    Args:
        classes: with the behaviours and their counters.
        space: the trees to search, within COMPACT.
        mutation: the mutations.
        evaluator: runs about 200 episodes a stage, and 500 per behaviour, in each of WORLDS worlds.
        stages: indices of the curriculum's stages that score the episodes.
        most: episodes at most, in equal parts of the stages that are left. Of a stage's, the first
            trees take up to POOL_SHARE, and each behaviour an equal part of the rest.

    Yields:
        For each behaviour that is searched in a stage: the stage, the behaviour, the tree, or None
        if no tree shows it, and the episodes so far.

    Raises:
        EvaluationError: an episode failed.
    """
    limits = Limits(
        min(COMPACT.max_depth, space.limits.max_depth),
        min(COMPACT.max_nodes, space.limits.max_nodes),
    )
    space = replace(space, limits=limits)
    pool = [random_tree(stream(0, Stream.LIBRARY, slot=i), space) for i in range(POOL)]
    found, episodes = dict[str, Node](), 0
    for place, stage in enumerate(stages):
        missing = {b: n for n, b in enumerate(classes.behaviours, 1) if b not in found}
        if not missing:
            return
        share = (most - episodes) / (len(stages) - place)
        tried = _Tried(evaluator, stage, classes, POOL_SHARE * share)
        tried.run([*found.values(), *pool])
        for behaviour, number in missing.items():
            part = (1 - POOL_SHARE) * share / len(missing)
            tried.most += (1 - PRUNING_SHARE) * part
            for r in range(ROUNDS):
                # A tree found for one behaviour may be a step towards another one.
                if tried.is_spent():
                    break
                parents = tried.best(behaviour)[:PARENTS]
                draws = (
                    stream(0, Stream.LIBRARY, generation=number, slot=r * CHILDREN + i)
                    for i in range(CHILDREN)
                )
                tried.run([_child(rng, parents, space, mutation) for rng in draws])
            tried.most += PRUNING_SHARE * part
            best = [tried.pruned(t, behaviour, space) for t in tried.best(behaviour)[:1]]
            tree = next((t for t in best if tried.score(t, behaviour)[0] > 0), None)
            if tree is not None:
                found[behaviour] = tree
            yield stage, behaviour, tree, episodes + tried.episodes
        episodes += tried.episodes


def _child(rng: Rng, parents: Sequence[Node], space: TreeSpace, mutation: MutationSettings) -> Node:
    """A mutant of a parent, or of a crossover of two."""
    first, second = by_rank(rng, parents), by_rank(rng, parents)
    tree = CROSSOVERS["subtree"](rng, first, second, space.limits) if rng.random() < 0.5 else first
    return mutate(rng, tree, rate=0.8, space=space, settings=mutation)[0]


class _Tried:
    """Trees with their outcomes, each evaluated once, in at most `most` episodes."""

    def __init__(self, evaluator: Evaluator, stage: int, classes: Classes, most: float) -> None:
        self.most = most
        self._evaluator = evaluator
        self._stage = stage
        self._classes = classes
        self._worlds = [seed_of(0, Stream.LIBRARY, slot=POOL + i) for i in range(WORLDS)]
        self._outcomes: dict[Node, list[Outcome]] = {}

    def best(self, behaviour: str) -> list[Node]:
        """All trees so far, the best first; equals in the order in which they were tried."""
        return sorted(self._outcomes, key=lambda t: self.score(t, behaviour), reverse=True)

    def score(self, tree: Node, behaviour: str) -> Score:
        """Sort key: the behaviour's counter, few other behaviours, fitness, few nodes.

        For trees without the behaviour other behaviours count positively, as steps towards it.
        """
        outcomes = self._outcomes[tree]
        counters = self._classes.behaviours
        others = sum(
            any(o.counters[counter] > 0 for o in outcomes)
            for name, counter in counters.items()
            if name != behaviour
        )
        counted = fmean(o.counters[counters[behaviour]] for o in outcomes)
        return (
            counted,
            -others if counted else others,
            fmean(o.fitness for o in outcomes),
            -size(tree),
        )

    def pruned(self, tree: Node, behaviour: str, space: TreeSpace) -> Node:
        """The smallest tree, by removing single branches, whose counter is no lower."""
        minimum = self.score(tree, behaviour)[0]
        smaller = [simplify(tree, space.vocabulary).tree]
        while True:
            self.run(smaller)
            known = [t for t in smaller if t in self._outcomes]
            successes = [t for t in known if self.score(t, behaviour)[0] >= minimum]
            if not successes:
                return tree
            tree = min(successes, key=lambda t: (size(t), to_text(t)))
            minimum = self.score(tree, behaviour)[0]
            smaller = [t for t in _smaller(tree) if within(t, space.limits)]

    @property
    def episodes(self) -> int:
        """Episodes so far."""
        return WORLDS * len(self._outcomes)

    def is_spent(self) -> bool:
        """True if no tree can be evaluated, or none was."""
        return not self._outcomes or self.most / WORLDS - len(self._outcomes) < 1

    def run(self, trees: Sequence[Node]) -> None:
        """Evaluates the trees that were not evaluated before, as far as episodes are left."""
        new = [tree for tree in dict.fromkeys(trees) if tree not in self._outcomes]
        left = self.most / WORLDS - len(self._outcomes)
        new = new[: int(min(len(new), max(0, left)))]
        outcomes = evaluated(self._evaluator, new, self._stage, self._worlds)
        self._outcomes |= zip(new, outcomes, strict=True)


def _smaller(tree: Node) -> Iterator[Node]:
    """The trees with one branch removed, or an inner node replaced by one of its children.

    A node keeps the fewest children of its kind, such as two of a `recovery`.
    """
    for i, node in enumerate(walk(tree)):
        for at, child in enumerate(node.children):
            yield replace_at(tree, i, child)
            if len(node.children) > kind_of(node).children[0]:
                yield replace_at(tree, i, spliced(node, at, 1))
