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
    others: tuple[Node, ...] = ()  # candidates that came with it, inside the limits, too


FieldType = type[StrEnum] | type[float] | type[bool] | type[str] | type[list[str]] | tuple[str, ...]
"""A type, or the words that a field may be."""

DECISION: Final[Mapping[str, FieldType]] = {
    "mutation_rate": float,
    "phase": Phase,
    "pattern": Pattern,
    "intervention": bool,
    "risk": str,
    "reasoning": str,
}


def proposal_shape(targets: tuple[str, ...], candidates: int = 1) -> Mapping[str, FieldType]:
    """The shape of an answer to a prompt for a tree, or for several candidates."""
    trees: dict[str, FieldType] = {"tree": str} if candidates == 1 else {"trees": list[str]}
    return {**trees, "target": targets, "rationale": str}


def reasons_first(shape: Mapping[str, FieldType]) -> Mapping[str, FieldType]:
    """The shape in the other order: what decides comes last, and a model writes it last."""
    return dict(reversed(list(shape.items())))


def form(shape: Mapping[str, FieldType]) -> str:
    """The shape as a prompt shows it."""
    fields = [f'"{field}": {_FORMS.get(kind, field.upper())}' for field, kind in shape.items()]
    return "{" + ", ".join(fields) + "}"


def schema(shape: Mapping[str, FieldType]) -> dict[str, Any]:
    """The JSON schema of a shape. Ranges are not in it: servers drop them."""
    return {
        "type": "object",
        "properties": {field: _json_type(kind) for field, kind in shape.items()},
        "required": list(shape),
        "additionalProperties": False,
    }


_FORMS: Final[Mapping[FieldType, str]] = {
    float: "NUMBER",
    bool: "true or false",
    str: "TEXT",
    list[str]: "[TEXT, TEXT, ...]",
}
_SCHEMAS: Final[Mapping[FieldType, dict[str, Any]]] = {
    float: {"type": "number"},
    bool: {"type": "boolean"},
    str: {"type": "string"},
    list[str]: {"type": "array", "items": {"type": "string"}},
}
_WANTED: Final[Mapping[FieldType, str]] = {
    float: "a number",
    bool: "true or false",
    str: "a text",
    list[str]: "a list of texts, one at least",
}


def _words(kind: FieldType) -> tuple[str, ...] | None:
    """The words that a field may be; None for other types."""
    if isinstance(kind, tuple):
        return kind
    if isinstance(kind, type) and issubclass(kind, StrEnum):
        return tuple(member.value for member in kind)
    return None


def _json_type(kind: FieldType) -> dict[str, Any]:
    if (words := _words(kind)) is not None:
        return {"type": "string", "enum": list(words)}
    return _SCHEMAS[kind]


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
    if kind == list[str]:
        return isinstance(value, list) and bool(value) and all(isinstance(v, str) for v in value)
    assert isinstance(kind, type)
    return isinstance(value, kind)


def _wanted(kind: FieldType) -> str:
    if (words := _words(kind)) is not None:
        return f"one of {', '.join(words)}"
    return _WANTED[kind]


def _shown(value: Any) -> str:
    text = repr(value)
    return text if len(text) <= 60 else text[:60] + "..."
