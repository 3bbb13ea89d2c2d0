"""The possible moves of a tree in a tick, by the statuses that its actions return.

For trees with clocks (`TIMED`) the moves are incomplete: a `wait` starts its child immediately, and
a `timeout` or `cooldown` never fails by itself. `Machine` includes these outcomes. Reactive
composites have the moves of those with memory, so rules of trees with them are not explored.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence, Set
from functools import partial
from itertools import product
from typing import Final, NamedTuple, TypeAlias

from islandgp.bt.core.condition import condition
from islandgp.bt.core.kinds import advance_status, kind_of
from islandgp.bt.core.node import FAILURE, RUNNING, SUCCESS, ParallelArgs, guard_of
from islandgp_verify.board_outcomes import parallel_status
from islandgp_verify.machine import (
    ActionMemory,
    BranchMemory,
    Machine,
    Memory,
    ParallelMemory,
    RepeaterMemory,
    TickTarget,
)

ActionCalls: TypeAlias = tuple[tuple[int, int], ...]
"""The statuses that the ticked actions return, by place."""

_RUNS: Final = ActionMemory()


class Transition(NamedTuple):
    """A possible move of a node in a tick."""

    status: int
    memory: Memory | None  # None: it has ended
    calls: ActionCalls = ()
    checked: tuple[int, ...] = ()  # guards of the branch that were evaluated at its start


class Goal(NamedTuple):
    """The wanted moves of a node."""

    statuses: Sequence[int]  # with which they may end, the preferred ones first
    target: TickTarget | None = None  # that they must reach


def moves(
    machine: Machine,
    memory: Memory | None,
    board: Sequence[float],
    target: TickTarget | None = None,
) -> Iterator[Transition]:
    """The possible moves of a tree in a tick.

    Args:
        machine: of the tree; it spends a step for each action that is ticked.
        memory: of the root; None: it starts.
        board: the blackboard of the tick.
        target: only ticks that reach this node; the first of them is found without a search.

    Raises:
        SpentError: the machine has no steps left.
    """
    machine.spend()
    return _Tick(machine, board).moves(0, memory, Goal((RUNNING, SUCCESS, FAILURE), target))


class _Tick:
    """One tick, on one blackboard.

    Each method yields the moves of a node that fulfil a goal.
    """

    def __init__(self, machine: Machine, board: Sequence[float]) -> None:
        self._machine = machine
        self._board = board
        self._truth: dict[int, bool] = {}

    def _holds(self, guard: int) -> bool:
        """True if the condition of a guard holds."""
        if guard not in self._truth:
            expr = guard_of(self._machine.nodes[guard]).condition
            self._truth[guard] = condition(expr, self._board, self._machine.sets.key_index)()
        return self._truth[guard]

    def moves(self, place: int, memory: Memory | None, goal: Goal) -> Iterator[Transition]:
        """The moves of a node with a memory; None: it starts."""
        if goal.target is not None and place == goal.target.place:
            goal = Goal(goal.statuses)
        node = self._machine.nodes[place]
        kind = kind_of(node)
        if not node.children:
            return self._leaf(place, goal.statuses)
        if node.guard:
            return self._guard(place, memory, goal)
        if kind.counts is not None:
            return self._repeater(place, memory, goal)
        if kind.decorates:
            return self._turned(place, memory, goal)
        if kind.concurrent:
            return self._parallel(place, memory, goal)
        return self._composite(place, memory, goal)

    def _leaf(self, place: int, statuses: Sequence[int]) -> Iterator[Transition]:
        is_action = bool(self._machine.nodes[place].action)
        for status in statuses:
            if status in self._machine.statuses[place]:
                self._machine.spend()
                calls = ((place, status),) if is_action else ()
                yield Transition(status, _RUNS if status == RUNNING else None, calls)

    def _turned(self, place: int, memory: Memory | None, goal: Goal) -> Iterator[Transition]:
        ends = (*kind_of(self._machine.nodes[place]).ends, RUNNING)
        inside = [s for end in goal.statuses for s in (RUNNING, SUCCESS, FAILURE) if ends[s] == end]
        child = self._machine.children[place][0]
        for move in self.moves(child, memory, goal._replace(statuses=inside)):
            yield move._replace(status=ends[move.status])

    def _guard(self, place: int, memory: Memory | None, goal: Goal) -> Iterator[Transition]:
        checked = (place,) if memory is None else ()
        checks = memory is None or guard_of(self._machine.nodes[place]).checks_itself
        if checks and not self._holds(place):
            if FAILURE in goal.statuses and goal.target is None:
                yield Transition(FAILURE, None, checked=checked)
            return
        for move in self.moves(self._machine.children[place][0], memory, goal):
            yield move._replace(checked=(*checked, *move.checked))

    def _repeater(self, place: int, memory: Memory | None, goal: Goal) -> Iterator[Transition]:
        remaining, inner = self._machine.repetition(place, memory)
        counted = kind_of(self._machine.nodes[place]).counts
        assert counted is not None
        unfinished = RUNNING if remaining > 1 else counted
        # The counted status comes first, as it makes progress.
        others = [status for status in goal.statuses if status != counted]
        inside = [counted, *others] if unfinished in goal.statuses else others
        child = self._machine.children[place][0]
        for move in self.moves(child, inner, goal._replace(statuses=inside)):
            if move.status == counted:
                after = RepeaterMemory(remaining - 1, None) if remaining > 1 else None
                yield move._replace(status=unfinished, memory=after)
            elif move.memory is None:
                yield move
            else:
                yield move._replace(memory=RepeaterMemory(remaining, move.memory))

    def _parallel(self, place: int, memory: Memory | None, goal: Goal) -> Iterator[Transition]:
        machine, args = self._machine, self._machine.nodes[place].args
        assert isinstance(args, ParallelArgs)
        children, inside = machine.children[place], machine.memories(place, memory)
        towards = -1 if goal.target is None else goal.target.branches[place]
        targets = [goal.target if branch == towards else None for branch in range(len(children))]
        tasks = list(zip(children, inside, targets, strict=True))
        for status in goal.statuses:
            preferred = _preferred(args, status)
            options = [[s for s in preferred if self._can(*task, s)] for task in tasks]
            for statuses in product(*options):
                machine.spend(len(statuses))
                if parallel_status(args, statuses) != status:
                    continue
                makers = [
                    partial(self._child, *task, s) for task, s in zip(tasks, statuses, strict=True)
                ]
                for combination in _combined(makers):
                    calls = tuple(call for move in combination for call in move.calls)
                    after = None
                    if status == RUNNING:
                        memories = (m.status if m.memory is None else m.memory for m in combination)
                        after = ParallelMemory(tuple(memories))
                    yield Transition(status, after, calls)

    def _can(
        self, place: int, memory: Memory | int | None, target: TickTarget | None, status: int
    ) -> bool:
        """True if a child of a parallel can end the tick with this status."""
        if target is None:
            outcomes = self._machine.now(place, memory)
        else:
            outcomes = self._machine.outcomes_reaching(place, memory, target)
        return self._machine.sets.has(outcomes[status], self._board)

    def _child(
        self, place: int, memory: Memory | int | None, target: TickTarget | None, status: int
    ) -> Iterator[Transition]:
        """The moves of a parallel's child with this status; an ended child is not ticked."""
        if not isinstance(memory, int):
            return self.moves(place, memory, Goal((status,), target))
        return iter([Transition(memory, None)] if target is None else [])

    def _composite(self, place: int, memory: Memory | None, goal: Goal) -> Iterator[Transition]:
        """The moves of a selector or sequence, branch by branch."""
        machine = self._machine
        first, inner, known = self._first_branch(place, memory)
        advance, last = advance_status(machine.nodes[place]), len(machine.children[place]) - 1
        towards = first if goal.target is None else goal.target.branches[place]
        stages = [self._branch(place, first, inner, goal)]
        done: list[Transition] = []  # of the branches before the present one
        while stages:
            branch = first + len(done)
            move = next(stages[-1], None)
            if move is None:
                stages.pop()
                del done[-1:]
                continue
            done.append(move)
            if move.status == advance and branch < last:
                ahead = goal if branch < towards else Goal(goal.statuses)
                stages.append(self._branch(place, branch + 1, None, ahead))
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

    def _branch(
        self, place: int, branch: int, memory: Memory | None, goal: Goal
    ) -> Iterator[Transition]:
        """The moves of a branch with which the composite can fulfil the goal."""
        statuses, target = goal
        machine, children = self._machine, self._machine.children[place]
        has, advance = machine.sets.has, advance_status(machine.nodes[place])
        towards = branch if target is None else target.branches[place]
        if branch > towards:
            return iter(())
        if branch < towards:
            assert target is not None
            path = machine.outcomes_from(place, branch + 1, target)
            if not any(has(path[status], self._board) for status in statuses):
                return iter(())
            return self.moves(children[branch], memory, Goal((advance,)))
        inside = [status for status in statuses if status != advance]
        if branch == len(children) - 1:
            inside = list(statuses)
        else:
            later = machine.fresh_from(place, branch + 1)
            if any(has(later[status], self._board) for status in statuses):
                inside.append(advance)
        return self.moves(children[branch], memory, Goal(inside, target))

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


def _combined(
    makers: Sequence[Callable[[], Iterator[Transition]]],
) -> Iterator[tuple[Transition, ...]]:
    """All combinations of one move of each."""
    combination: list[Transition] = []
    going = [makers[0]()]
    while going:
        move = next(going[-1], None)
        if move is None:
            going.pop()
            del combination[-1:]
        elif len(going) == len(makers):
            yield (*combination, move)
        else:
            combination.append(move)
            going.append(makers[len(going)]())


def _preferred(parallel: ParallelArgs, status: int) -> tuple[int, int, int]:
    """The statuses of children that lead a parallel to the wanted status, the best first.

    If each child has the first status that it can have, the parallel has the wanted status whenever
    that is possible.
    """
    if status == FAILURE:
        return FAILURE, SUCCESS, RUNNING
    if status == SUCCESS:
        return SUCCESS, RUNNING, FAILURE
    return (RUNNING, SUCCESS, FAILURE) if parallel.failure == "one" else (RUNNING, FAILURE, SUCCESS)
