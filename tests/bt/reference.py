"""A slow interpreter of trees, written from `docs/semantics.md` and nothing else.

It walks the nodes and keeps their state in the open. A tick has two phases, as
in the table: first every guard that is active or observed is checked, from the
root down in document order; then the tree is ticked. Where the engine
keeps the last known truth of a guard, this one keeps the last blackboard.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Mapping

import numpy as np

from islandgp.bt.core.condition import Condition, ConditionExpr
from islandgp.bt.core.engine import ABORTED
from islandgp.bt.core.node import AGAIN, FAILURE, RUNNING, SUCCESS, Node, count_of, guard_of
from islandgp.seeding import Stream, stream

NO_DECORATORS = (
    "selector", "sequence", "parallel", "reactive_selector", "reactive_sequence", "action",
    "pipeline", "round_robin", "recovery", "always", "random_selector", "if_else",
)  # fmt: skip


class Live:
    """A node and what it remembers between ticks."""

    def __init__(self, node: Node, places: Iterator[int]) -> None:
        self.node = node
        self.place = next(places)
        self.children = [Live(child, places) for child in node.children]
        self.running = False
        self.at = 0  # selector, sequence, pipeline, round_robin, recovery: the current branch
        self.status = FAILURE  # in the last tick; of an aborted node RUNNING
        self.statuses: list[int] = []  # parallel: of each child
        self.successes = 0  # repeater
        self.failures = 0  # retry
        self.visited = False  # when: in this activation of its composite
        self.broken = False  # when: its condition failed while its child ran
        self.ticks = 0  # wait, timeout: since its start
        self.free = 0  # cooldown, every: the first tick in which its child may start
        self.order: list[int] = []  # random_selector: the children that are not yet tried
        self.rng = stream(0, Stream.ORDER, slot=self.place + 1)


class Reference:
    def __init__(
        self,
        tree: Node,
        actions: Mapping[str, Callable[[bool], int]],
        board: list[float],
        places: Mapping[str, int],
        watch: Callable[[int, int], None],
        step_s: float = 1.0,
    ) -> None:
        self.step_s = step_s
        self.now = 0  # number of the tick
        self.root = Live(tree, iter(range(10**9)))
        self.actions = actions
        self.board = board
        self.places = places
        self.before = list(board)
        self.watch = watch
        self.cut_short = False  # a parallel stopped a running child in this tick

    def tick(self) -> int:
        self.cut_short = False
        self.now += 1
        if self.root.running:
            self.check(self.root)
        status = self.run(self.root)
        self.before = list(self.board)
        return AGAIN if status == RUNNING and self.cut_short else status

    # The first phase: guards.

    def check(self, live: Live) -> None:
        kind = live.node.kind
        if kind in ("selector", "sequence"):
            for branch in range(live.at):
                for guard in guards(live.children[branch]):
                    if guard.visited and self.turned_true(guard):
                        self.abort(live.children[live.at])
                        live.at = branch
                        forget(live.children[branch:])
                        return
            self.check(live.children[live.at])
        elif kind == "when":
            if guard_of(live.node).checks_itself and not self.holds(live, self.board):
                self.abort(live.children[0])
                live.broken = True
            else:
                self.check(live.children[0])
        else:
            for child in live.children:
                if child.running:
                    self.check(child)

    def turned_true(self, guard: Live) -> bool:
        observed = guard_of(guard.node).interrupts
        return observed and not self.holds(guard, self.before) and self.holds(guard, self.board)

    def holds(self, guard: Live, board: list[float]) -> bool:
        return holds(guard_of(guard.node).condition, board, self.places)

    def abort(self, live: Live) -> None:
        live.broken = False
        if live.running:
            live.running = False
            self.watch(live.place, ABORTED)
        for child in live.children:
            self.abort(child)

    # The second phase: the tick.

    def run(self, live: Live) -> int:
        kind = live.node.kind
        if kind == "action":
            status = self.actions[live.node.action](not live.running)
        elif kind == "selector":
            status = self.composite(live, FAILURE)
        elif kind == "sequence":
            status = self.composite(live, SUCCESS)
        else:
            status = getattr(self, kind)(live)
        live.running = status in (RUNNING, AGAIN)
        live.status = RUNNING if live.running else status
        self.watch(live.place, status)
        return status

    def composite(self, live: Live, advance_status: int) -> int:
        if not live.running:
            live.at = 0
            forget(live.children)
        while True:
            status = self.run(live.children[live.at])
            if status != advance_status or live.at == len(live.children) - 1:
                return status
            live.at += 1

    def reactive_selector(self, live: Live) -> int:
        return self.reactive(live, FAILURE)

    def reactive_sequence(self, live: Live) -> int:
        return self.reactive(live, SUCCESS)

    def reactive(self, live: Live, advance_status: int) -> int:
        for index, child in enumerate(live.children):
            status = self.run(child)
            if status != advance_status:
                for later in live.children[index + 1 :]:
                    self.abort(later)
                return AGAIN if status == RUNNING and index > 0 else status
        return advance_status

    def wait(self, live: Live) -> int:
        live.ticks = live.ticks + 1 if live.running else 0
        if live.ticks < self.duration(live):
            return AGAIN
        return self.run(live.children[0])

    def timeout(self, live: Live) -> int:
        live.ticks = live.ticks + 1 if live.running else 0
        if live.ticks == self.duration(live):
            self.abort(live.children[0])
            return FAILURE
        status = self.run(live.children[0])
        return AGAIN if status == RUNNING else status

    def cooldown(self, live: Live) -> int:
        if not live.running and self.now < live.free:
            return FAILURE
        status = self.run(live.children[0])
        if status in (SUCCESS, FAILURE):
            live.free = self.now + self.duration(live)
        return status

    def duration(self, live: Live) -> int:
        """In ticks: the first that is at least so many seconds later."""
        (seconds,) = live.node.args
        return next(n for n in range(1, 10**6) if n * self.step_s >= seconds)

    def parallel(self, live: Live) -> int:
        if not live.running:
            live.statuses = [RUNNING] * len(live.children)
        for index, child in enumerate(live.children):
            if live.statuses[index] in (RUNNING, AGAIN):
                live.statuses[index] = self.run(child)
        count = {"one": 1, "all": len(live.children)}
        success, failure = (count.get(policy, policy) for policy in live.node.args)
        status = judge(live.statuses, success, failure)
        if status in (SUCCESS, FAILURE):
            for child in live.children:
                self.cut_short = self.cut_short or child.running
                self.abort(child)
        return status

    def every(self, live: Live) -> int:
        if not live.running and live.status != SUCCESS:
            live.free = 0
        if not live.children[0].running and self.now < live.free:
            return AGAIN
        status = self.run(live.children[0])
        if status == SUCCESS:
            live.free = self.now + self.duration(live)
        return status

    def until_failure(self, live: Live) -> int:
        status = self.run(live.children[0])
        return AGAIN if status == SUCCESS else status

    def until_success(self, live: Live) -> int:
        status = self.run(live.children[0])
        return AGAIN if status == FAILURE else status

    def always(self, live: Live) -> int:
        (word,) = live.node.args
        return {"success": SUCCESS, "failure": FAILURE, "running": AGAIN}[word]

    def pipeline(self, live: Live) -> int:
        live.at = live.at if live.running else 0
        for index, child in enumerate(live.children):
            status = self.run(child)
            if status == FAILURE:
                break
            if child.running and index >= live.at:
                live.at = index
                return status if index == 0 else AGAIN
        for child in live.children:
            self.cut_short |= child.running
            self.abort(child)
        return SUCCESS if status == SUCCESS or status in (RUNNING, AGAIN) else FAILURE

    def round_robin(self, live: Live) -> int:
        if not live.running:
            live.failures = 0
            if live.status == RUNNING:
                live.at = 0
        while True:
            status = self.run(live.children[live.at])
            if status in (RUNNING, AGAIN):
                return status
            live.at = (live.at + 1) % len(live.children)
            if status == SUCCESS:
                return SUCCESS
            live.failures += 1
            if live.failures == len(live.children):
                live.at = 0
                return FAILURE

    def random_selector(self, live: Live) -> int:
        if not live.running:
            live.order = live.rng.permutation(len(live.children)).tolist()
        while True:
            status = self.run(live.children[live.order[0]])
            if status != FAILURE or len(live.order) == 1:
                return status
            live.order.pop(0)

    def if_else(self, live: Live) -> int:
        if not live.running:
            live.at = 0
        status = self.run(live.children[live.at])
        if live.at > 0 or status in (RUNNING, AGAIN):
            return status
        live.at = 1 if status == SUCCESS else 2
        return self.run(live.children[live.at]) if live.at < len(live.children) else FAILURE

    def recovery(self, live: Live) -> int:
        if not live.running:
            live.at = live.successes = 0
        child, remedy = live.children
        while True:
            status = self.run(remedy if live.at else child)
            if live.at and status != SUCCESS:
                return status
            if not live.at and (status != FAILURE or live.successes == count_of(live.node)):
                return status
            live.successes += live.at
            live.at = 1 - live.at

    def inverter(self, live: Live) -> int:
        status = self.run(live.children[0])
        return {SUCCESS: FAILURE, FAILURE: SUCCESS}.get(status, status)

    def repeater(self, live: Live) -> int:
        if not live.running:
            live.successes = 0
        status = self.run(live.children[0])
        if status == SUCCESS:
            live.successes += 1
            return SUCCESS if live.successes == count_of(live.node) else AGAIN
        return status

    def retry(self, live: Live) -> int:
        if not live.running:
            live.failures = 0
        status = self.run(live.children[0])
        if status == FAILURE:
            live.failures += 1
            return FAILURE if live.failures == count_of(live.node) else AGAIN
        return status

    def force_success(self, live: Live) -> int:
        status = self.run(live.children[0])
        return SUCCESS if status == FAILURE else status

    def force_failure(self, live: Live) -> int:
        status = self.run(live.children[0])
        return FAILURE if status == SUCCESS else status

    def when(self, live: Live) -> int:
        if live.broken:
            live.broken = False
            return FAILURE
        if not live.running:
            live.visited = True
            if not self.holds(live, self.board):
                return FAILURE
        return self.run(live.children[0])


def judge(statuses: list[int], success: float, failure: float) -> int:
    """What a parallel's children make of it."""
    if statuses.count(FAILURE) >= min(failure, len(statuses)):
        return FAILURE
    if statuses.count(SUCCESS) >= min(success, len(statuses)):
        return SUCCESS
    if set(statuses) <= {SUCCESS, FAILURE}:
        return FAILURE
    return AGAIN if AGAIN in statuses else RUNNING


def holds(expr: ConditionExpr, board: list[float], places: Mapping[str, int]) -> bool:
    """Whether a condition holds, from the table of docs/language.md."""
    if not isinstance(expr, Condition):
        inside = [holds(part, board, places) for part in expr.parts]
        return {"and": all(inside), "or": any(inside), "not": not inside[0]}[expr.word]
    value = value_of(expr.key, board, places)
    number = value_of(expr.other, board, places) if expr.other else expr.number
    return {
        "<": value < number,
        "<=": value <= number,
        ">": value > number,
        ">=": value >= number,
        "==": value == number,
        "!=": value != number,
        "is": value != 0,
        "not": value == 0,
    }[expr.operator]


def value_of(text: str, board: list[float], places: Mapping[str, int]) -> float:
    """The value of a key or of a sum, in the arithmetic of IEEE 754."""
    keys = {name: np.float64(board[place]) for name, place in places.items()}
    with np.errstate(all="ignore"):
        return float(eval(re.sub(r"(?<![\w.])([0-9.]+)", r"f(\1)", text), {"f": np.float64}, keys))


def guards(branch: Live) -> Iterator[Live]:
    """The `when` nodes of a branch, down to its first composite or action."""
    while branch.node.kind not in NO_DECORATORS:
        if branch.node.kind == "when":
            yield branch
        branch = branch.children[0]


def forget(branches: list[Live]) -> None:
    for branch in branches:
        for guard in guards(branch):
            guard.visited = False
