"""Reads and checks the answers of a language model (section 2.4.6).

A decision passes JSON, fields and range; a tree JSON, fields, grammar, names and limits; an edit
must make a new tree. Small slips are repaired: single quotes, a comma at the end, a number as text,
the case of a label. The text of a rejection helps the model to repair its answer.
"""

from __future__ import annotations

import ast
import json
import re
from collections.abc import Callable, Collection, Iterable, Mapping
from dataclasses import dataclass
from enum import StrEnum
from typing import Annotated, Any, Final, TypeVar

from pydantic import (
    AfterValidator,
    BaseModel,
    BeforeValidator,
    ConfigDict,
    Field,
    FiniteFloat,
    Strict,
    ValidationError,
    WithJsonSchema,
    create_model,
)

from islandgp.bt.core.language import parse, to_text
from islandgp.bt.core.node import Limits, check_limits
from islandgp.bt.core.vocabulary import Vocabulary
from islandgp.errors import DomainError, LimitError, TreeError, UnknownNameError
from islandgp.gp.edits import EDITS, Edit, edited
from islandgp.supervision.base import Guidance, Pattern, Phase
from islandgp.supervision.llm.message import MAX_ANSWER, Reply, clean

A = TypeVar("A", bound="ModelAnswer")

MAX_EXPLANATION: Final = 1000  # most characters of an explanation in the record
MAX_EDITS: Final = 20  # most edits of an answer; further ones are ignored
_CANDIDATES: Final = 2000  # most places of a text at which a JSON object is searched
_THINKING: Final = re.compile(r"<(think(?:ing)?)>.*?(?:</\1>|\Z)", re.DOTALL | re.IGNORECASE)
_THOUGHT: Final = re.compile(r"</think(?:ing)?>", re.IGNORECASE)
_LITERALS: Final = {"true": "True", "false": "False", "null": "None"}
_LITERAL: Final = re.compile(r"(?<=[:,\[])\s*(true|false|null)(?=\s*[,}\]])")
_FENCED: Final = re.compile(r"^\s*```\w*\n(.*?)\n?\s*```\s*$", re.DOTALL)


def _storable(value: Any) -> Any:
    """A text without characters that cannot be stored, which JSON can spell by escapes."""
    return clean(value) if isinstance(value, str) else value


def _label(names: Iterable[str]) -> BeforeValidator:
    """Accepts one of the names in any case, and with blanks for underscores."""
    labels = {name.lower(): name for name in names}

    def label(value: Any) -> str:
        key = re.sub(r"[\s-]+", "_", value.strip().lower()) if isinstance(value, str) else ""
        if key not in labels:
            raise ValueError(", ".join(f"'{name}'" for name in labels.values()))
        return labels[key]

    return BeforeValidator(label)


def _enum(names: Iterable[str]) -> WithJsonSchema:
    """The JSON schema of a label."""
    return WithJsonSchema({"type": "string", "enum": [str(name) for name in names]})


Text = Annotated[str, BeforeValidator(_storable)]
Short = Annotated[Text, AfterValidator(lambda text: text[:MAX_EXPLANATION])]
TreeText = Annotated[Text, AfterValidator(lambda text: _FENCED.sub(r"\1", text))]
"""The text of a tree, without a Markdown fence around it."""
Number = Annotated[FiniteFloat, Strict(False)]


class ModelAnswer(BaseModel, frozen=True, strict=True):
    """Base of the models of answers: exact types; further fields are ignored."""


class DecisionAnswer(ModelAnswer, frozen=True):
    """The answer to the prompt `mutation_rate`."""

    mutation_rate: Number
    phase: Annotated[Phase, Strict(False), _label(Phase), _enum(Phase)]
    pattern: Annotated[Pattern, Strict(False), _label(Pattern), _enum(Pattern)]
    intervention: Annotated[bool, Strict(False)]
    risk: Short
    reasoning: Short


class EditAnswer(ModelAnswer, frozen=True):
    """One edit of an answer; its kind needs `branch`, `number` or `donor`."""

    model_config = ConfigDict(json_schema_extra={"required": ["kind", "of", "at", "reason"]})

    kind: Annotated[str, _label(EDITS), _enum(EDITS)]
    of: Short = ""
    at: Short = ""
    branch: TreeText = ""
    number: Number = 0.0
    term: Annotated[int, Strict(False)] = 0
    donor: Short = ""
    donor_at: Short = ""
    reason: Short = ""


def schema(model: type[BaseModel]) -> dict[str, Any]:
    """The JSON schema of an answer, without titles and ranges: servers drop them."""
    full = model.model_json_schema()
    kept = ("type", "enum", "items")
    properties = {
        name: {key: field[key] for key in kept if key in field}
        for name, field in full["properties"].items()
    }
    required = {"required": full["required"], "properties": properties}
    return {"type": "object", **required, "additionalProperties": False}


NEEDED: Final = {kind.needs for kind in EDITS.values()}


class EditsAnswer(ModelAnswer, frozen=True):
    """The answer to the prompt `edits`. Each edit is checked by itself."""

    edits: Annotated[
        list[Annotated[dict[str, Any], WithJsonSchema(schema(EditAnswer))]], Field(min_length=1)
    ]
    reasoning: Short


def proposal_model(targets: Collection[str]) -> type[ModelAnswer]:
    """The model of an answer to a prompt for a tree, for one of the targets."""
    fields: dict[str, Any] = {
        "tree": (TreeText, ...),
        "target": (Annotated[str, _label(targets), _enum(targets)], ...),
        "rationale": (Short, ...),
    }
    return create_model("ProposalAnswer", __base__=ModelAnswer, **fields)


def reasons_first(answer: Mapping[str, Any]) -> dict[str, Any]:
    """A schema with its fields in the other order: a model writes its decision last."""
    fields = dict(reversed(answer["properties"].items()))
    return {**answer, "properties": fields, "required": [*fields]}


def form(answer: Mapping[str, Any]) -> str:
    """A schema as a prompt shows it."""
    words = {"boolean": "true or false", "string": "TEXT", "array": "[EDIT, EDIT, ...]"}
    entries = (
        f'"{name}": {name.upper() if "enum" in field else words.get(field["type"], "NUMBER")}'
        for name, field in answer["properties"].items()
    )
    return "{" + ", ".join(entries) + "}"


def faults(error: ValidationError) -> dict[str, str]:
    """A line for each wrong field of an answer, by its name."""
    lines: dict[str, str] = {}
    for e in error.errors(include_url=False):
        field, expected, found = str(e["loc"][0]), e["msg"], f"{e['input']!r}"
        if e["type"] == "missing":
            expected, found = "a value", "none"
        expected = expected.removeprefix("Input should be ").removeprefix("Value error, ")
        found = found if len(found) <= 60 else found[:60] + "..."
        lines.setdefault(field, f"{field}: expected {expected}, found {found}")
    return lines


class RejectionStage(StrEnum):
    """The check that rejects an answer."""

    REFUSED = "refused"  # the model declined
    JSON = "json"
    FIELDS = "fields"
    RANGE = "range"
    GRAMMAR = "grammar"
    NAMES = "names"
    LIMITS = "limits"
    EDITS = "edits"  # no edit makes a usable tree


class Rejection(Exception):
    """An answer is rejected."""

    def __init__(self, stage: RejectionStage, error: str) -> None:
        """`error` is for the model, and for the record."""
        super().__init__(error)
        self.stage, self.error = stage, error


STAGES: Final = {
    UnknownNameError: RejectionStage.NAMES,
    DomainError: RejectionStage.NAMES,
    LimitError: RejectionStage.LIMITS,
}
"""The stages of errors of a tree; others are of its grammar."""


@dataclass(frozen=True, slots=True)
class Accepted:
    """An accepted answer."""

    guidance: Guidance  # with the requested fields
    change: str = ""  # change made to the answer, or ""


Check = Callable[[Reply], Accepted]  # accepts an answer, or raises Rejection


def read_answer(reply: Reply, model: type[A]) -> A:
    """Reads the JSON object of an answer as an instance of a pydantic model.

    Of several objects it is the last with all of the fields, or else with any of them, or else the
    last: drafts come before the answer. Text around it or inside `<think>` is ignored. Without any,
    an object with single quotes or a comma at its end is read. Raises Rejection.
    """
    if reply.stop_reason == "refusal":
        raise Rejection(RejectionStage.REFUSED, "the model refused to answer")
    text = reply.text if len(reply.text) <= MAX_ANSWER else ""
    text = _THOUGHT.split(_THINKING.sub(" ", text))[-1]  # some servers omit the opening tag
    objects, rest, fault = _objects(text)
    cut_off = reply.stop_reason == "max_tokens"
    if cut_off and "{" in rest:  # a further object was begun: those before it are drafts
        objects = []
    elif not any(field in each for each in objects for field in model.model_fields):
        objects += _loose_object(text)
    if not objects:
        if cut_off:
            fault = "an answer that was cut off; make it much shorter"
        if not reply.text.strip():
            no_word = "an answer that was cut off before its first word; think much less"
            fault = no_word if cut_off else "an empty answer"
        raise Rejection(RejectionStage.JSON, f"Expected one JSON object, found {fault}.")

    def rank(found: dict[str, Any]) -> tuple[bool, bool]:
        present = [field in found for field in model.model_fields]
        return all(present), any(present)

    try:
        return model.model_validate(max(reversed(objects), key=rank))
    except ValidationError as error:
        raise Rejection(RejectionStage.FIELDS, "\n".join(faults(error).values())) from None


def _objects(text: str) -> tuple[list[dict[str, Any]], str, str]:
    """The outermost JSON objects of a text, the text after the last one, and the first fault."""
    decoder = json.JSONDecoder(strict=False)  # accepts line breaks inside strings
    objects: list[dict[str, Any]] = []
    end, at, fault = 0, text.find("{"), ""
    for _ in range(_CANDIDATES):
        if at < 0:
            break
        try:
            value, end = decoder.raw_decode(text, at)
            objects.append(value)
            at = text.find("{", end)
            continue
        except json.JSONDecodeError as error:
            near = text[max(0, error.pos - 20) : error.pos + 20]
            fault = fault or f"one that cannot be read: {error.msg.lower()} near {near!r}"
        except (ValueError, RecursionError):
            fault = fault or "one that is nested too deep, or has a number that is too long"
        at = text.find("{", at + 1)
    return objects, text[end:], fault or "none"


def _loose_object(text: str) -> list[dict[str, Any]]:
    """The object from the first to the last brace, with the quotes and commas of Python."""
    body = " ".join(text[text.find("{") : text.rfind("}") + 1].splitlines())
    try:
        value = ast.literal_eval(_LITERAL.sub(lambda match: _LITERALS[match[1]], body))
    except (ValueError, SyntaxError, TypeError, MemoryError, RecursionError):
        return []
    is_object = isinstance(value, dict) and all(isinstance(key, str) for key in value)
    return [value] if is_object else []


def check_decision(reply: Reply, rates: tuple[float, float]) -> Accepted:
    """Checks a decision on the mutation rate; `rates` are the lowest and the highest."""
    read = read_answer(reply, DecisionAnswer)
    if not rates[0] <= read.mutation_rate <= rates[1]:
        expected = f"a number from {rates[0]} to {rates[1]}"
        error = f"mutation_rate: expected {expected}, found {read.mutation_rate}"
        raise Rejection(RejectionStage.RANGE, error)
    return Accepted(Guidance(tree=None, source="llm", **dict(read)))


def check_proposal(
    reply: Reply, limits: Limits, vocabulary: Vocabulary, targets: tuple[str, ...]
) -> Accepted:
    """Checks a tree: its grammar, names and limits."""
    values = dict(read_answer(reply, proposal_model(targets)))
    try:
        values["tree"] = parse(values["tree"], vocabulary, name="tree")
        check_limits(values["tree"], limits)
    except (TreeError, DomainError) as error:
        stage = next((s for kind, s in STAGES.items() if isinstance(error, kind)), "grammar")
        raise Rejection(RejectionStage(stage), str(error)) from None
    return Accepted(Guidance(mutation_rate=None, source="llm", **values))


def check_edits(
    reply: Reply,
    limits: Limits,
    vocabulary: Vocabulary,
    living: Mapping[str, str],
    existing: frozenset[str],
) -> Accepted:
    """Checks edits, of which at least one must make a new tree.

    `living` are the texts, by id, of the trees that an edit may name; `existing` are the canonical
    texts of existing trees.
    """
    listed, edits, wrong = read_answer(reply, EditsAnswer).edits[:MAX_EDITS], [], []
    for number, values in enumerate(listed, 1):
        try:
            edit = _edit(values)
            trees = {n: parse(living[n], vocabulary) for n in (edit.of, edit.donor) if n in living}
            if to_text(edited(edit, trees, vocabulary, limits)) not in existing:
                edits.append(edit)
                continue
            error = "expected a new tree, found a copy of a living tree or of an example"
        except ValidationError as fault:
            error = "; ".join(faults(fault).values())
        except (ValueError, TreeError) as fault:
            error = str(fault)
        wrong.append(f"edit {number}: {error}")
    if not edits:
        raise Rejection(RejectionStage.EDITS, "\n".join(wrong))
    change = f"{len(edits)} of {len(listed)} edits: {'; '.join(wrong)}" if wrong else ""
    return Accepted(Guidance(None, None, "llm", edits=tuple(edits)), change[:MAX_EXPLANATION])


def _edit(values: Mapping[str, Any]) -> Edit:
    """An edit from JSON values; those that its kind does not need are ignored.

    Raises ValueError or TreeError if they are not those of an edit.
    """
    answer = EditAnswer.model_validate({k: v for k, v in values.items() if v not in (None, "")})
    needs, given = EDITS[answer.kind].needs, answer.model_dump(exclude={*NEEDED})
    if needs in answer.model_fields_set:
        value = getattr(answer, needs)
        given[needs] = parse(value, name="branch") if needs == "branch" else value
    return Edit(**given)
