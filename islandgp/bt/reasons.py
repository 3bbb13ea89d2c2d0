"""The reasons of `check`: which guard above a node says that it can't be, or always is."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TypeAlias

from islandgp.bt.condition import Asked, terms
from islandgp.bt.node import Node, condition_of
from islandgp.bt.printer import condition_text
from islandgp.bt.truth import excludes, implies
from islandgp.bt.vocabulary import Vocabulary

Above: TypeAlias = tuple[tuple[Node, int], ...]
"""The nodes above a node, each with the index of the child that leads down."""


def why_not(
    needed: Asked,
    known: Sequence[Asked],
    above: Above,
    vocabulary: Vocabulary,
    *,
    for_action: bool = False,
) -> str:
    """Why a condition, or the action that needs it, can't be where `known` holds."""
    said, keys = condition_text(needed), {term.key for term in terms(needed)}
    lead = f"it needs {said}" if for_action else f"{said} can't hold"
    if excludes((), needed):
        return f"{lead}, whatever is on the blackboard"
    guards = [
        c for c in _guards(above) if c in known and not keys.isdisjoint(t.key for t in terms(c))
    ]
    against = [c for c in guards if excludes((c,), needed)][-1:] or guards
    if not against:
        meant = (f"{key} is {vocabulary.keys[key].meaning}" for key in sorted(keys))
        return f"{lead}, as {' and '.join(meant)}"
    stands = " and ".join(f"when {condition_text(c)}" for c in against)
    return f"{lead}, but above it stands {stands}"


def why(asked: Asked, above: Above) -> str:
    """Why a condition always holds."""
    same = [c for c in _guards(above) if implies((c,), asked)]
    if not same:
        return f"{condition_text(asked)} always holds"
    return f"when {condition_text(same[-1])} stands above it already"


def _guards(above: Above) -> list[Asked]:
    return [condition_of(node) for node, _ in above if node.kind == "when"]
