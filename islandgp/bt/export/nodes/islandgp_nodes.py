"""Behaviours for py_trees 2 that keep the meaning of islandgp's trees.

`islandgp export` copies the classes below into the modules that it writes. The
library's own composites without memory start an interrupting branch before they
stop the interrupted one, interrupt whenever a condition *is* true, and resume the
running branch when the interrupting one fails. These stop the running branch first,
and interrupt when a condition *becomes* true. islandgp's docs/semantics.md describes
what each does in a tick.
"""

from fractions import Fraction
from math import ceil

from py_trees.behaviour import Behaviour
from py_trees.common import Access, Status
from py_trees.composites import Composite
from py_trees.decorators import Decorator


class SetKey(Behaviour):
    """Writes a key and succeeds; `value(blackboard)` reads `keys`."""

    def __init__(self, name, key, keys, value):
        """The class describes the arguments."""
        super().__init__(name)
        self.key, self.value = key, value
        self.client = self.attach_blackboard_client()
        self.client.register_key(key, access=Access.WRITE)
        for each in keys:
            self.client.register_key(each, access=Access.READ)

    def update(self):
        """Writes the key."""
        self.client.set(self.key, self.value(self.client))
        return Status.SUCCESS


class Through(Decorator):
    """Has the status of its child."""

    def update(self):
        """The status of the child."""
        return self.decorated.status


class When(Through):
    """Runs its child while `condition(blackboard)` holds.

    The blackboard is a client that may read `blackboard_keys`.
    `abort` is what a change of the condition stops. none: nothing, it is only checked at the
    start; self: the child; lower: later branches of the nearest InterruptibleSelector or
    InterruptibleSequence above; both: the child and later branches.
    """

    def __init__(self, name, blackboard_keys, condition, abort, child):
        """The class describes the arguments."""
        super().__init__(name, child)
        client = self.attach_blackboard_client()
        for key in blackboard_keys:
            client.register_key(key, access=Access.READ)
        self.condition = condition
        self.stops_itself = abort in ("self", "both")
        self.interrupts = abort in ("lower", "both")
        # The last value of the condition; None: not evaluated since the composite started.
        self.seen = None

    def holds(self):
        """True if the condition holds now."""
        return bool(self.condition(self.blackboards[0]))

    def tick(self):
        """Checks the condition, then ticks the child."""
        if self.status != Status.RUNNING:
            self.seen = holds = self.holds()
        else:
            holds = not self.stops_itself or self.holds()
        if not holds:
            self.stop(Status.FAILURE)  # stops a running child
            yield self
            return
        yield from super().tick()


class Interruptible(Composite):
    """Goes back to an earlier branch when its guard becomes true.

    The running branch is stopped before the other one starts. Otherwise it has memory.
    """

    hands_over = Status.INVALID  # the status of a child after which the next one starts

    def __init__(self, name, children):
        """The children are the branches, in the order of their urgency."""
        super().__init__(name, children)
        self.guards = [
            (branch, guard)
            for branch, child in enumerate(children[:-1])
            for guard in _guards(child)
        ]

    def tick(self):
        """Checks the observed guards, then ticks the branch that is due."""
        fresh = self.status != Status.RUNNING
        at = 0 if fresh else self._due()
        if fresh:
            self._forget(0)
            self.initialise()
        elif self.children[at] is not self.current_child:
            self.current_child.stop(Status.INVALID)
            self._forget(at)
            fresh = True
        while True:
            child = self.current_child = self.children[at]
            yield from child.tick()
            if child.status != self.hands_over or at == len(self.children) - 1:
                break
            if not fresh:
                # From now on the guards of this branch are observed; their values at the start
                # of the branch may be outdated.
                for branch, guard in self.guards:
                    if branch == at and guard.seen is not None:
                        guard.seen = guard.holds()
            fresh = True
            at += 1
        if child.status != Status.RUNNING:
            self.stop(child.status)
        self.status = child.status
        yield self

    def _due(self):
        """The branch of the first observed guard that became true, else the running branch."""
        current = self.children.index(self.current_child)
        for branch, guard in self.guards:
            if branch < current and guard.seen is not None:
                before, guard.seen = guard.seen, guard.holds()
                if guard.seen and not before:
                    return branch
        return current

    def _forget(self, first):
        """Guards from that branch on are not observed until they are evaluated again."""
        for branch, guard in self.guards:
            if branch >= first:
                guard.seen = None


class InterruptibleSelector(Interruptible):
    """Ticks its children in order until one does not fail."""

    hands_over = Status.FAILURE


class InterruptibleSequence(Interruptible):
    """Ticks its children in order until one does not succeed."""

    hands_over = Status.SUCCESS


class JudgedParallel(Composite):
    """Ticks every child that is not finished; then decides, failures first.

    `success` and `failure` are "one", "all" or a number: the children that decide.
    """

    def __init__(self, name, success, failure, children):
        """The class describes the arguments."""
        super().__init__(name, children)
        count = {"one": 1, "all": len(children)}
        self.needed = [min(count.get(each, each), len(children)) for each in (success, failure)]

    def tick(self):
        """Ticks the children, then decides."""
        fresh = self.status != Status.RUNNING
        if fresh:
            self.initialise()
        for child in self.children:
            if fresh or child.status == Status.RUNNING:
                yield from child.tick()
        results = [child.status for child in self.children]
        succeeded, failed = results.count(Status.SUCCESS), results.count(Status.FAILURE)
        succeeds, fails = succeeded >= self.needed[0], failed >= self.needed[1]
        self.current_child = self.children[-1]
        if succeeds or fails or succeeded + failed == len(results):
            for child in self.children:
                if child.status == Status.RUNNING:
                    child.stop(Status.INVALID)
            self.stop(Status.SUCCESS if succeeds and not fails else Status.FAILURE)
        else:
            self.status = Status.RUNNING
        yield self


class Timed(Through):
    """A decorator that lasts a number of seconds, as ticks that are `step_s` seconds apart."""

    def __init__(self, seconds, step_s, child):
        """`step_s` is above 0."""
        super().__init__(f"{type(self).__name__} {seconds}", child)
        if step_s is None:
            raise ValueError("expected create_tree(action, step_s) with the seconds of a tick")
        self.ticks = max(1, ceil(Fraction(str(seconds)) / Fraction(str(step_s))))
        self.left = 0

    def count(self):
        """Counts the ticks since the start; returns those that are left."""
        self.left = self.left - 1 if self.status == Status.RUNNING else self.ticks
        return self.left


class WaitTicks(Timed):
    """Starts its child some ticks after its own start."""

    def tick(self):
        """Waits, then ticks the child."""
        if self.count() > 0:
            self.status = Status.RUNNING
            yield self
            return
        yield from super().tick()


class TimeoutTicks(Timed):
    """Stops its child and fails if the child still runs some ticks after its start."""

    def tick(self):
        """Counts, then ticks the child."""
        if self.count() == 0:
            self.stop(Status.FAILURE)  # stops a running child
            yield self
            return
        yield from super().tick()


def _guards(branch):
    """The interrupting guards of a branch, down to its first node that is not a decorator."""
    while isinstance(branch, Decorator):
        if isinstance(branch, When) and branch.interrupts:
            yield branch
        branch = branch.decorated
