"""Compiles a tree to a function that ticks it once.

`docs/semantics.md` specifies the nodes. A node is a function of `fresh`: True starts it, False
resumes it where it was RUNNING. So an abort does not visit the subtree: its next tick has
`fresh=True`. The blackboard does not change within a tick, so checking guards on the way down from
the root gives the same statuses as checking all of them at the start of the tick.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Final, SupportsFloat, TypeAlias

from islandgp.bt.core import closures, nav2_closures
from islandgp.bt.core.closures import Observed, ReportStopped, Tick
from islandgp.bt.core.condition import Board, condition
from islandgp.bt.core.kinds import KINDS, count_of, needs_each_tick
from islandgp.bt.core.node import (
    AGAIN,
    FAILURE,
    RUNNING,
    SUCCESS,
    ActionArgs,
    AlwaysArgs,
    Node,
    ParallelArgs,
    SecondsArgs,
)
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
        board: a value per key; the caller may change them between ticks only.
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
        if compiler.stopped_midtick:
            # The effect of the aborted action, such as driving, ends on the next tick.
            compiler.stopped_midtick = False
            return AGAIN if status == RUNNING else status
        return status

    return tick


class _Compiler:
    """Turns nodes into closures, and numbers them in document order."""

    __slots__ = (
        "_actions", "_board", "_key_index", "_report_stopped", "_running", "_step_s", "_stopped",
        "_watch", "now", "stopped_midtick",
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
        self._report_stopped: ReportStopped = (
            self._stopped if watch is None else self._watch_stopped
        )
        self.stopped_midtick = False  # True: an action was RUNNING in this tick and then aborted

    @property
    def _next_position(self) -> int:
        """The position of the next node to compile."""
        return len(self._running)

    def compile(self, node: Node, observed: Observed | None) -> Tick:
        """The closure of a node.

        `observed` collects the observed guards of the nearest composite above. It is None if the
        composite observes no guard of this branch.
        """
        position = self._next_position
        self._running.append(False)
        args = node.args
        if isinstance(args, ActionArgs):
            tick = self._actions(args) if callable(self._actions) else self._actions[args.name]
        else:
            tick = _MAKERS[node.kind](self, node, observed)
        return tick if self._watch is None else self._watched(tick, position, self._watch)

    def _composite(self, node: Node, _: Observed | None) -> Tick:
        """A selector or sequence."""
        status = KINDS[node.kind].advance_status
        assert status is not None
        observed = Observed()
        last = len(node.children) - 1
        branches, positions = [], []
        for branch, child in enumerate(node.children):
            positions.append(self._next_position)
            observed.branch = branch
            # No branch comes after the last one, so its guards are not observed.
            branches.append(self.compile(child, observed if branch < last else None))
        positions.append(self._next_position)
        if observed.guards:
            return closures.observing_composite(
                branches, status, observed, positions, self._report_stopped
            )
        return closures.composite(branches, status)

    def _parallel(self, node: Node, _: Observed | None) -> Tick:
        assert isinstance(node.args, ParallelArgs)
        branches, positions = self._unobserved(node)
        success, failure = node.args.needed(len(branches))
        return closures.parallel(branches, success, failure, positions, self._stop_midtick)

    def _reactive(self, node: Node, _: Observed | None) -> Tick:
        status = KINDS[node.kind].advance_status
        assert status is not None
        branches, positions = self._unobserved(node)
        return closures.reactive_composite(branches, status, positions, self._report_stopped)

    def _unobserved(self, node: Node) -> tuple[list[Tick], list[int]]:
        """The closures of children whose guards are not observed, and their positions."""
        branches, positions = [], []
        for child in node.children:
            positions.append(self._next_position)
            branches.append(self.compile(child, None))
        return branches, [*positions, self._next_position]

    def _ticks(self, node: Node) -> int:
        assert isinstance(node.args, SecondsArgs)
        if self._step_s is None:
            raise DomainError(
                f"Expected step_s, the seconds between two ticks, as the tree has a {node.kind};"
                " found None."
            )
        return node.args.ticks(self._step_s)

    def _wait(self, node: Node, observed: Observed | None) -> Tick:
        ticks = self._ticks(node)
        return closures.wait(self.compile(node.children[0], observed), ticks)

    def _timeout(self, node: Node, observed: Observed | None) -> Tick:
        first, ticks = self._next_position, self._ticks(node)
        child = self.compile(node.children[0], observed)
        return closures.timeout(child, ticks, (first, self._next_position), self._report_stopped)

    def _cooldown(self, node: Node, observed: Observed | None) -> Tick:
        ticks = self._ticks(node)
        child = self.compile(node.children[0], observed)
        return closures.cooldown(child, ticks, lambda: self.now)

    def _every(self, node: Node, observed: Observed | None) -> Tick:
        ticks = self._ticks(node)
        return closures.every(self.compile(node.children[0], observed), ticks, lambda: self.now)

    def _pipeline(self, node: Node, _: Observed | None) -> Tick:
        return nav2_closures.pipeline(*self._unobserved(node), self._stop_midtick)

    def _round_robin(self, node: Node, _: Observed | None) -> Tick:
        return nav2_closures.round_robin(self._unobserved(node)[0])

    def _recovery(self, node: Node, _: Observed | None) -> Tick:
        (child, remedy), _positions = self._unobserved(node)
        return nav2_closures.recovery(child, remedy, count_of(node))

    def _inverter(self, node: Node, observed: Observed | None) -> Tick:
        return closures.inverter(self.compile(node.children[0], observed))

    def _repeater(self, node: Node, observed: Observed | None) -> Tick:
        counted = KINDS[node.kind].counts
        assert counted is not None
        return closures.repeater(self.compile(node.children[0], observed), count_of(node), counted)

    def _forced(self, node: Node, observed: Observed | None) -> Tick:
        end = KINDS[node.kind].ends[SUCCESS]
        return closures.forced(self.compile(node.children[0], observed), end)

    def _when(self, node: Node, observed: Observed | None) -> Tick:
        assert node.guard is not None
        holds = condition(node.guard.condition, self._board, self._key_index)
        truth: list[bool | None] = [None]  # a separate slot that no composite observes
        slot = 0
        if observed is not None and node.guard.interrupts:
            truth, slot = observed.truth, observed.add(holds)
        first = self._next_position
        child = self.compile(node.children[0], observed)
        span = (first, self._next_position)
        checks_itself = node.guard.checks_itself
        return closures.guard(child, holds, checks_itself, truth, slot, span, self._report_stopped)

    def _always(self, node: Node, _: Observed | None) -> Tick:
        # AGAIN, since no action runs for whose end a simulator could wait.
        assert isinstance(node.args, AlwaysArgs)
        status = {"success": SUCCESS, "failure": FAILURE, "running": AGAIN}[node.args.status]
        return lambda _fresh: status

    def _watched(self, tick: Tick, position: int, watch: Watch) -> Tick:
        running = self._running

        def watched(fresh: bool) -> int:
            status = tick(fresh)
            running[position] = status >= RUNNING
            watch(position, status)
            return status

        return watched

    def _stop_midtick(self, first: int, end: int) -> None:
        self.stopped_midtick = True
        self._report_stopped(first, end)

    def _watch_stopped(self, first: int, end: int) -> None:
        assert self._watch is not None
        for position in range(first, end):
            if self._running[position]:
                self._running[position] = False
                self._watch(position, ABORTED)
        self._stopped(first, end)


_MAKERS: Final[dict[str, Callable[[_Compiler, Node, Observed | None], Tick]]] = {
    "selector": _Compiler._composite,
    "sequence": _Compiler._composite,
    "reactive_selector": _Compiler._reactive,
    "reactive_sequence": _Compiler._reactive,
    "parallel": _Compiler._parallel,
    "wait": _Compiler._wait,
    "timeout": _Compiler._timeout,
    "cooldown": _Compiler._cooldown,
    "every": _Compiler._every,
    "pipeline": _Compiler._pipeline,
    "round_robin": _Compiler._round_robin,
    "recovery": _Compiler._recovery,
    "inverter": _Compiler._inverter,
    "repeater": _Compiler._repeater,
    "retry": _Compiler._repeater,
    "until_failure": _Compiler._repeater,
    "until_success": _Compiler._repeater,
    "force_success": _Compiler._forced,
    "force_failure": _Compiler._forced,
    "when": _Compiler._when,
    "always": _Compiler._always,
}
"""The method that compiles each kind of inner node."""


def _ignore(first: int, end: int) -> None:
    """Does nothing; used if no caller needs to know which parts are stopped."""
