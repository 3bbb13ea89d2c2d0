"""How a node can end, from how the actions in it can end."""

from __future__ import annotations

from typing import Final, TypeAlias

from islandgp.bt.node import FAILURE, SUCCESS, Node, condition_of
from islandgp.bt.truth import Standing, below, excludes, may_interrupt

Ends: TypeAlias = frozenset[int]  # of SUCCESS and FAILURE

_FAILS: Final[Ends] = frozenset({FAILURE})
HANDS_OVER: Final[dict[str, int]] = {"selector": FAILURE, "sequence": SUCCESS}
"""The status of a child with which a composite goes on to the next one."""


def ends(node: Node, standing: Standing) -> Ends:
    """The statuses with which a node can end, or more; never fewer."""
    if node.kind == "action":
        return standing.vocabulary.action(str(node.args[0])).statuses & {FAILURE, SUCCESS}
    if node.kind == "when":
        if never(node, standing):
            return _FAILS
        return ends(node.children[0], below(node, standing, 0)) | _FAILS
    if node.kind == "inverter":
        return frozenset(SUCCESS - end for end in ends(node.children[0], standing))
    if node.kind == "repeater":
        return ends(node.children[0], below(node, standing, 0))
    each = [ends(child, below(node, standing, i)) for i, child in enumerate(node.children)]
    if node.kind == "parallel":
        return _parallel(node, each)
    go_on = HANDS_OVER[node.kind]
    reached: Ends = frozenset({go_on})
    for child in each:
        if go_on not in reached:
            break
        reached = (reached - {go_on}) | child
    return reached


def dead_end(node: Node, standing: Standing) -> int | None:
    """The first child of a selector or sequence behind which it never goes on; None: there is none.

    The last child does not count.
    """
    go_on = HANDS_OVER[node.kind]
    for index, child in enumerate(node.children[:-1]):
        if go_on not in ends(child, below(node, standing, index)):
            return index
    return None


def never(guard: Node, standing: Standing) -> bool:
    """Whether the condition of a `when` can't hold when the guard starts."""
    return excludes(standing.at_start, condition_of(guard))


def idle(node: Node, standing: Standing) -> int | None:
    """With what a node ends at once, whenever it starts, without doing anything; else None.

    Such a node calls no action and stops no other node.
    """
    if node.kind == "inverter":
        end = idle(node.children[0], standing)
        return None if end is None else SUCCESS - end
    if node.kind == "repeater":
        end = idle(node.children[0], below(node, standing, 0))
        return end if end == FAILURE else None
    if node.kind != "when" or may_interrupt(node, standing):
        return None
    if never(node, standing):
        # What it guards never starts, but guards in there could only be observed after a start.
        return FAILURE
    return FAILURE if idle(node.children[0], below(node, standing, 0)) == FAILURE else None


def _parallel(node: Node, each: list[Ends]) -> Ends:
    success, failure = node.args
    found = set()
    # Children that all ended without a decision fail it, so `failure all` can fail with one.
    if any(FAILURE in e for e in each) and (
        failure == "one" or success == "all" or all(FAILURE in e for e in each)
    ):
        found.add(FAILURE)
    if (any if success == "one" else all)(SUCCESS in e for e in each):
        found.add(SUCCESS)
    return frozenset(found)
