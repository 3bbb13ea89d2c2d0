"""A tree as a state machine: the memory of its nodes between ticks, and the outcomes of a tick.

The semantics are those of docs/semantics.md, as in `engine`. But here the memory of a node is a
value, and an action may return any of its statuses. So a `Machine` computes the blackboards on
which a node can end a tick with a status (`Outcomes`), and those on which a tick reaches a node.
`moves` enumerates single ticks.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cache, partial
from typing import Final, NamedTuple, TypeAlias

from islandgp.bt.analysis.context import leaf_statuses, root_context
from islandgp.bt.core.condition import ConditionExpr, opposite
from islandgp.bt.core.kinds import advance_status, is_opaque, kind_of
from islandgp.bt.core.node import FAILURE, RUNNING, SUCCESS, Node, ParallelArgs, count_of
from islandgp.bt.core.vocabulary import STATUSES, Vocabulary
from islandgp_verify.board_outcomes import Outcomes, parallel_outcomes, repeated, turned
from islandgp_verify.boards import ANY_BOARD, NO_BOARD, Boards, BoardSets

MAX_CACHED: Final = 300_000  # most outcomes in the cache

_NONE: Final[Outcomes] = (NO_BOARD, NO_BOARD, NO_BOARD)
_ENDED: Final[tuple[Outcomes, Outcomes]] = (
    (ANY_BOARD, NO_BOARD, NO_BOARD),
    (NO_BOARD, ANY_BOARD, NO_BOARD),
)


@dataclass(frozen=True, slots=True)
class ActionMemory:
    """Memory of a running action: empty."""


class BranchMemory(NamedTuple):
    """Memory of a running selector or sequence."""

    branch: int  # that is running
    memory: Memory  # of that branch
    known: tuple[bool | None, ...]
    """The value of each observed guard's condition in the last tick; None: not evaluated.

    For a guard of the running branch, True only means that it was evaluated: its condition is
    evaluated again when the branch ends.
    """


class RepeaterMemory(NamedTuple):
    """Memory of a running repeater."""

    remaining: float  # counted ends of its child until it ends, >= 1
    memory: Memory | None  # of its child; None: the next tick starts it


class ParallelMemory(NamedTuple):
    """Memory of a running parallel."""

    memories: tuple[Memory | int, ...]  # of each child; the status of one that has ended


Memory: TypeAlias = ActionMemory | BranchMemory | RepeaterMemory | ParallelMemory
"""The memory of a running node. A decorator that does not count has that of its child."""


class TickTarget(NamedTuple):
    """A node that a tick should reach."""

    place: int
    branches: Mapping[int, int]  # by the place of each node above it: the child that leads there


class SpentError(Exception):
    """The machine has no steps left."""


class Machine:
    """The state machine of a tree. Nodes are numbered in document order.

    If `sets.exact` is False, its sets of blackboards may be too large.
    """

    def __init__(self, tree: Node, vocabulary: Vocabulary, sets: BoardSets) -> None:
        self.sets = sets
        self.steps_left = 0  # remaining steps; see `spend`
        self.nodes: list[Node] = []
        self.children: list[tuple[int, ...]] = []
        self.above: list[int] = []  # the place of each node's parent; -1 for the root
        self._number(tree, -1)
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
        self.fresh: Callable[[int], Outcomes] = cache(partial(self._outcomes, memory=None))
        """The outcomes of a node that starts."""
        self._resumed = cache(self._outcomes)
        self._from = cache(self._fresh_branches)
        self._ways: dict[tuple[int, int], list[Outcomes]] = {}
        self._cache_size = 0  # approximate number of outcomes in `_ways`
        self.target = cache(self._target)

    def _number(self, node: Node, above: int) -> int:
        place = len(self.nodes)
        self.nodes.append(node)
        self.children.append(())
        self.above.append(above)
        self.children[place] = tuple([self._number(child, place) for child in node.children])
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

    def _target(self, place: int) -> TickTarget:
        """The target for a node."""
        branches: dict[int, int] = {}
        child = place
        while (above := self.above[child]) >= 0:
            branches[above] = self.children[above].index(child)
            child = above
        return TickTarget(place, branches)

    def spend(self, steps: int = 1) -> None:
        """Subtract steps from `steps_left`. Raises SpentError if there are too few."""
        self.steps_left -= steps
        if self.steps_left < 0:
            raise SpentError

    # Outcomes of a tick

    def now(self, place: int, memory: Memory | int | None) -> Outcomes:
        """The outcomes of a node with a memory; None: it starts; a status: it has ended."""
        if memory is None:
            return self.fresh(place)
        if isinstance(memory, int):
            return _ENDED[memory]
        return self._resumed(place, memory)

    def fresh_from(self, place: int, branch: int) -> Outcomes:
        """The outcomes of a selector or sequence whose child of that index starts now."""
        return self._from(place)[branch]

    def _fresh_branches(self, place: int) -> list[Outcomes]:
        """`fresh_from` of each child."""
        by_branch: list[Outcomes] = []
        for child in reversed(self.children[place]):
            first = self.fresh(child)
            by_branch.append(self._go_on(place, first, by_branch[-1]) if by_branch else first)
        return by_branch[::-1]

    def guarded(self, place: int, child: Outcomes, *, fresh: bool) -> Outcomes:
        """The outcomes of a guard, from those of its child."""
        guard = self.nodes[place].guard
        if not fresh and guard and not guard.checks_itself:
            return child
        failure, success, running = self._and(self.holds[place], child)
        return self.sets.either(failure, self.fails[place]), success, running

    def repetition(self, place: int, memory: Memory | None) -> tuple[float, Memory | None]:
        """The remaining count of a node, and the memory of its child."""
        if memory is None:
            return count_of(self.nodes[place]), None
        assert isinstance(memory, RepeaterMemory)
        return memory

    def memories(self, place: int, memory: Memory | None) -> Sequence[Memory | int | None]:
        """The memories of the children of a parallel."""
        if memory is None:
            return [None] * len(self.children[place])
        assert isinstance(memory, ParallelMemory)
        return memory.memories

    def _outcomes(self, place: int, memory: Memory | None) -> Outcomes:
        node, children = self.nodes[place], self.children[place]
        kind = kind_of(node)
        if not children:
            statuses = self.statuses[place]
            return int(FAILURE in statuses), int(SUCCESS in statuses), int(RUNNING in statuses)
        if node.guard:
            return self.guarded(place, self.now(children[0], memory), fresh=memory is None)
        if is_opaque(node):
            return ANY_BOARD, ANY_BOARD, ANY_BOARD
        if kind.delayed:
            return NO_BOARD, NO_BOARD, ANY_BOARD
        if kind.counts is not None:
            remaining, inner = self.repetition(place, memory)
            return repeated(self.sets, node, self.now(children[0], inner), last=remaining == 1)
        if kind.decorates:
            return turned(self.sets, node, self.now(children[0], memory))
        if isinstance(node.args, ParallelArgs):
            each = self._of_children(place, self.memories(place, memory))
            return parallel_outcomes(self.sets, node.args, each)
        if memory is None:
            return self.fresh_from(place, 0)
        assert isinstance(memory, BranchMemory)
        outcomes = _NONE
        for branch, boards in self._turns(place, memory):
            if branch < memory.branch:
                rest = self.fresh_from(place, branch)
            else:
                rest = self.now(children[branch], memory.memory)
                if branch < len(children) - 1:
                    rest = self._go_on(place, rest, self.fresh_from(place, branch + 1))
            outcomes = self.either(outcomes, self._and(boards, rest))
        return outcomes

    def _of_children(self, place: int, memories: Sequence[Memory | int | None]) -> list[Outcomes]:
        """The outcomes of the children of a parallel."""
        pairs = zip(self.children[place], memories, strict=True)
        return [self.now(child, memory) for child, memory in pairs]

    def _go_on(self, place: int, first: Outcomes, rest: Outcomes) -> Outcomes:
        """The outcomes of a composite from those of a child and of the children after it."""
        advance = advance_status(self.nodes[place])
        outcomes = list(self._and(first[advance], rest))
        for status in (1 - advance, RUNNING):
            outcomes[status] = self.sets.either(outcomes[status], first[status])
        return outcomes[0], outcomes[1], outcomes[2]

    def _turns(self, place: int, memory: BranchMemory) -> Iterator[tuple[int, Boards]]:
        """The branches that a running composite may tick first, each with its blackboards.

        First the branches whose guards become true, then the running branch.
        """
        stays = ANY_BOARD
        for (branch, guard), known in zip(self.observed[place], memory.known, strict=True):
            if branch < memory.branch and known is False:
                yield branch, self.sets.both(stays, self.holds[guard])
                stays = self.sets.both(stays, self.fails[guard])
        yield memory.branch, stays

    def _and(self, boards: Boards, outcomes: Outcomes) -> Outcomes:
        failure, success, running = outcomes
        both = self.sets.both
        return both(boards, failure), both(boards, success), both(boards, running)

    def either(self, one: Outcomes, other: Outcomes) -> Outcomes:
        """The outcomes that are in one of the two."""
        either = self.sets.either
        return either(one[0], other[0]), either(one[1], other[1]), either(one[2], other[2])

    # Ticks that reach a node

    def reach(self, memory: Memory | None, target: TickTarget) -> Boards:
        """The blackboards on which a tick, with that memory of the root, can reach a target."""
        return self.sets.either(*self.outcomes_reaching(0, memory, target))

    def outcomes_reaching(
        self, place: int, memory: Memory | int | None, target: TickTarget
    ) -> Outcomes:
        """The outcomes of a node in the ticks that reach a target in it."""
        self.spend()
        if isinstance(memory, int):  # a parallel's child that has ended
            return _NONE
        if place == target.place:
            return self.now(place, memory)
        node, branch = self.nodes[place], target.branches[place]
        child = self.children[place][branch]
        kind = kind_of(node)
        if kind.concurrent:
            return self._parallel_reaching(place, self.memories(place, memory), target)
        if kind.advance_status is not None:
            if memory is None:
                return self.outcomes_from(place, 0, target)
            assert isinstance(memory, BranchMemory)
            return self._branch_reaching(place, memory, target)
        if kind.counts is not None:
            remaining, inner = self.repetition(place, memory)
            return repeated(
                self.sets, node, self.outcomes_reaching(child, inner, target), last=remaining == 1
            )
        inside = self.outcomes_reaching(child, memory, target)
        if node.guard is None:
            return turned(self.sets, node, inside)
        if memory is None or node.guard.checks_itself:
            return self._and(self.holds[place], inside)
        return inside

    def outcomes_from(self, place: int, at: int, target: TickTarget) -> Outcomes:
        """Outcomes of a selector or sequence whose child of index `at` starts now."""
        key = (place, target.place)
        if key not in self._ways:
            advance, branch = advance_status(self.nodes[place]), target.branches[place]
            *before, last = self.children[place][: branch + 1]
            self.spend(len(before))
            self._cache_size += len(before)
            if self._cache_size > MAX_CACHED:
                self._cache_size = 0
                self._ways.clear()
            outcomes = [self._behind(place, branch, self.outcomes_reaching(last, None, target))]
            for child in reversed(before):
                outcomes.append(self._and(self.fresh(child)[advance], outcomes[-1]))
            self._ways[key] = outcomes[::-1]
        return self._ways[key][at]

    def _behind(self, place: int, branch: int, first: Outcomes) -> Outcomes:
        """The outcomes of a composite whose branch reaches the target with the outcomes `first`."""
        if branch == len(self.children[place]) - 1:
            return first
        return self._go_on(place, first, self.fresh_from(place, branch + 1))

    def _branch_reaching(self, place: int, memory: BranchMemory, target: TickTarget) -> Outcomes:
        outcomes, target_branch = _NONE, target.branches[place]
        for at, boards in self._turns(place, memory):
            child = self.children[place][at]
            if at > target_branch:
                continue
            if at < memory.branch:
                reached = self.outcomes_from(place, at, target)
            elif at == target_branch:
                first = self.outcomes_reaching(child, memory.memory, target)
                reached = self._behind(place, at, first)
            else:
                ends = self.now(child, memory.memory)[advance_status(self.nodes[place])]
                reached = self._and(ends, self.outcomes_from(place, at + 1, target))
            outcomes = self.either(outcomes, self._and(boards, reached))
        return outcomes

    def _parallel_reaching(
        self, place: int, memories: Sequence[Memory | int | None], target: TickTarget
    ) -> Outcomes:
        children, branch = self.children[place], target.branches[place]
        args = self.nodes[place].args
        assert isinstance(args, ParallelArgs)
        self.spend(len(children))
        reached = self.outcomes_reaching(children[branch], memories[branch], target)
        child_outcomes = self._of_children(place, memories)
        child_outcomes[branch] = reached
        # Where the branch has no outcome, those of the others are irrelevant.
        return self._and(
            self.sets.either(*reached), parallel_outcomes(self.sets, args, child_outcomes)
        )
