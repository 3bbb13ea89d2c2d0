"""The warnings of `check`: valid but probably unintended parts of a tree file.

The expanded tree is analysed; a warning is reported at the place in the file where the part is
written, with a reason.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import cache, partial
from pathlib import Path
from typing import Final, NamedTuple, TypeAlias

from islandgp.bt.analysis.conflicts import conflicts
from islandgp.bt.analysis.context import (
    NodeContext,
    abort_effects,
    always_holds,
    child_contexts,
    conditions_when_evaluated,
    ends_at_once,
    may_interrupt,
    never,
    root_context,
)
from islandgp.bt.analysis.outcomes import contradictions, dead_end
from islandgp.bt.analysis.satisfiability import (
    Conditions,
    excludes,
    implies,
    shortened,
    without_decimals,
)
from islandgp.bt.core.condition import ConditionExpr, terms
from islandgp.bt.core.kinds import advance_status, kind_of
from islandgp.bt.core.language import SourceSpan, parse_placed
from islandgp.bt.core.node import FAILURE, SUCCESS, GuardArgs, Node, ParallelArgs, Place, size
from islandgp.bt.core.printer import condition_text, head
from islandgp.bt.core.source import Source, plain
from islandgp.bt.core.vocabulary import Key, Vocabulary

Above: TypeAlias = tuple[tuple[Node, int], ...]
"""The ancestors of a node, each with the index of the child that leads to the node."""


CODES: Final = {
    "unreachable": "a branch that can never run",
    "needless-guard": "a redundant guard",
    "long-condition": "a condition that is equivalent to a shorter one",
    "shared-resource": "two actions that use one resource in the same tick",
    "whole-number": "a threshold with decimals of a whole number",
    "double-inverter": "an inverter of an inverter",
    "never-succeeds": "an action that can never succeed in its place",
    "needless-abort": "an abort rule that stops nothing",
    "parallel-count": "a parallel that needs more children than it has",
    "unused-subtree": "a named subtree that is never used",
    "unused-constant": "a constant that is never used",
    "unused-parameter": "a parameter that its subtree does not use",
}
"""Codes of warnings, which do not change between versions, with their meanings."""


ADVICE: Final = frozenset(
    {"needless-guard", "long-condition", "whole-number", "double-inverter", "needless-abort"}
)
"""Codes of parts that could be removed."""


REFUSED: Final = frozenset({"shared-resource"})
"""Codes that `check` reports as errors."""


@dataclass(frozen=True, slots=True, order=True)
class LintWarning:
    """A warning about a place in a file."""

    line: int  # from 1
    column: int
    message: str  # with the reason
    code: str = ""  # of CODES

    def text(self, source: str, *, name: str) -> str:
        """The warning with the offending line and a caret, in the form of errors."""
        file = Source(plain(source), name)
        return str(file.error(f"warning: {self.message}", self.line, self.column))


Undone: TypeAlias = Callable[[str, int], Sequence[bool]]
"""`_undone_changes` of the places of a tree, by key and direction."""


class _Context(NamedTuple):
    """A node of the expanded tree with its context."""

    node: Node
    context: NodeContext
    above: Above


def warnings(
    text: str,
    vocabulary: Vocabulary,
    *,
    name: str = "<tree>",
    folder: Path | None = None,
) -> list[LintWarning]:
    """The warnings about a tree file, in its order, each once.

    A part of a subtree that could be removed is reported if it could be removed at every use of
    the subtree. Any other warning that holds at some uses only names these uses. Warnings about an
    included subtree are reported at its use.

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
    places = list(_places(tree, root_context(tree, vocabulary), ()))
    undone = cache(partial(_undone_changes, places))
    doubts: dict[tuple[Place, str], dict[int, str]] = {}  # by origin and code: message by place
    for index, place in enumerate(places):
        if index in never_run:
            continue
        for at, code, message in _about(place, index, undone):
            doubts.setdefault((source[at].origin, code), {})[at] = message
            if code == "unreachable":
                never_run.update(range(at, at + size(places[at].node)))
    for first, second, resource, *_ in conflicts(tree, vocabulary):
        names = [head(places[at].node) for at in (first, second)]
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
        others = [source[at] for at in reached.get(origin, ()) if at not in messages]
        if code in ADVICE and others:
            continue
        uses = _uses_of([source[at] for at in messages], others) if others else ""
        for at in sorted(messages, reverse=True):
            line, column, *_ = source[at]
            distinct[(line, column), code] = messages[at] + uses
    doubtful = [LintWarning(*at, message, code) for (at, code), message in distinct.items()]
    never_used = [
        LintWarning(line, column, f"{kind} {name!r} is never used", f"unused-{kind}")
        for kind, line, column, name in unused
    ]
    return sorted([*never_used, *doubtful])


def _uses_of(places: Sequence[SourceSpan], others: Sequence[SourceSpan]) -> str:
    """The uses of a subtree to which a warning applies, for its message.

    Args:
        places: of a node, in the uses to which the warning applies.
        others: of the same node, in all other uses.
    """
    deepest = max(len(place.uses) for place in places)
    for level in range(1, deepest + 1):  # from the inside: the first level that separates them
        chains = {place.uses[-level:] for place in places}
        if chains.isdisjoint(place.uses[-level:] for place in others):
            uses = sorted({chain[0] for chain in chains})
            listing = ", ".join(f"{line}:{column}" for line, column in uses)
            return f"; in the use{'s' * (len(uses) != 1)} at {listing}"
    return "; in some uses of the subtree"


def _places(node: Node, context: NodeContext, above: Above) -> Iterator[_Context]:
    yield _Context(node, context, above)
    contexts = child_contexts(node, context)
    for index, (child, here) in enumerate(zip(node.children, contexts, strict=True)):
        yield from _places(child, here, (*above, (node, index)))


def _about(place: _Context, at: int, undone: Undone) -> Iterator[tuple[int, str, str]]:
    """Warnings about one node: (place, one of CODES, message)."""
    node, context, _ = place
    kind = kind_of(node)
    if kind.advance_status is not None:
        yield from _never_goes_on(node, context, at)
    elif kind.inverts and kind_of(node.children[0]).inverts:
        yield at, "double-inverter", "double inverter: the two undo each other"
    elif isinstance(node.args, ParallelArgs):
        for count in node.args:
            if isinstance(count, int | float) and count > len(node.children):
                message = f"{head(node)} has {len(node.children)} children, so it needs all of them"
                yield at, "parallel-count", message
    elif node.guard:
        yield from _guard(node.guard, place, at)
    elif node.action:
        yield from _action(place, at, undone)


def _never_goes_on(node: Node, context: NodeContext, at: int) -> Iterator[tuple[int, str, str]]:
    index = dead_end(node, context)
    if index is not None:
        verb = "fails" if advance_status(node) == FAILURE else "succeeds"
        message = (
            f"this branch can never run: {head(node.children[index])} before it never {verb},"
            f" so the {node.kind} never reaches it"
        )
        yield at + 1 + sum(map(size, node.children[: index + 1])), "unreachable", message


def _guard(guard: GuardArgs, place: _Context, at: int) -> Iterator[tuple[int, str, str]]:
    expr, context = guard.condition, place.context
    if never(guard, context):
        reason = _why_not(expr, context.at_start, place)
        yield at + 1, "unreachable", f"this branch can never run: {reason}"
        return
    if always_holds(guard, context) and not may_interrupt(guard, context):
        message = f"this guard is redundant: {_reason(expr, place)}"
        yield at, "needless-guard", message
        return
    if (same := without_decimals(expr, context.vocabulary)) != expr:
        pairs = zip(terms(expr), terms(same), strict=True)
        name = next(term.key for term, new in pairs if term != new)
        message = f"{name} is a whole number: {condition_text(expr)} is {condition_text(same)}"
        yield at, "whole-number", message
    effects = dict(zip(("self", "lower"), abort_effects(place.node, context), strict=True))
    if not effects.get(guard.abort, True):
        reason = _inert(guard.abort, place)
        yield at, "needless-abort", f"abort {guard.abort} has no effect here: {reason}"
    if (same := shortened(expr, conditions_when_evaluated(guard, context))) != expr:
        message = f"this condition is equivalent to a shorter one: {condition_text(same)}"
        yield at, "long-condition", message


def _action(place: _Context, at: int, undone: Undone) -> Iterator[tuple[int, str, str]]:
    context, name = place.context, place.node.action
    for needed, holding in contradictions(place.node, context):
        sign = context.vocabulary.action(name).changes.get(needed.key, 0)
        if sign and undone(needed.key, sign)[at]:
            continue
        reason = _why_not(needed, holding, place)
        yield at, "never-succeeds", f"{name} can never succeed here: {reason}"
        return


def _undone_changes(places: Sequence[_Context], key: str, sign: int) -> list[bool]:
    """For each place: True if an earlier action in the tick changes a key in the other direction.

    The blackboard has the values at the start of the tick. An action may undo another one's change
    of a key in the same tick. `sign` is the direction of the change that may be undone.
    """
    undone: list[bool] = []

    def visit(before: bool) -> tuple[bool, bool]:
        """Whether an action below changes the key, and whether the node may still fail."""
        node, context, _ = places[len(undone)]
        undone.append(before)
        if node.action:
            action = context.vocabulary.action(node.action)
            return action.changes.get(key, 0) * sign < 0, False
        changes = stays = False
        for index in range(len(node.children)):
            below_changes, below_stays = visit(before)
            changes |= below_changes
            stays |= below_stays or (below_changes and not _passes_up(node, index))
            # After a success a selector does not continue.
            before |= below_stays if kind_of(node).advance_status == FAILURE else below_changes
        return changes, stays

    visit(False)
    return undone


def _passes_up(node: Node, index: int) -> bool:
    """True if the node succeeds in the tick in which that child succeeds."""
    last = index == len(node.children) - 1
    kind = kind_of(node)
    if kind.decorates:
        return kind.ends[SUCCESS] == SUCCESS
    return kind.advance_status == FAILURE or (kind.advance_status == SUCCESS and last)


def _why_not(needed: ConditionExpr, conditions: Sequence[ConditionExpr], place: _Context) -> str:
    """The reason why a guard's condition, or one that an action needs, contradicts `conditions`."""
    text, keys = condition_text(needed), {key for term in terms(needed) for key in term.keys}
    lead = f"it needs {text}" if place.node.action else f"{text} can't hold"
    if excludes((), needed):
        return f"{lead} on any blackboard"
    guards = [
        c
        for c in _guards(place.above)
        if c in conditions and not keys.isdisjoint(key for t in terms(c) for key in t.keys)
    ]
    vocabulary = place.context.vocabulary
    against = [c for c in guards if excludes((c,), needed)][-1:]
    if not against and excludes(vocabulary.always, needed):
        meant = (_meaning(key, vocabulary.keys[key]) for key in sorted(keys))
        return f"{lead}, as {' and '.join(meant)}"
    if not against and excludes((*vocabulary.always, *guards), needed):
        against = guards
    if not against:
        return f"{lead}, {_before(conditions, place, lambda facts: excludes(facts, needed))}"
    guard = "guard above it requires" if len(against) == 1 else "guards above it require"
    return f"{lead}, but the {guard} {' and '.join(map(condition_text, against))}"


def _meaning(name: str, key: Key) -> str:
    whole = "a whole number, " if key.whole and not key.words else ""
    return f"{name} is {whole}{key.meaning}"


def _reason(expr: ConditionExpr, place: _Context) -> str:
    """The reason why a condition always holds."""
    sufficient = [c for c in _guards(place.above) if implies((c,), expr)]
    if sufficient:
        return f"the guard above it already requires {condition_text(sufficient[-1])}"
    text, context = f"{condition_text(expr)} always holds", place.context
    if implies((*context.vocabulary.always, *_guards(place.above)), expr):
        return text
    return f"{text}, {_before(context.at_start, place, lambda facts: implies(facts, expr))}"


def _before(
    conditions: Sequence[ConditionExpr], place: _Context, suffices: Callable[[Conditions], bool]
) -> str:
    """What the branches before a place leave over, as the reason of a warning."""
    declared = place.context.vocabulary.always
    known = (*declared, *_guards(place.above))
    facts = [c for c in conditions if c not in known]
    facts = [c for c in facts if suffices((*declared, c))][:1] or facts
    return f"as the branches before it leave only {' and '.join(map(condition_text, facts))}"


def _inert(abort: str, place: _Context) -> str:
    """The reason why an abort rule has no effect."""
    if abort == "lower":
        if place.context.when_observed is None:
            return "no composite has a later branch to stop"
        return "its condition does not become true while a later branch runs"
    if ends_at_once(place.node.children[0], place.context):
        return "its child ends in the tick in which it starts"
    return "its condition does not become false while its child runs"


def _guards(above: Above) -> list[ConditionExpr]:
    return [node.guard.condition for node, _ in above if node.guard]
