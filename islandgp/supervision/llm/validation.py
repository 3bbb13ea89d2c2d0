"""What a model must answer, and the validation before anything of it is used (section 2.4.6).

A shape says which fields an answer has: for a prompt, as a JSON schema, and to check them.
A decision: JSON, fields, range. A tree: JSON, fields, grammar, names, limits.
Each stage ends in a rejection that says what was wrong, in words that a model
can mend its answer by.
"""

from __future__ import annotations

import json
import re
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass
from enum import StrEnum
from typing import Any, Final, Generic, Literal, TypeAlias, TypeVar

from pydantic import BaseModel, Field, model_validator

from islandgp.bt.analysis.lint import warnings
from islandgp.bt.core.language import parse, to_text
from islandgp.bt.core.node import Limits, Node, check_limits
from islandgp.bt.core.vocabulary import Vocabulary
from islandgp.errors import DomainError, LimitError, TreeError, UnknownNameError
from islandgp.gp.edits import Edit
from islandgp.supervision.base import Guidance, Pattern, Phase
from islandgp.supervision.llm.message import SANE, Reply, clean

T = TypeVar("T")

_CANDIDATES: Final = 2000  # places of a text where a JSON object is looked for
_THINKING: Final = re.compile(r"<(think(?:ing)?)>.*?(?:</\1>|\Z)", re.DOTALL | re.IGNORECASE)
_THOUGHT: Final = re.compile(r"</think(?:ing)?>", re.IGNORECASE)


_FENCED: Final = re.compile(r"^\s*```\w*\n(.*?)\n?\s*```\s*$", re.DOTALL)

LONGEST: Final = 1000  # characters of an explanation that the record keeps


@dataclass(frozen=True, slots=True)
class FieldType:
    """What a field of an answer may be."""

    form: str  # as a prompt shows it; "": as the field's name
    wanted: str  # as an error asks for it
    schema: Mapping[str, Any]  # JSON schema
    fits: Callable[[Any], bool]  # whether a value is one


def _is_number(value: Any) -> bool:
    # NaN, infinity and whole numbers of 400 digits are JSON to Python, but no numbers to us.
    return isinstance(value, (int, float)) and type(value) is not bool and abs(value) < 1e300


def _are_texts(value: Any) -> bool:
    return isinstance(value, list) and bool(value) and all(isinstance(v, str) for v in value)


def one_of(words: Sequence[str]) -> FieldType:
    """One of some words."""
    schema = {"type": "string", "enum": list(words)}
    return FieldType("", f"one of {', '.join(words)}", schema, lambda value: value in words)


NUMBER: Final = FieldType("NUMBER", "a number", {"type": "number"}, _is_number)
FLAG: Final = FieldType(
    "true or false", "true or false", {"type": "boolean"}, lambda value: isinstance(value, bool)
)
TEXT: Final = FieldType("TEXT", "a text", {"type": "string"}, lambda value: isinstance(value, str))
TEXTS: Final = FieldType(
    "[TEXT, TEXT, ...]",
    "a list of texts, one at least",
    {"type": "array", "items": {"type": "string"}},
    _are_texts,
)

Shape: TypeAlias = Mapping[str, FieldType]
"""The fields of an answer, which are those of a Guidance."""

DECISION: Final[Shape] = {
    "mutation_rate": NUMBER,
    "phase": one_of(list(Phase)),
    "pattern": one_of(list(Pattern)),
    "intervention": FLAG,
    "risk": TEXT,
    "reasoning": TEXT,
}
"""The answer to the prompt `mutation_rate`."""


def proposal_shape(targets: Sequence[str], candidates: int = 1) -> Shape:
    """The shape of an answer to a prompt for a tree, or for several candidates."""
    trees = {"tree": TEXT} if candidates == 1 else {"trees": TEXTS}
    return {**trees, "target": one_of(targets), "rationale": TEXT}


@dataclass(frozen=True, slots=True)
class Proposal:
    """The answer to a prompt for a tree."""

    tree: Node  # inside the limits
    target: str  # one of the state's targets
    rationale: str
    others: tuple[Node, ...] = ()  # candidates that came with it, inside the limits, too
    edits: tuple[Edit, ...] = ()


def reasons_first(shape: Shape) -> Shape:
    """The shape in the other order: what decides comes last, and a model writes it last."""
    return dict(reversed(list(shape.items())))


def form(shape: Shape) -> str:
    """The shape as a prompt shows it."""
    return "{" + ", ".join(f'"{n}": {kind.form or n.upper()}' for n, kind in shape.items()) + "}"


def schema(shape: Shape) -> dict[str, Any]:
    """The JSON schema of a shape. Ranges are not in it: servers drop them."""
    return {
        "type": "object",
        "properties": {field: dict(kind.schema) for field, kind in shape.items()},
        "required": list(shape),
        "additionalProperties": False,
    }


def faults(found: Mapping[str, Any], shape: Shape) -> list[str]:
    """What is wrong with the types of an answer's fields, a line each; fields too many are fine."""
    wrong = []
    for field, kind in shape.items():
        if field not in found:
            wrong.append(f"{field}: expected a value, found none")
        elif not kind.fits(found[field]):
            text = repr(found[field])
            shown = text if len(text) <= 60 else text[:60] + "..."
            wrong.append(f"{field}: expected {kind.wanted}, found {shown}")
    return wrong


class RejectionStage(StrEnum):
    """Where an answer is rejected."""

    REFUSED = "refused"  # the model declined
    JSON = "json"
    FIELDS = "fields"
    RANGE = "range"
    GRAMMAR = "grammar"
    NAMES = "names"
    LIMITS = "limits"
    COPY = "copy"  # a tree that is no news
    LINT = "lint"  # a tree that `islandgp check` warns of
    EDITS = "edits"  # no edit makes a tree that can be used


@dataclass(frozen=True, slots=True)
class Rejection:
    """Why an answer cannot be used."""

    stage: RejectionStage
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
    most: float = Field(ge=0, le=1)  # highest rate that is taken
    outside: Literal["repair", "clamp"]  # ask again and then refuse, or take the nearest limit

    @model_validator(mode="after")
    def _ordered(self) -> RateSettings:
        if self.least > self.most:
            raise ValueError(f"least: expected at most {self.most}, found {self.least}")
        return self


def check_decision(rates: RateSettings) -> Check[Guidance]:
    """The validation of decisions."""

    def check(reply: Reply) -> Accepted[Guidance] | Rejection:
        found = fields_of(reply, DECISION)
        if isinstance(found, Rejection):
            return found
        asked = float(found["mutation_rate"])
        rate, change = asked, ""
        if not rates.least <= asked <= rates.most:
            if rates.outside == "repair":
                return Rejection(
                    RejectionStage.RANGE,
                    f"mutation_rate: expected a number from {rates.least} to {rates.most},"
                    f" found {asked}",
                )
            rate = min(rates.most, max(rates.least, asked))
            change = f"clamped from {asked}"
        decision = Guidance(
            rate,
            None,
            "llm",
            phase=Phase(found["phase"]),
            pattern=Pattern(found["pattern"]),
            intervention=found["intervention"],
            risk=found["risk"][:LONGEST],
            reasoning=found["reasoning"][:LONGEST],
        )
        return Accepted(decision, change)

    return check


def check_proposal(
    limits: Limits,
    vocabulary: Vocabulary,
    targets: tuple[str, ...],
    candidates: int = 1,
    known: frozenset[str] | None = None,
) -> Check[Proposal]:
    """The validation of trees. Of several candidates those count that go through, one at least.

    With `known`, the canonical texts of trees that are no news, these are rejected, and trees that
    `islandgp check` warns of.
    """
    shape = proposal_shape(targets, candidates)

    def check(reply: Reply) -> Accepted[Proposal] | Rejection:
        found = fields_of(reply, shape)
        if isinstance(found, Rejection):
            return found
        texts = found["trees"][:candidates] if candidates > 1 else [found["tree"]]
        checked = [
            _check_tree(without_fences(clean(text)), limits, vocabulary, known) for text in texts
        ]
        trees = [tree for tree in checked if isinstance(tree, Node)]
        if not trees:
            return next(wrong for wrong in checked if isinstance(wrong, Rejection))
        target, rationale = found["target"], found["rationale"][:LONGEST]
        change = f"{len(trees)} of {len(texts)} trees" if len(trees) < len(texts) else ""
        return Accepted(Proposal(trees[0], target, rationale, tuple(trees[1:])), change)

    return check


def without_fences(text: str) -> str:
    """A tree's text without the Markdown fence that a model may have put around it."""
    found = _FENCED.search(text)
    return found[1] if found else text


def _check_tree(
    text: str, limits: Limits, vocabulary: Vocabulary, known: frozenset[str] | None
) -> Node | Rejection:
    """Grammar, names and limits of one tree; with `known` also that it is news and has no fault."""
    try:
        tree = parse(text, vocabulary, name="tree")
        check_limits(tree, limits)
    except (UnknownNameError, DomainError) as error:
        return Rejection(RejectionStage.NAMES, str(error))
    except LimitError as error:
        return Rejection(RejectionStage.LIMITS, str(error))
    except TreeError as error:
        return Rejection(RejectionStage.GRAMMAR, str(error))
    if known is None:
        return tree
    if to_text(tree) in known:
        return Rejection(
            RejectionStage.COPY,
            "Expected a new tree, found a copy of a living one or of an example.",
        )
    if found := warnings(text, vocabulary, name="tree"):
        return Rejection(RejectionStage.LINT, "\n".join(w.message for w in found))
    return tree


def fields_of(reply: Reply, shape: Shape) -> dict[str, Any] | Rejection:
    """The answer's JSON object, with every field of the right type."""
    if reply.stop_reason == "refusal":
        return Rejection(RejectionStage.REFUSED, "the model refused to answer")
    cut_off = reply.stop_reason == "max_tokens"
    if not reply.text.strip():
        why = "an answer that was cut off before its first word; think much less"
        why = why if cut_off else "an empty answer"
        return Rejection(RejectionStage.JSON, f"Expected one JSON object, found {why}.")
    found = find_object(reply.text, shape)
    # Where another object was begun when the tokens ran out, those before it are drafts.
    if found is None or (cut_off and "{" in _objects(reply.text)[1]):
        why = "an answer that was cut off; make it much shorter"
        why = why if cut_off else "none that can be read"
        return Rejection(RejectionStage.JSON, f"Expected one JSON object, found {why}.")
    if wrong := faults(found, shape):
        return Rejection(RejectionStage.FIELDS, "\n".join(wrong))
    # JSON inside a text can spell characters that the text itself could not have.
    return {key: clean(value) if isinstance(value, str) else value for key, value in found.items()}


def find_object(text: str, fields: Collection[str]) -> dict[str, Any] | None:
    """The last JSON object in a text that has all of the fields, else any of them, else the last.

    It may stand between other words, as in the answers of servers that take no schema:
    drafts come before it, and what stands inside `<think>` is none of the answer.
    """
    if len(text) > SANE:
        return None
    found, _ = _objects(text)
    whole = [value for value in found if all(field in value for field in fields)]
    some = [value for value in found if any(field in value for field in fields)]
    return next((values[-1] for values in (whole, some, found) if values), None)


def _objects(text: str) -> tuple[list[dict[str, Any]], str]:
    """The JSON objects of an answer that are in no other one, and the text after the last."""
    text = _THINKING.sub(" ", text)
    text = _THOUGHT.split(text)[-1]  # some servers leave the opening tag out
    decoder = json.JSONDecoder(strict=False)  # line breaks inside a text do no harm
    found: list[dict[str, Any]] = []
    end, at = 0, text.find("{")
    for _ in range(_CANDIDATES):
        if at < 0:
            break
        try:
            value, end = decoder.raw_decode(text, at)
        except (ValueError, RecursionError):
            at = text.find("{", at + 1)
        else:
            found.append(value)
            at = text.find("{", end)
    return found, text[end:]
