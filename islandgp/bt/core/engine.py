"""Compiles a tree to a function that ticks it once.

`docs/semantics.md` specifies the nodes. A node is a function of `fresh`: True starts it, False
resumes it where it was RUNNING. So an abort does not visit the subtree: its next tick has
`fresh=True`. Guards are checked on the way down from the root. Only a `set` changes the blackboard
within a tick; what is ticked after it sees the new value.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, MutableSequence
from typing import Final, SupportsFloat, TypeAlias, cast

from islandgp.bt.core.closures import Observed, ReportStopped, Tick
from islandgp.bt.core.condition import (
    Board,
    Condition,
    ConditionExpr,
    assigned_value,
    condition,
)
from islandgp.bt.core.kinds import KINDS, needs_each_tick
from islandgp.bt.core.node import AGAIN, RUNNING, ActionArgs, Node, SecondsArgs
from islandgp.errors import DomainError

__all__ = ["ABORTED", "Board", "Tick", "Watch", "compile_tree", "condition"]

ABORTED: Final = 4  # passed to a watch only: the node was running and has been stopped

Watch: TypeAlias = Callable[[int, int], None]  # (node's position in document order, status)

Actions: TypeAlias = Mapping[str, Tick] | Callable[[ActionArgs], Tick]


def compile_tree(
    tree: Node,
    actions: Actions,
    board: Board,
    key_index: Mapping[str, int],
    *,
    watch: Watch | None = None,
    stopped: ReportStopped | None = None,
    step_s: SupportsFloat | None = None,
) -> Callable[[], int]:
    """Compiles a tree to a function that ticks it once.

    Args:
        tree: the root. A node object that occurs twice runs as two nodes.
        actions: a function per action name in the tree, looked up once for each leaf; or a
            function that makes one from the arguments of a leaf. It is called with `fresh`: True
            if the leaf starts now, False if it was RUNNING in the tick before.
        board: a value per key; the caller may change them between ticks only. A `set` writes it.
        key_index: index of each key in `board`, as `Vocabulary.key_index`.
        watch: called for each node that is ticked, children before parents, and with ABORTED for
            each running node that is stopped. None is fastest; then no node is reported, and aborts
            only to `stopped`. An aborted action is called with `fresh` True at its next start.
        stopped: called with the range of positions of each stopped subtree: the first, and that
            after the last. Not all of its nodes were running. It costs nothing in a tick without an
            abort.
        step_s: seconds between two ticks, > 0; required if the tree counts seconds. A tree that
            `needs_each_tick` has to be ticked in each step.

    Returns:
        The tick function. It returns FAILURE, SUCCESS, RUNNING or AGAIN. After RUNNING a caller may
        skip ticks as long as no condition changes its truth and each running action stays RUNNING;
        after AGAIN it must not skip the next tick (see `node.AGAIN`).

    Raises:
        KeyError: an action of the tree is missing in `actions`, or a key in `key_index`.
        DomainError: the tree counts seconds, and `step_s` is None.
    """
    compiler = _Compiler(actions, board, key_index, watch, stopped, step_s)
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


class _Compiler:
    """Turns nodes into closures, and numbers them in document order."""

    __slots__ = (
        "_actions",
        "_board",
        "_key_index",
        "_running",
        "_step_s",
        "_stopped",
        "_watch",
        "changed_midtick",
        "now",
        "report_stopped",
    )  # fmt: skip

    def __init__(
        self,
        actions: Actions,
        board: Board,
        key_index: Mapping[str, int],
        watch: Watch | None,
        stopped: ReportStopped | None,
        step_s: SupportsFloat | None,
    ) -> None:
        self._step_s = step_s
        self.now = 0  # number of the tick; counted only in a tree that `needs_each_tick`
        self._actions = actions
        self._board = board
        self._key_index = key_index
        self._watch = watch
        self._running: list[bool] = []  # by position
        self._stopped = stopped or _ignore
        self.report_stopped: ReportStopped = self._stopped if watch is None else self._watch_stopped
        self.changed_midtick = False
        """True: in this tick an action was RUNNING and then aborted, or a key was written."""

    def compile(self, node: Node, observed: Observed | None) -> Tick:
        """The closure of a node; `observed` as in `Maker`."""
        position = len(self._running)
        self._running.append(False)
        tick = KINDS[node.kind].tick(self, node, observed)
        return tick if self._watch is None else self._watched(tick, position, self._watch)

    def child(self, node: Node, observed: Observed | None) -> tuple[Tick, tuple[int, int]]:
        first = len(self._running)
        return self.compile(node.children[0], observed), (first, len(self._running))

    def children(
        self, node: Node, observed: Observed | None = None
    ) -> tuple[list[Tick], list[int]]:
        branches, positions = [], []
        for branch, child in enumerate(node.children):
            positions.append(len(self._running))
            if observed is not None:
                observed.branch = branch
            # No branch comes after the last one, so its guards are not observed.
            last = branch == len(node.children) - 1
            branches.append(self.compile(child, None if last else observed))
        return branches, [*positions, len(self._running)]

    def action(self, args: ActionArgs) -> Tick:
        return self._actions(args) if callable(self._actions) else self._actions[args.name]

    def holds(self, expr: ConditionExpr) -> Callable[[], bool]:
        return condition(expr, self._board, self._key_index)

    def writer(self, assigned: Condition) -> Callable[[], None]:
        board, at = cast("MutableSequence[float]", self._board), self._key_index[assigned.key]
        value = assigned_value(assigned, self._board, self._key_index)

        def write() -> None:
            before, board[at] = board[at], value()
            if board[at] != before:  # a guard that was evaluated before may be false now
                self.changed_midtick = True

        return write

    def ticks(self, node: Node) -> int:
        assert isinstance(node.args, SecondsArgs)
        if self._step_s is None:
            raise DomainError(
                f"Expected step_s, the seconds between two ticks, as the tree has a {node.kind};"
                " found None."
            )
        return node.args.ticks(self._step_s)

    def _watched(self, tick: Tick, position: int, watch: Watch) -> Tick:
        running = self._running

        def watched(fresh: bool) -> int:
            status = tick(fresh)
            running[position] = status >= RUNNING
            watch(position, status)
            return status

        return watched

    def stop_midtick(self, first: int, end: int) -> None:
        self.changed_midtick = True
        self.report_stopped(first, end)

    def _watch_stopped(self, first: int, end: int) -> None:
        assert self._watch is not None
        for position in range(first, end):
            if self._running[position]:
                self._running[position] = False
                self._watch(position, ABORTED)
        self._stopped(first, end)


def _ignore(first: int, end: int) -> None:
    """Does nothing; used if no caller needs to know which parts are stopped."""
