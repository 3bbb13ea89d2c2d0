"""Compiles a tree to a function that ticks it once.

`docs/semantics.md` specifies the nodes. A node is a function of `fresh`: True starts it, False
resumes it where it was RUNNING. So an abort does not visit the subtree: its next tick has
`fresh=True`. Guards are checked on the way down from the root. Only a `set` changes the blackboard
within a tick; what is ticked after it sees the new value.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, MutableSequence, Sequence
from dataclasses import dataclass, field
from fractions import Fraction
from functools import partial
from itertools import compress
from math import ceil, inf
from typing import Any, Final, NamedTuple, SupportsFloat, TypeAlias, cast

from islandgp.bt.core.condition import Board, Condition, ConditionExpr, assigned_value, condition
from islandgp.bt.core.node import AGAIN, RUNNING, SECONDS, ActionArgs, CountArgs, Node, SecondsArgs
from islandgp.errors import DomainError

ABORTED: Final = 4  # passed to a watch only: the node was running and has been stopped

Tick: TypeAlias = Callable[[bool], int]  # (fresh) -> status
Stop: TypeAlias = Callable[[], None]
Watch: TypeAlias = Callable[[int, int], None]  # (node's position in document order, status)
Actions: TypeAlias = Mapping[str, Tick] | Callable[[ActionArgs], Tick]


@dataclass(slots=True)
class Guard:
    """A `when` that a composite may observe while a later branch runs."""

    branch: int  # of the composite
    holds: Callable[[], bool]
    truth: bool | None = None  # last known; None: not visited since the composite started


class Observed(NamedTuple):
    """Where a composite observes guards."""

    branch: int  # that is being compiled
    guards: list[Guard]  # of the composite, in document order


def ticks_of(seconds: float, step_s: SupportsFloat) -> int:
    """The index of the first tick at or after a time; ticks are `step_s` seconds apart."""
    return max(1, ceil(Fraction(str(seconds)) / Fraction(str(step_s))))


@dataclass(slots=True)
class Compiler:
    """Compiles nodes; the makers of `closures` call it for their children.

    Its first fields are the kinds of nodes, and the arguments of `compile_tree`.
    """

    _kinds: Mapping[str, Any]  # each has its maker as `tick`
    _actions: Actions
    _board: Board
    _key_index: Mapping[str, int]
    _watch: Watch | None
    _step_s: SupportsFloat | None
    _seed: int
    _running: list[bool] = field(default_factory=list)  # by position; only for a watch
    _stops: list[tuple[int, Callable[[], None]]] = field(default_factory=list)  # of leaves
    now: int = 0  # number of the tick; counted only in a tree that `needs_each_tick`
    changed_midtick: bool = False
    """True: in this tick an action was RUNNING and then aborted, or a key was written."""

    def compile(self, node: Node, observed: Observed | None) -> Tick:
        """The closure of a node; `observed` as in `Maker`."""
        position = len(self._running)
        self._running.append(False)
        tick = self._kinds[node.kind].tick(self, node, observed)
        if (stop := getattr(tick, "stop", None)) is not None:
            self._stops.append((position, stop))
        return tick if self._watch is None else self._watched(tick, position, self._watch)

    def child(self, child: Node, observed: Observed | None) -> tuple[Tick, Stop]:
        """The closure of a child, and the function that stops it."""
        first = len(self._running)
        tick = self.compile(child, observed)
        return tick, partial(self._stop, first, len(self._running))

    def children(self, node: Node, guards: list[Guard] | None = None) -> list[tuple[Tick, Stop]]:
        """The closures of children, and the functions that stop them.

        `guards` collects their observed guards; None: their guards are not observed.
        """
        # No branch comes after the last one, so its guards are not observed.
        last = len(node.children) - 1
        return [
            self.child(child, None if guards is None or at == last else Observed(at, guards))
            for at, child in enumerate(node.children)
        ]

    def action(self, args: ActionArgs) -> Tick:
        """The function of an action."""
        return self._actions(args) if callable(self._actions) else self._actions[args.name]

    def holds(self, expr: ConditionExpr) -> Callable[[], bool]:
        """The function that evaluates a condition."""
        return condition(expr, self._board, self._key_index)

    def writer(self, assigned: Condition) -> Callable[[], None]:
        """The function that writes a key."""
        board, at = cast("MutableSequence[float]", self._board), self._key_index[assigned.key]
        value = assigned_value(assigned, self._board, self._key_index)

        def write() -> None:
            before, board[at] = board[at], value()
            if board[at] != before:  # a guard that was evaluated before may be false now
                self.changed_midtick = True

        return write

    def count(self, node: Node) -> Callable[[], float]:
        """The function that gives the count of a node; it reads a key."""
        times = node.args.times if isinstance(node.args, CountArgs) else inf
        if not isinstance(times, str):
            return lambda: times
        board, at = self._board, self._key_index[times]
        return lambda: board[at]

    def ticks(self, node: Node) -> Callable[[], int]:
        """The function that gives the seconds of a node as a number of ticks; it reads a key."""
        assert isinstance(node.args, SecondsArgs)
        if (step_s := self._step_s) is None:
            raise DomainError(
                f"Expected step_s, the seconds between two ticks, as the tree has a {node.kind};"
                " found None."
            )
        seconds, (low, high) = node.args.seconds, SECONDS
        if not isinstance(seconds, str):
            ticks = ticks_of(seconds, step_s)
            return lambda: ticks
        board, at = self._board, self._key_index[seconds]
        return lambda: ticks_of(max(low, min(high, board[at])), step_s)

    def order(self, count: int) -> Callable[[], list[int]]:
        """The function that draws an order of the children of the node that is compiled."""
        from islandgp.seeding import Stream, stream  # needs NumPy

        rng = stream(self._seed, Stream.ORDER, slot=len(self._running))
        return lambda: rng.permutation(count).tolist()

    def stop_running(self, stops: Sequence[Stop], running: Iterable[bool]) -> None:
        """Stop the children of a composite that run, as it ends."""
        for stop in compress(stops, running):
            self.changed_midtick = True
            stop()

    def _watched(self, tick: Tick, position: int, watch: Watch) -> Tick:
        running = self._running

        def watched(fresh: bool) -> int:
            status = tick(fresh)
            running[position] = status >= RUNNING
            watch(position, status)
            return status

        return watched

    def _stop(self, first: int, end: int) -> None:
        """Called when a subtree is stopped, with its first position and that after its last one.

        It calls the watch and the method `stop` of leaves but no other node: the next call of an
        aborted action has `fresh=True`.
        """
        if self._watch is not None:
            for position in range(first, end):
                if self._running[position]:
                    self._running[position] = False
                    self._watch(position, ABORTED)
        for position, stop in self._stops:
            if first <= position < end:
                stop()


Maker: TypeAlias = Callable[[Compiler, Node, Observed | None], Tick]
"""Makes the tick function of a node.

`Observed` has the guards of the nearest composite above. It is None if the composite observes no
guard of this branch.
"""


def compile_tree(
    tree: Node,
    actions: Actions,
    board: Board,
    key_index: Mapping[str, int],
    *,
    watch: Watch | None = None,
    step_s: SupportsFloat | None = None,
    seed: int = 0,
) -> Callable[[], int]:
    """Compiles a tree to a function that ticks it once.

    Args:
        tree: the root. A node object that occurs twice runs as two nodes.
        actions: a function per action name in the tree, looked up once for each leaf; or a
            function that makes one from the arguments of a leaf. It is called with `fresh`: True
            if the leaf starts now, False if it was RUNNING in the tick before. If it has a method
            `stop`, this is called when a part of the tree with the leaf is stopped, even if the
            leaf was not running.
        board: a value per key; the caller may change them between ticks only. A `set` writes it.
        key_index: index of each key in `board`, as `Vocabulary.key_index`.
        watch: called for each node that is ticked, children before parents, and with ABORTED for
            each running node that is stopped. None is fastest. An aborted action is called with
            `fresh` True at its next start.
        step_s: seconds between two ticks, > 0; required if the tree counts seconds. A tree that
            `needs_each_tick` has to be ticked in each step.
        seed: of the orders that a random_selector draws, e.g. that of the episode.

    Returns:
        The tick function. It returns FAILURE, SUCCESS, RUNNING or AGAIN. After RUNNING a caller may
        skip ticks as long as no condition changes its truth and each running action stays RUNNING;
        after AGAIN it must not skip the next tick (see `node.AGAIN`).

    Raises:
        KeyError: an action of the tree is missing in `actions`, or a key in `key_index`.
        DomainError: the tree counts seconds, and `step_s` is None.
    """
    from islandgp.bt.core.kinds import KINDS, needs_each_tick  # its makers use this module

    compiler = Compiler(KINDS, actions, board, key_index, watch, step_s, seed)
    root = compiler.compile(tree, None)
    fresh, timed = True, needs_each_tick(tree)

    def tick() -> int:
        nonlocal fresh
        if timed:
            compiler.now += 1
        status = root(fresh)
        fresh = status < RUNNING
        if compiler.changed_midtick:
            # The effect of an aborted action, such as driving, ends on the next tick.
            compiler.changed_midtick = False
            return AGAIN if status == RUNNING else status
        return status

    return tick
