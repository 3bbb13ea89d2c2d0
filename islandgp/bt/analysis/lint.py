"""The warnings of `check`: valid but probably unintended parts of a tree file.

The expanded tree is analysed; a warning is reported at the place in the file where the part is
written, with a reason.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from islandgp.bt.analysis.conflicts import conflicts
from islandgp.bt.analysis.context import Spot, abort_effects, contradictions, never, spots
from islandgp.bt.analysis.satisfiability import Conditions, excludes, keys_of
from islandgp.bt.analysis.simplify import (
    RULES,
    double_inverter,
    holds_anyway,
    never_gets_there,
    shorter_condition,
    whole_numbers,
)
from islandgp.bt.core.condition import Condition, ConditionExpr, opposite
from islandgp.bt.core.kinds import kind_of
from islandgp.bt.core.language import parse_placed
from islandgp.bt.core.node import FAILURE, ParallelArgs, Place, size, walk
from islandgp.bt.core.printer import condition_text, head
from islandgp.bt.core.vocabulary import Vocabulary

ADVICE: Final = frozenset(
    {"needless-guard", "long-condition", "whole-number", "double-inverter", "needless-abort"}
)
"""Codes of parts that could be removed."""


REFUSED: Final = frozenset({"shared-resource"})  # codes that `check` reports as errors


@dataclass(frozen=True, slots=True, order=True)
class LintWarning:
    """A warning about a place in a file."""

    line: int  # from 1
    column: int
    message: str  # with the reason
    code: str = ""  # does not change between versions; docs/language.md lists them


def warnings(
    text: str, vocabulary: Vocabulary, *, name: str = "<tree>", folder: Path | None = None
) -> list[LintWarning]:
    """The warnings about a tree file, in its order, each once.

    A part of a subtree that could be removed is reported if it could be removed at every use of
    the subtree. Any other warning that holds at some uses only is reported at these uses, and one
    about an included subtree too.

    Args:
        text: of the file.
        vocabulary: the actions and keys of the domain.
        name: of the file in messages.
        folder: of the file, as for `parse`.

    Raises:
        TreeError: the text is not a tree of the language.
    """
    tree, source, unused = parse_placed(text, vocabulary, name=name, folder=folder)
    never_run: set[int] = set()  # places below a node that never runs: one warning is enough
    nodes = list(spots(tree, vocabulary))
    doubts: dict[tuple[Place, str], dict[int, str]] = {}  # by origin and code: message by place
    for spot in nodes:
        for at, code, message in () if spot.place in never_run else _about(spot):
            doubts.setdefault((source[at].origin, code), {})[at] = message
            if code == "unreachable":
                never_run.update(range(at, at + size(nodes[at].node)))
    for first, second, resource, *_ in conflicts(tree, vocabulary):
        names = [head(nodes[at].node) for at in (first, second)]
        message = (
            f"{names[1]} can run in the same tick as {names[0]} in line {source[first].line}, but"
            f" both use {resource}"
        )
        doubts.setdefault((source[second].origin, "shared-resource"), {})[second] = message
    reached: dict[Place, list[int]] = {}  # places that can run, by origin
    for at, origin in enumerate(place.origin for place in source):
        if at not in never_run:
            reached.setdefault(origin, []).append(at)
    distinct: dict[tuple[tuple[int, int], str], str] = {}
    for (origin, code), messages in doubts.items():
        everywhere = messages.keys() >= {*reached.get(origin, ())}
        if code in ADVICE and not everywhere:
            continue
        for at in sorted(messages, reverse=True):
            line, column, _, uses = source[at]
            own = (line, column)  # a node of a `for` may have no use around it
            distinct[own if everywhere or not uses else uses[0], code] = messages[at]
    doubtful = [LintWarning(*at, message, code) for (at, code), message in distinct.items()]
    never_used = [
        LintWarning(line, column, f"{kind} {name!r} is never used", f"unused-{kind}")
        for kind, line, column, name in unused
    ]
    return sorted([*never_used, *doubtful])


def _about(spot: Spot) -> Iterator[tuple[int, str, str]]:
    """Warnings about one node: (place, code, message)."""
    at, node, context, _ = spot
    guard, text = node.guard, condition_text(node.guard.condition) if node.guard else ""
    if guard and never(guard, context):
        why = _why(context.at_start, guard.condition, context.vocabulary) or " on any blackboard"
        yield at + 1, "unreachable", f"this branch can never run: {text} can't hold{why}"
        return
    if guard and holds_anyway(node, context):
        why = _why(context.at_start, opposite(guard.condition), context.vocabulary)
        yield at, "needless-guard", f"this guard is redundant: {text} always holds{why}"
        return
    for rule in RULES[node.kind]:
        if rule in _CODES and (rewrite := rule(node, context)):
            yield at, _CODES[rule], rewrite[1]
        elif rule is never_gets_there and (rewrite := rule(node, context)):
            place_of_next = at + 1 + sum(map(size, rewrite[0].children))
            yield place_of_next, "unreachable", f"this branch can never run: {rewrite[1]}"
    for count in node.args if isinstance(node.args, ParallelArgs) else ():
        if isinstance(count, int | float) and count > len(node.children):
            message = f"{head(node)} has {len(node.children)} children, so it needs all of them"
            yield at, "parallel-count", message
    if guard and guard.abort in _INERT:
        stops_child, interrupts = abort_effects(node, context)
        if not (stops_child if guard.abort == "self" else interrupts):
            message = f"abort {guard.abort} has no effect here: {_INERT[guard.abort]}"
            yield at, "needless-abort", message
    for needed, holding in contradictions(node, context):
        if not _undone(needed, spot):
            why = f"which can't hold{_why(holding, needed, context.vocabulary)}"
            needs = f"it needs {condition_text(needed)}, {why}"
            yield at, "never-succeeds", f"{node.action} can never succeed here: {needs}"
            return


_CODES: Final = {
    double_inverter: "double-inverter",
    shorter_condition: "long-condition",
    whole_numbers: "whole-number",
}
"""Codes of the rules of `simplify` whose reasons are warnings."""

_INERT: Final = {
    "self": "its child ends in the tick in which it starts, or the condition stays true",
    "lower": "there is no later branch that it could stop",
}


def _undone(needed: Condition, spot: Spot) -> bool:
    """True if an action earlier in the tick may change what an action needs.

    The blackboard has the values at the start of the tick. After a success a selector does not
    continue, so that the success of an earlier action below guards alone changes nothing.
    """
    actions = spot.context.vocabulary.action
    sign = actions(spot.node.action).changes.get(needed.key, 0)
    for above, index in spot.above if sign else ():
        chooses = kind_of(above.node).advance_status == FAILURE
        for child in above.node.children[:index]:
            ends_it = chooses and all(each.guard or each.action for each in walk(child))
            changes = (actions(each.action).changes.get(needed.key, 0) for each in walk(child))
            if not ends_it and any(change * sign < 0 for change in changes):
                return True
    return False


def _why(holding: Conditions, expr: ConditionExpr, vocabulary: Vocabulary) -> str:
    """The conditions by which another one cannot hold, as few as possible, as a clause."""
    kept = [*holding]
    for each in holding:
        rest = [other for other in kept if other is not each]
        kept = rest if excludes(tuple(rest), expr) else kept
    texts = [
        f"{key} is {'a whole number, ' * (entry.whole and not entry.words)}{entry.meaning}"
        for key, entry in vocabulary.keys.items()
        if any(key in keys_of(each) for each in kept if each in vocabulary.always)
    ]
    texts += [f"{condition_text(c)} holds here" for c in kept if c not in vocabulary.always]
    return f", as {' and '.join(texts)}" * bool(texts)
