"""The tick function of each kind of node: a closure that holds the node's memory.

The entry of a kind in `kinds` names one of these functions, or one of `steered`, and a `Compiler`
calls it to compile a node of the kind. docs/semantics.md specifies the nodes.
"""

from __future__ import annotations

from collections.abc import Sequence

from islandgp.bt.core.engine import Compiler, Guard, Maker, Observed, Stop, Tick
from islandgp.bt.core.node import (
    AGAIN,
    FAILURE,
    RUNNING,
    SUCCESS,
    ActionArgs,
    AlwaysArgs,
    Node,
    ParallelArgs,
    SetArgs,
    guard_of,
)


def ordered(advance_status: int) -> Maker:
    """A selector (`advance_status` FAILURE) or a sequence (SUCCESS)."""

    def make(compiler: Compiler, node: Node, _: Observed | None) -> Tick:
        guards: list[Guard] = []
        branches, stops = zip(*compiler.children(node, guards), strict=True)
        if not guards:
            return _composite(branches, advance_status)
        return _observing_composite(branches, stops, advance_status, guards)

    return make


def _composite(branches: Sequence[Tick], advance_status: int) -> Tick:
    """A composite without observed guards."""
    count = len(branches)
    current = 0

    def tick(fresh: bool) -> int:
        nonlocal current
        at = 0 if fresh else current
        status = branches[at](fresh)
        while status == advance_status:
            at += 1
            if at == count:
                return status
            status = branches[at](True)
        current = at
        return status

    return tick


def _observing_composite(
    branches: Sequence[Tick], stops: Sequence[Stop], advance_status: int, guards: Sequence[Guard]
) -> Tick:
    """A selector or sequence that goes back to an earlier branch when its guard becomes true.

    Args:
        branches: the children.
        stops: the functions that stop them.
        advance_status: the status of a branch after which the next one starts.
        guards: those of all branches but the last.
    """
    count = len(branches)
    current = 0

    def turned_true() -> int:
        """The branch of the first observed guard that became true, else the running branch."""
        for guard in guards:
            if guard.branch >= current:
                break
            before = guard.truth
            if before is not None:
                guard.truth = guard.holds()
                if guard.truth and not before:
                    return guard.branch
        return current

    def tick(fresh: bool) -> int:
        nonlocal current
        at = 0 if fresh else turned_true()
        if not fresh and at != current:
            stops[current]()
            fresh = True
        if fresh:
            for guard in guards:
                if guard.branch >= at:
                    guard.truth = None
        status = branches[at](fresh)
        if status == advance_status and not fresh:
            # The guards of this branch are observed from this tick on. Their stored values are
            # from the branch's start, which may be many ticks ago.
            for guard in guards:
                if guard.branch == at and guard.truth is not None:
                    guard.truth = guard.holds()
        while status == advance_status:
            at += 1
            if at == count:
                return status
            status = branches[at](True)
        current = at
        return status

    return tick


def reactive(advance_status: int) -> Maker:
    """A selector or sequence that begins with its first child in each tick."""

    def make(compiler: Compiler, node: Node, _: Observed | None) -> Tick:
        branches, stops = zip(*compiler.children(node), strict=True)
        current = 0  # the child that ran in the tick before

        def tick(fresh: bool) -> int:
            nonlocal current
            running = -1 if fresh else current
            for at, branch in enumerate(branches):
                status = branch(at != running)
                if status != advance_status:
                    if running > at:
                        stops[running]()
                    current = at
                    # The children before it start again in the next tick.
                    return AGAIN if status == RUNNING and at else status
            return advance_status

        return tick

    return make


def parallel(compiler: Compiler, node: Node, _: Observed | None) -> Tick:
    """Ticks all children; succeeds after enough successes, fails after enough failures."""
    assert isinstance(node.args, ParallelArgs)
    branches, stops = zip(*compiler.children(node), strict=True)
    success, failure = node.args.needed(len(branches))
    count = len(branches)
    statuses = [RUNNING] * count

    def tick(fresh: bool) -> int:
        succeeded = failed = 0
        running = RUNNING
        for at, branch in enumerate(branches):
            status = statuses[at]
            if fresh or status >= RUNNING:
                status = statuses[at] = branch(fresh)
            if status == SUCCESS:
                succeeded += 1
            elif status == FAILURE:
                failed += 1
            elif status == AGAIN:
                running = AGAIN
        if failed < failure and succeeded < success and succeeded + failed < count:
            return running
        compiler.stop_running(stops, [status >= RUNNING for status in statuses])
        return SUCCESS if failed < failure and succeeded >= success else FAILURE

    return tick


def pipeline(compiler: Compiler, node: Node, _: Observed | None) -> Tick:
    """A sequence that begins with its first child in each tick, as that of Nav2.

    The next child starts after a success. It is also ticked while the child before it is running,
    if it or a later one has run since the pipeline started.
    """
    branches, stops = zip(*compiler.children(node), strict=True)
    running = [False] * len(branches)
    furthest = 0

    def tick(fresh: bool) -> int:
        nonlocal furthest
        if fresh:
            running[:] = [False] * len(branches)
            furthest = 0
        status = SUCCESS
        for at, branch in enumerate(branches):
            status = branch(not running[at])
            running[at] = status >= RUNNING
            if status == FAILURE:
                break
            if running[at] and at >= furthest:
                furthest = at
                # The children before it that ended start again in the next tick.
                return AGAIN if at else status
        compiler.stop_running(stops, running)
        return status

    return tick


def ending(ends: tuple[int, int]) -> Maker:
    """Ends with the first of two statuses when its child fails, else with the second."""

    def make(compiler: Compiler, node: Node, observed: Observed | None) -> Tick:
        child, _ = compiler.child(node.children[0], observed)

        def tick(fresh: bool) -> int:
            status = child(fresh)
            return status if status >= RUNNING else ends[status]

        return tick

    return make


def repeating(counted: int) -> Maker:
    """Repeats its child, once a tick, until enough ends with the status `counted`."""

    def make(compiler: Compiler, node: Node, observed: Observed | None) -> Tick:
        (child, _), count = compiler.child(node.children[0], observed), compiler.count(node)
        remaining = 0.0  # ends with this status until the repeater ends
        due = False  # True: the next tick starts a repetition

        def tick(fresh: bool) -> int:
            nonlocal remaining, due
            if fresh:
                remaining = count()
                if remaining < 1:  # a key: no repetition at all
                    return counted
            status = child(fresh or due)
            due = False
            if status == counted:
                remaining -= 1
                due = remaining > 0
            return AGAIN if due else status

        return tick

    return make


def wait(compiler: Compiler, node: Node, observed: Observed | None) -> Tick:
    """Starts its child some ticks after its own start."""
    (child, _), ticks = compiler.child(node.children[0], observed), compiler.ticks(node)
    remaining = 0

    def tick(fresh: bool) -> int:
        nonlocal remaining
        remaining = ticks() if fresh else remaining - 1
        return AGAIN if remaining > 0 else child(remaining == 0)

    return tick


def timeout(compiler: Compiler, node: Node, observed: Observed | None) -> Tick:
    """Fails some ticks after its start if its child still runs."""
    (child, stop), ticks = compiler.child(node.children[0], observed), compiler.ticks(node)
    remaining = 0

    def tick(fresh: bool) -> int:
        nonlocal remaining
        remaining = ticks() if fresh else remaining - 1
        if remaining == 0:
            stop()
            return FAILURE
        status = child(fresh)
        return AGAIN if status == RUNNING else status

    return tick


def cooldown(compiler: Compiler, node: Node, observed: Observed | None) -> Tick:
    """Fails for some ticks after its child has ended."""
    (child, _), ticks = compiler.child(node.children[0], observed), compiler.ticks(node)
    ready = 0  # the first tick in which the child may start

    def tick(fresh: bool) -> int:
        nonlocal ready
        if fresh and compiler.now < ready:
            return FAILURE
        status = child(fresh)
        if status < RUNNING:
            ready = compiler.now + ticks()
        return status

    return tick


def every(compiler: Compiler, node: Node, observed: Observed | None) -> Tick:
    """Starts its child again some ticks after its success."""
    (child, _), ticks = compiler.child(node.children[0], observed), compiler.ticks(node)
    due = 0  # the first tick in which the child may start
    before = FAILURE  # its status in the tick before; RUNNING at a start: it was aborted
    started = False  # True: the child is running

    def tick(fresh: bool) -> int:
        nonlocal due, before, started
        if fresh:
            started = False
            due = due if before == SUCCESS else 0
        if not started and compiler.now < due:
            before = RUNNING
            return AGAIN
        before = child(not started)
        started = before >= RUNNING
        if before == SUCCESS:
            due = compiler.now + ticks()
        return before

    return tick


def action(compiler: Compiler, node: Node, _: Observed | None) -> Tick:
    """Acts on the world: a function of the domain."""
    assert isinstance(node.args, ActionArgs)
    return compiler.action(node.args)


def always(_: Compiler, node: Node, __: Observed | None) -> Tick:
    """Has one status."""
    # AGAIN, since no action runs for whose end a simulator could wait.
    assert isinstance(node.args, AlwaysArgs)
    status = {"success": SUCCESS, "failure": FAILURE, "running": AGAIN}[node.args.status]
    return lambda _fresh: status


def assign(compiler: Compiler, node: Node, _: Observed | None) -> Tick:
    """Writes a key and succeeds."""
    assert isinstance(node.args, SetArgs)
    write = compiler.writer(node.args.assigned)

    def tick(_fresh: bool) -> int:
        write()
        return SUCCESS

    return tick


def when(compiler: Compiler, node: Node, observed: Observed | None) -> Tick:
    """Runs its child while a condition holds."""
    guard = guard_of(node)
    holds, checks_itself = compiler.holds(guard.condition), guard.checks_itself
    seen = Guard(0, holds)
    if observed is not None and guard.interrupts:
        seen.branch = observed.branch
        observed.guards.append(seen)
    child, stop = compiler.child(node.children[0], observed)

    def tick(fresh: bool) -> int:
        if fresh:
            seen.truth = true_now = holds()
            return child(True) if true_now else FAILURE
        if checks_itself and not holds():
            stop()
            return FAILURE
        return child(False)

    return tick
