"""A tree as a state machine: its nodes by number, and the outcomes of nodes that start.

The semantics are those of docs/semantics.md, as in `engine`. But an action may return any of its
statuses. So a `Machine` computes the blackboards on which a node that starts can end its first tick
with a status (`Outcomes`). `moves` enumerates single ticks.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import cache

from islandgp.bt.analysis.context import leaf_statuses, root_context
from islandgp.bt.core.condition import ConditionExpr, opposite
from islandgp.bt.core.kinds import advance_status, is_opaque, kind_of
from islandgp.bt.core.node import FAILURE, RUNNING, SUCCESS, Node, ParallelArgs, count_of
from islandgp.bt.core.parameters import STATUSES
from islandgp.bt.core.vocabulary import Vocabulary
from islandgp_verify.board_outcomes import Outcomes, parallel_outcomes, repeated, turned
from islandgp_verify.boards import ANY_BOARD, NO_BOARD, Boards, BoardSets


class Machine:
    """The state machine of a tree. Nodes are numbered in document order.

    If `sets.exact` is False, its sets of blackboards may be too large.
    """

    def __init__(self, tree: Node, vocabulary: Vocabulary, sets: BoardSets) -> None:
        self.sets = sets
        self.nodes: list[Node] = []
        self.children: list[tuple[int, ...]] = []
        self._number(tree)
        conditions = {
            place: node.guard.condition for place, node in enumerate(self.nodes) if node.guard
        }
        context = root_context(tree, vocabulary)

        def boards(expr: ConditionExpr) -> Boards:
            return sets.of(expr) if context.facts(expr) else ANY_BOARD  # it may have changed

        self.holds = {place: boards(each) for place, each in conditions.items()}
        self.fails = {place: boards(opposite(each)) for place, each in conditions.items()}
        self.observed = {
            place: tuple(self._observed(place)) if kind_of(node).remembers_branch else ()
            for place, node in enumerate(self.nodes)
            if kind_of(node).advance_status is not None
        }
        """The observed guards of each composite, each with its branch."""
        self.statuses = {
            place: leaf_statuses(node, vocabulary) or STATUSES
            for place, node in enumerate(self.nodes)
            if not node.children
        }
        self.fresh: Callable[[int], Outcomes] = cache(self._outcomes)
        """The outcomes of a node that starts."""

    def _number(self, node: Node) -> int:
        place = len(self.nodes)
        self.nodes.append(node)
        self.children.append(())
        self.children[place] = tuple([self._number(child) for child in node.children])
        return place

    def guards(self, place: int) -> Iterator[int]:
        """The guards of a branch, down to its first composite or action; as `guard_chain`."""
        while kind_of(self.nodes[place]).decorates:
            if self.nodes[place].guard:
                yield place
            place = self.children[place][0]

    def _observed(self, place: int) -> Iterator[tuple[int, int]]:
        for branch, child in enumerate(self.children[place][:-1]):
            for guard in self.guards(child):
                args = self.nodes[guard].guard
                if args and args.interrupts:
                    yield branch, guard

    def _outcomes(self, place: int) -> Outcomes:
        node, children = self.nodes[place], self.children[place]
        kind = kind_of(node)
        if not children:
            statuses = self.statuses[place]
            return int(FAILURE in statuses), int(SUCCESS in statuses), int(RUNNING in statuses)
        each = [self.fresh(child) for child in children]
        if node.guard:
            return self.guarded(place, each[0])
        if is_opaque(node):
            return ANY_BOARD, ANY_BOARD, ANY_BOARD
        if kind.delayed:
            return NO_BOARD, NO_BOARD, ANY_BOARD
        if kind.counts is not None:
            return repeated(self.sets, node, each[0], last=count_of(node) == 1)
        if kind.decorates:
            return turned(self.sets, node, each[0])
        if isinstance(node.args, ParallelArgs):
            return parallel_outcomes(self.sets, node.args, each)
        advance, outcomes = advance_status(node), list(each[-1])
        for first in reversed(each[:-1]):
            outcomes = [self.sets.both(first[advance], boards) for boards in outcomes]
            for status in (1 - advance, RUNNING):
                outcomes[status] = self.sets.either(outcomes[status], first[status])
        return outcomes[0], outcomes[1], outcomes[2]

    def guarded(self, place: int, child: Outcomes) -> Outcomes:
        """The outcomes of a guard that asks its condition, from those of its child."""
        failure, success, running = (self.sets.both(self.holds[place], each) for each in child)
        return self.sets.either(failure, self.fails[place]), success, running

    def either(self, one: Outcomes, other: Outcomes) -> Outcomes:
        """The outcomes that are in one of the two."""
        either = self.sets.either
        return either(one[0], other[0]), either(one[1], other[1]), either(one[2], other[2])
