"""What must be true of the blackboard where a node stands in its tree.

A guard that checks itself (abort self or both) holds in each tick in which
anything below it runs; any guard holds in the tick in which its child starts.
From this follow guards that can never hold and guards that say nothing new.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from itertools import pairwise
from typing import Final, NamedTuple, TypeAlias

from islandgp.bt.node import Node
from islandgp.bt.vocabulary import NOTHING, Condition, Vocabulary

Conditions: TypeAlias = tuple[Condition, ...]

HOLDS: Final[dict[str, Callable[[float, float], bool]]] = {
    "<": lambda value, number: value < number,
    "<=": lambda value, number: value <= number,
    ">": lambda value, number: value > number,
    ">=": lambda value, number: value >= number,
    "==": lambda value, number: value == number,
    "!=": lambda value, number: value != number,
    "is": lambda value, _: value != 0,
    "not": lambda value, _: value == 0,
}
"""Whether a value on the blackboard and the number of a condition are in its relation."""


class Standing(NamedTuple):
    """Where a node stands: what holds there, and who observes its guards."""

    always: Conditions = ()  # in each tick in which the node runs
    at_start: Conditions = ()  # in the tick in which it starts; `always` is part of it
    observer: Conditions | None = None  # whenever its guards are observed; None: they never are
    vocabulary: Vocabulary = NOTHING  # what is known of actions and keys


def root_of(vocabulary: Vocabulary) -> Standing:
    """Where the root of a tree stands."""
    return Standing(vocabulary.always, vocabulary.always, None, vocabulary)


def condition_of(guard: Node) -> Condition:
    """The condition of a `when`."""
    key, operator, number, _ = guard.args
    return Condition(str(key), str(operator), float(number))


def checks_itself(guard: Node) -> bool:
    """Whether a `when` stops its own child."""
    return guard.args[3] in ("self", "both")


def interrupts(guard: Node) -> bool:
    """Whether a `when` stops later branches, if anybody observes it."""
    return guard.args[3] in ("lower", "both")


def chain(node: Node) -> list[Node]:
    """The guards of a branch, down to its first composite or action."""
    found = []
    while node.kind in ("when", "inverter", "repeater"):
        if node.kind == "when":
            found.append(node)
        node = node.children[0]
    return found


def with_aborts(branch: Node, change: Mapping[str, str]) -> Node:
    """The branch with other abort rules on the guards of its `chain`: those that `change` names."""
    if branch.kind not in ("when", "inverter", "repeater"):
        return branch
    args = branch.args
    if branch.kind == "when":
        args = (*args[:3], change.get(str(args[3]), args[3]))
    return Node(branch.kind, args, (with_aborts(branch.children[0], change),))


def exposes(branch: Node) -> bool:
    """Whether a composite would observe a guard of this branch."""
    return any(map(interrupts, chain(branch)))


def implies(known: Conditions, asked: Condition) -> bool:
    """Whether `asked` holds on every blackboard on which all of `known` hold."""
    about = [c for c in known if c.key == asked.key]
    return all(
        _holds(asked, value)
        for value in _samples([*about, asked])
        if all(_holds(c, value) for c in about)
    )


def excludes(known: Conditions, asked: Condition) -> bool:
    """Whether `asked` holds on no blackboard on which all of `known` hold."""
    about = [c for c in known if c.key == asked.key] + [asked]
    return not any(all(_holds(c, value) for c in about) for value in _samples(about))


def below(node: Node, standing: Standing, index: int) -> Standing:
    """Where the child of that index stands."""
    always, at_start, observer, vocabulary = standing
    if node.kind == "when":
        holds = condition_of(node)
        if checks_itself(node):
            always = (*always, holds)
        return Standing(always, (*at_start, holds), observer, vocabulary)
    if node.kind == "inverter":
        return standing
    if node.kind == "repeater":  # starts its child again in later ticks
        return Standing(always, always, observer, vocabulary)
    if node.kind == "parallel":
        return Standing(always, at_start, None, vocabulary)
    last = index == len(node.children) - 1
    # The first branch starts with its composite, unless its guard can call it back later.
    starts = index == 0 and (last or not exposes(node.children[0]))
    observer = None if last else always
    return Standing(always, at_start if starts else always, observer, vocabulary)


def may_interrupt(guard: Node, standing: Standing) -> bool:
    """Whether a `when` can ever stop a later branch where it stands."""
    if standing.observer is None or not interrupts(guard):
        return False
    holds = condition_of(guard)
    # What is never true, or true all the time, does not turn true.
    return not (excludes(standing.observer, holds) or implies(standing.observer, holds))


def _holds(condition: Condition, value: float) -> bool:
    return HOLDS[condition.operator](value, condition.number)


def _samples(conditions: Iterable[Condition]) -> list[float]:
    """One value for each stretch on which none of the conditions changes its truth."""
    marks = sorted({0.0, *(c.number for c in conditions)})
    between = [(a + b) / 2 for a, b in pairwise(marks)]
    return [marks[0] - 1, *marks, *between, marks[-1] + 1]
