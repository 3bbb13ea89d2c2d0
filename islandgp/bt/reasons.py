"""The reasons of `check`: which guard above a node says that it can't be, or always is."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TypeAlias

from islandgp.bt.node import Node
from islandgp.bt.printer import head
from islandgp.bt.truth import condition_of, excludes, implies
from islandgp.bt.vocabulary import Condition, Vocabulary

Above: TypeAlias = tuple[tuple[Node, int], ...]
"""The nodes above a node, each with the index of the child that leads down."""


def why_not(
    needed: Condition,
    known: Sequence[Condition],
    above: Above,
    vocabulary: Vocabulary,
    *,
    for_action: bool = False,
) -> str:
    """Why a condition, or the action that needs it, can't be where `known` holds."""
    lead = f"it needs {_said(needed)}" if for_action else f"{_said(needed)} can't hold"
    guards = [c for c in _guards(above) if c in known and c.key == needed.key]
    against = [c for c in guards if excludes((c,), needed)][-1:] or guards
    if not against:
        return f"{lead}, as {needed.key} is {vocabulary.keys[needed.key].meaning}"
    return f"{lead}, but above it stands {' and '.join(f'when {_said(c)}' for c in against)}"


def why(asked: Condition, above: Above) -> str:
    """Why a condition always holds."""
    same = [c for c in _guards(above) if implies((c,), asked)]
    if not same:
        return f"{_said(asked)} always holds"
    return f"when {_said(same[-1])} stands above it already"


def _guards(above: Above) -> list[Condition]:
    return [condition_of(node) for node, _ in above if node.kind == "when"]


def _said(condition: Condition) -> str:
    key, operator, number = condition
    return head(Node("when", (key, operator, number, "both"))).removeprefix("when ")
