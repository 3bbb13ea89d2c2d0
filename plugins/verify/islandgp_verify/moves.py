"""The possible moves of a tree in a tick, by the statuses that its actions return.

Trees with clocks, reactive composites or opaque nodes have other moves; rules of them are not
explored.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence, Set
from itertools import product
from typing import NamedTuple, TypeAlias

from islandgp.bt.core.condition import condition
from islandgp.bt.core.kinds import advance_status, kind_of
from islandgp.bt.core.node import FAILURE, RUNNING, ParallelArgs, count_of, guard_of
from islandgp_verify.board_outcomes import parallel_status
from islandgp_verify.machine import Machine

ActionCalls: TypeAlias = tuple[tuple[int, int], ...]
"""The statuses that the ticked actions return, by place."""


class ActionMemory(NamedTuple):
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


class Transition(NamedTuple):
    """A possible move of a node in a tick."""

    status: int
    memory: Memory | None  # None: it has ended
    calls: ActionCalls = ()
    checked: tuple[int, ...] = ()  # guards of the branch that were evaluated at its start


class SpentError(Exception):
    """The search has no steps left."""


class Search:
    """Enumerates ticks of a tree, with a limited number of steps: one for each called action."""

    def __init__(self, machine: Machine, steps: int) -> None:
        self._machine, self._steps_left = machine, steps

    def moves(self, memory: Memory | None, board: Sequence[float]) -> Iterator[Transition]:
        """The possible moves of the tree in a tick.

        Args:
            memory: of the root; None: it starts.
            board: the blackboard of the tick.

        Raises:
            SpentError: there are no steps left.
        """
        self.spend()
        return _Tick(self._machine, board, self).moves(0, memory)

    def spend(self) -> None:
        """Takes a step. Raises SpentError if there is none left."""
        self._steps_left -= 1
        if self._steps_left < 0:
            raise SpentError


class _Tick:
    """One tick, on one blackboard. Each method yields the moves of a node."""

    def __init__(self, machine: Machine, board: Sequence[float], search: Search) -> None:
        self._machine, self._board, self._search = machine, board, search
        self._truth: dict[int, bool] = {}

    def _holds(self, guard: int) -> bool:
        """True if the condition of a guard holds."""
        if guard not in self._truth:
            expr = guard_of(self._machine.nodes[guard]).condition
            self._truth[guard] = condition(expr, self._board, self._machine.sets.key_index)()
        return self._truth[guard]

    def moves(self, place: int, memory: Memory | None) -> Iterator[Transition]:
        """The moves of a node with a memory; None: it starts."""
        node = self._machine.nodes[place]
        kind = kind_of(node)
        if not node.children:
            return self._leaf(place)
        if node.guard:
            return self._guard(place, memory)
        if kind.counts is not None:
            return self._repeater(place, memory)
        if kind.decorates:
            return self._turned(place, memory)
        if kind.concurrent:
            return self._parallel(place, memory)
        return self._composite(place, memory)

    def _leaf(self, place: int) -> Iterator[Transition]:
        is_action = bool(self._machine.nodes[place].action)
        for status in sorted(self._machine.statuses[place], reverse=True):
            self._search.spend()
            calls = ((place, status),) if is_action else ()
            yield Transition(status, ActionMemory() if status == RUNNING else None, calls)

    def _turned(self, place: int, memory: Memory | None) -> Iterator[Transition]:
        ends = (*kind_of(self._machine.nodes[place]).ends, RUNNING)
        for move in self.moves(self._machine.children[place][0], memory):
            yield move._replace(status=ends[move.status])

    def _guard(self, place: int, memory: Memory | None) -> Iterator[Transition]:
        checked = (place,) if memory is None else ()
        checks = memory is None or guard_of(self._machine.nodes[place]).checks_itself
        if checks and not self._holds(place):
            yield Transition(FAILURE, None, checked=checked)
            return
        for move in self.moves(self._machine.children[place][0], memory):
            yield move._replace(checked=(*checked, *move.checked))

    def _repeater(self, place: int, memory: Memory | None) -> Iterator[Transition]:
        node = self._machine.nodes[place]
        remaining, inner = count_of(node), None
        if isinstance(memory, RepeaterMemory):
            remaining, inner = memory
        for move in self.moves(self._machine.children[place][0], inner):
            if move.status == kind_of(node).counts and remaining > 1:
                yield move._replace(status=RUNNING, memory=RepeaterMemory(remaining - 1, None))
            elif move.memory is None:
                yield move
            else:
                yield move._replace(memory=RepeaterMemory(remaining, move.memory))

    def _parallel(self, place: int, memory: Memory | None) -> Iterator[Transition]:
        args, children = self._machine.nodes[place].args, self._machine.children[place]
        assert isinstance(args, ParallelArgs)
        inner: Sequence[Memory | int | None] = [None] * len(children)
        if isinstance(memory, ParallelMemory):
            inner = memory.memories
        for combination in product(*map(self._child, children, inner)):
            self._search.spend()
            status = parallel_status(args, [move.status for move in combination])
            calls = tuple(call for move in combination for call in move.calls)
            memories = (m.status if m.memory is None else m.memory for m in combination)
            after = ParallelMemory(tuple(memories)) if status == RUNNING else None
            yield Transition(status, after, calls)

    def _child(self, place: int, memory: Memory | int | None) -> Iterator[Transition]:
        """The moves of a parallel's child; one that has ended is not ticked."""
        if isinstance(memory, int):
            return iter([Transition(memory, None)])
        return self.moves(place, memory)

    def _composite(self, place: int, memory: Memory | None) -> Iterator[Transition]:
        """The moves of a selector or sequence, branch by branch."""
        children = self._machine.children[place]
        first, inner, known = self._first_branch(place, memory)
        advance = advance_status(self._machine.nodes[place])
        stages = [self.moves(children[first], inner)]
        done: list[Transition] = []  # of the branches before the present one
        while stages:
            branch = first + len(done)
            move = next(stages[-1], None)
            if move is None:
                stages.pop()
                del done[-1:]
                continue
            done.append(move)
            if move.status == advance and branch < len(children) - 1:
                stages.append(self.moves(children[branch + 1], None))
                continue
            after = None
            if move.memory is not None:
                checked = {guard for each in done for guard in each.checked}
                now = self._known(place, first, branch, known, checked)
                after = BranchMemory(branch, move.memory, now)
            yield Transition(
                move.status, after, tuple(call for each in done for call in each.calls)
            )
            done.pop()

    def _first_branch(
        self, place: int, memory: Memory | None
    ) -> tuple[int, Memory | None, list[bool | None]]:
        """The branch that a composite ticks first, its memory, and the guards' known values."""
        observed = self._machine.observed[place]
        if memory is None:
            return 0, None, [None] * len(observed)
        assert isinstance(memory, BranchMemory)
        known = list(memory.known)
        for n, (branch, guard) in enumerate(observed):
            if branch < memory.branch and known[n] is not None:
                now = self._holds(guard)
                if now and not known[n]:  # it becomes true
                    earlier = (at < branch for at, _ in observed)
                    values = zip(known, earlier, strict=True)
                    return branch, None, [each if kept else None for each, kept in values]
                known[n] = now
        return memory.branch, memory.memory, known

    def _known(
        self, place: int, first: int, running: int, known: Sequence[bool | None], checked: Set[int]
    ) -> tuple[bool | None, ...]:
        """The known values of guards after a tick that began with the branch `first`."""
        values: list[bool | None] = []
        for before, (branch, guard) in zip(known, self._machine.observed[place], strict=True):
            now = before
            if branch >= first and (before is not None or guard in checked):
                now = branch == running or self._holds(guard)
            values.append(now if branch <= running else None)
        return tuple(values)
