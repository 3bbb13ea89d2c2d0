"""The funnel that an answer goes through before anything in it is used (section 2.4.6).

A decision: JSON, fields, range. A tree: JSON, fields, grammar, names, limits.
Each stage ends in a rejection that says what was wrong, in words that a model
can mend its answer by.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Collection, Iterator, Mapping
from dataclasses import dataclass
from enum import StrEnum
from typing import Any, Final, Generic, Literal, TypeAlias, TypeVar

from pydantic import BaseModel, Field, model_validator

from islandgp.bt.language import parse
from islandgp.bt.limits import Limits, check_limits
from islandgp.bt.vocabulary import Vocabulary
from islandgp.errors import DomainError, LimitError, TreeError, UnknownNameError
from islandgp.supervision.base import Pattern, Phase
from islandgp.supervision.llm.answers import (
    DECISION,
    LONGEST,
    Decision,
    FieldType,
    Proposal,
    faults,
    proposal_shape,
)
from islandgp.supervision.llm.message import SANE, Reply, clean

T = TypeVar("T")
_CANDIDATES: Final = 20  # places of a text where a JSON object is looked for


class Stage(StrEnum):
    """Where an answer is rejected."""

    REFUSED = "refused"  # the model declined, or said nothing
    JSON = "json"
    FIELDS = "fields"
    RANGE = "range"
    GRAMMAR = "grammar"
    NAMES = "names"
    LIMITS = "limits"


@dataclass(frozen=True, slots=True)
class Rejection:
    """Why an answer cannot be used."""

    stage: Stage
    error: str  # for the model, and for the record


@dataclass(frozen=True, slots=True)
class Accepted(Generic[T]):
    """A value that went through, and what was changed on the way ("" for nothing)."""

    value: T
    change: str = ""


Check: TypeAlias = Callable[[Reply], Accepted[T] | Rejection]


class RateSettings(BaseModel, frozen=True, extra="forbid"):
    """Which rates are taken. One outside is never used as it is."""

    least: float = Field(ge=0, le=1)
    most: float = Field(ge=0, le=1)
    outside: Literal["repair", "clamp"]  # ask again and then refuse, or take the nearest limit

    @model_validator(mode="after")
    def _ordered(self) -> RateSettings:
        if self.least > self.most:
            raise ValueError(f"least: expected at most {self.most}, found {self.least}")
        return self


def check_decision(rates: RateSettings) -> Check[Decision]:
    """The funnel of decisions."""

    def check(reply: Reply) -> Accepted[Decision] | Rejection:
        found = _fields(reply, DECISION)
        if isinstance(found, Rejection):
            return found
        asked = float(found["mutation_rate"])
        rate, change = asked, ""
        if not rates.least <= asked <= rates.most:
            if rates.outside == "repair":
                return Rejection(
                    Stage.RANGE,
                    f"mutation_rate: expected a number from {rates.least} to {rates.most},"
                    f" found {asked}",
                )
            rate = min(rates.most, max(rates.least, asked))
            change = f"clamped from {asked}"
        decision = Decision(
            rate,
            Phase(found["phase"]),
            Pattern(found["pattern"]),
            found["intervention"],
            found["risk"][:LONGEST],
            found["reasoning"][:LONGEST],
        )
        return Accepted(decision, change)

    return check


def check_proposal(
    limits: Limits, vocabulary: Vocabulary, targets: tuple[str, ...]
) -> Check[Proposal]:
    """The funnel of trees."""
    shape = proposal_shape(targets)

    def check(reply: Reply) -> Accepted[Proposal] | Rejection:
        found = _fields(reply, shape)
        if isinstance(found, Rejection):
            return found
        try:
            tree = parse(found["tree"], vocabulary, name="tree")
            check_limits(tree, limits)
        except (UnknownNameError, DomainError) as error:
            return Rejection(Stage.NAMES, str(error))
        except LimitError as error:
            return Rejection(Stage.LIMITS, str(error))
        except TreeError as error:
            return Rejection(Stage.GRAMMAR, str(error))
        return Accepted(Proposal(tree, found["target"], found["rationale"][:LONGEST]))

    return check


def _fields(reply: Reply, shape: Mapping[str, FieldType]) -> dict[str, Any] | Rejection:
    """The answer's JSON object, with every field of the right type."""
    if reply.stop_reason == "refusal" or not reply.text.strip():
        why = "the model refused to answer" if reply.stop_reason == "refusal" else "no text"
        return Rejection(Stage.REFUSED, why)
    found = find_object(reply.text, shape)
    if found is None:
        return Rejection(Stage.JSON, _no_json(reply))
    if wrong := faults(found, shape):
        return Rejection(Stage.FIELDS, "\n".join(wrong))
    # JSON inside a text can spell characters that the text itself could not have.
    return {key: clean(value) if isinstance(value, str) else value for key, value in found.items()}


def _no_json(reply: Reply) -> str:
    if reply.stop_reason == "max_tokens":
        return "Expected one JSON object, found an answer that was cut off; make it much shorter."
    return "Expected one JSON object, found none that can be read."


def find_object(text: str, fields: Collection[str]) -> dict[str, Any] | None:
    """The first JSON object in a text that has one of the fields, else the first of all.

    It may stand between other words, as in the answers of servers that take no schema.
    """
    if len(text) > SANE:
        return None
    decoder = json.JSONDecoder()
    other: dict[str, Any] | None = None
    for start in _braces(text):
        try:
            found, _ = decoder.raw_decode(text, start)
        except (ValueError, RecursionError):
            continue
        if isinstance(found, dict):
            if any(field in found for field in fields):
                return found
            other = other or found
    return other


def _braces(text: str) -> Iterator[int]:
    at = -1
    for _ in range(_CANDIDATES):
        at = text.find("{", at + 1)
        if at < 0:
            return
        yield at
