"""What a model must answer: the two shapes, as types and as JSON schemas (section 2.4.6)."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from enum import StrEnum
from typing import Any, Final

from islandgp.bt.node import Node
from islandgp.supervision.base import Pattern, Phase

LONGEST: Final = 1000  # characters of an explanation that the record keeps


@dataclass(frozen=True, slots=True)
class Decision:
    """The answer to the prompt `mutation_rate`."""

    mutation_rate: float  # inside the range that the settings allow
    phase: Phase
    pattern: Pattern
    intervention: bool
    risk: str
    reasoning: str


@dataclass(frozen=True, slots=True)
class Proposal:
    """The answer to a prompt for a tree."""

    tree: Node  # inside the limits
    target: str  # one of the state's targets
    rationale: str


FieldType = type[StrEnum] | type[float] | type[bool] | type[str] | tuple[str, ...]
"""A type, or the words that a field may be."""

DECISION: Final[Mapping[str, FieldType]] = {
    "mutation_rate": float,
    "phase": Phase,
    "pattern": Pattern,
    "intervention": bool,
    "risk": str,
    "reasoning": str,
}


def proposal_shape(targets: tuple[str, ...]) -> Mapping[str, FieldType]:
    """The shape of an answer to a prompt for a tree."""
    return {"tree": str, "target": targets, "rationale": str}


def reasons_first(shape: Mapping[str, FieldType]) -> Mapping[str, FieldType]:
    """The shape in the other order: what decides comes last, and a model writes it last."""
    return dict(reversed(list(shape.items())))


def form(shape: Mapping[str, FieldType]) -> str:
    """The shape as a prompt shows it."""
    words: dict[object, str] = {float: "NUMBER", bool: "true or false", str: "TEXT"}
    fields = [f'"{field}": {words.get(kind, field.upper())}' for field, kind in shape.items()]
    return "{" + ", ".join(fields) + "}"


def schema(shape: Mapping[str, FieldType]) -> dict[str, Any]:
    """The JSON schema of a shape. Ranges are not in it: servers drop them."""
    return {
        "type": "object",
        "properties": {field: _json_type(kind) for field, kind in shape.items()},
        "required": list(shape),
        "additionalProperties": False,
    }


def _words(kind: FieldType) -> tuple[str, ...] | None:
    """The words that a field may be; None for other types."""
    if isinstance(kind, tuple):
        return kind
    return tuple(member.value for member in kind) if issubclass(kind, StrEnum) else None


def _json_type(kind: FieldType) -> dict[str, Any]:
    if (words := _words(kind)) is not None:
        return {"type": "string", "enum": list(words)}
    assert not isinstance(kind, tuple)
    return {"type": {float: "number", bool: "boolean", str: "string"}[kind]}


def faults(found: Mapping[str, Any], shape: Mapping[str, FieldType]) -> list[str]:
    """What is wrong with the types of an answer's fields, a line each; fields too many are fine."""
    wrong = []
    for field, kind in shape.items():
        if field not in found:
            wrong.append(f"{field}: expected a value, found none")
        elif not _is(found[field], kind):
            wrong.append(f"{field}: expected {_wanted(kind)}, found {_shown(found[field])}")
    return wrong


def _is(value: Any, kind: FieldType) -> bool:
    if kind is float:
        # NaN, infinity and whole numbers of 400 digits are JSON to Python, but no numbers to us.
        return isinstance(value, (int, float)) and type(value) is not bool and abs(value) < 1e300
    if (words := _words(kind)) is not None:
        return isinstance(value, str) and value in words
    assert not isinstance(kind, tuple)
    return isinstance(value, kind)


def _wanted(kind: FieldType) -> str:
    if (words := _words(kind)) is not None:
        return f"one of {', '.join(words)}"
    assert not isinstance(kind, tuple)
    return {float: "a number", bool: "true or false", str: "a text"}[kind]


def _shown(value: Any) -> str:
    text = repr(value)
    return text if len(text) <= 60 else text[:60] + "..."
