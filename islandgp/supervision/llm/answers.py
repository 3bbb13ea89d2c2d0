"""Reads and checks the answers of a language model (section 2.4.6).

A decision passes JSON, fields and range; a tree JSON, fields, grammar, names and limits; an edit
must make a new tree. The text of a rejection helps the model to repair its answer.
"""

from __future__ import annotations

import json
import re
from collections.abc import Collection, Mapping
from dataclasses import dataclass
from enum import StrEnum
from typing import TYPE_CHECKING, Annotated, Any, Final, Literal, TypeVar

from pydantic import (
    AfterValidator,
    BaseModel,
    ConfigDict,
    Field,
    FiniteFloat,
    Strict,
    ValidationError,
    WithJsonSchema,
    create_model,
    model_validator,
)

from islandgp.bt.analysis.lint import warnings
from islandgp.bt.core.language import parse, to_text
from islandgp.bt.core.node import Limits, Node, check_limits
from islandgp.bt.core.vocabulary import Vocabulary
from islandgp.errors import DomainError, LimitError, TreeError, UnknownNameError
from islandgp.gp.edits import EDITS, Edit, edited
from islandgp.supervision.base import Guidance, Pattern, Phase
from islandgp.supervision.llm.message import MAX_ANSWER, Reply, clean
from islandgp.supervision.llm.settings import RateSettings

A = TypeVar("A", bound="ModelAnswer")

MAX_EXPLANATION: Final = 1000  # most characters of an explanation in the record
MAX_EDITS: Final = 20  # most edits of an answer; further ones are ignored
_CANDIDATES: Final = 2000  # most places of a text at which a JSON object is searched
_THINKING: Final = re.compile(r"<(think(?:ing)?)>.*?(?:</\1>|\Z)", re.DOTALL | re.IGNORECASE)
_THOUGHT: Final = re.compile(r"</think(?:ing)?>", re.IGNORECASE)
_FENCED: Final = re.compile(r"^\s*```\w*\n(.*?)\n?\s*```\s*$", re.DOTALL)

Short = Annotated[str, AfterValidator(lambda text: text[:MAX_EXPLANATION])]
TreeText = Annotated[str, AfterValidator(lambda text: _FENCED.sub(r"\1", text))]
"""The text of a tree, without a Markdown fence around it."""


if TYPE_CHECKING:
    EditKind = str
else:
    EditKind = Literal[tuple(EDITS)]


class ModelAnswer(BaseModel, frozen=True, strict=True):
    """Base of the models of answers: exact types; further fields are ignored."""

    @model_validator(mode="before")
    @classmethod
    def _clean(cls, values: Any) -> Any:
        # JSON escapes can encode characters that were removed from the answer's text.
        return {k: clean(v) if isinstance(v, str) else v for k, v in values.items()}


class DecisionAnswer(ModelAnswer, frozen=True):
    """The answer to the prompt `mutation_rate`."""

    mutation_rate: FiniteFloat
    phase: Annotated[Phase, Strict(False)]
    pattern: Annotated[Pattern, Strict(False)]
    intervention: bool
    risk: Short
    reasoning: Short


class EditAnswer(ModelAnswer, frozen=True):
    """One edit of an answer; its kind needs `branch`, `number` or `donor`."""

    model_config = ConfigDict(json_schema_extra={"required": ["kind", "of", "at", "reason"]})

    kind: EditKind
    of: Short = ""
    at: Short = ""
    branch: TreeText = ""
    number: FiniteFloat = 0.0
    term: int = 0
    donor: Short = ""
    donor_at: Short = ""
    reason: Short = ""


def schema(model: type[BaseModel]) -> dict[str, Any]:
    """The JSON schema of an answer, without titles, references and ranges: servers drop them."""
    full = model.model_json_schema()

    def plain(part: Mapping[str, Any]) -> dict[str, Any]:
        if "$ref" in part:
            part = full["$defs"][part["$ref"].rpartition("/")[2]]
        result = {key: part[key] for key in ("type", "enum", "required") if key in part}
        if "const" in part:
            result["enum"] = [part["const"]]
        if "items" in part:
            result["items"] = plain(part["items"])
        if "properties" in part:
            result["properties"] = {name: plain(p) for name, p in part["properties"].items()}
            result["additionalProperties"] = False
        return result

    return plain(full)


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
        "target": (Literal[tuple(targets)], ...),
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
        expected = expected.removeprefix("Input should be ")
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
    COPY = "copy"  # the tree exists already
    LINT = "lint"  # `islandgp check` warns of the tree
    EDITS = "edits"  # no edit makes a usable tree


@dataclass(frozen=True, slots=True)
class Rejection:
    """A rejected answer."""

    stage: RejectionStage
    error: str  # for the model, and for the record


@dataclass(frozen=True, slots=True)
class Accepted:
    """An accepted answer."""

    guidance: Guidance  # with the requested fields
    change: str = ""  # change made to the answer, or ""


def read_answer(reply: Reply, model: type[A]) -> A | Rejection:
    """Reads the JSON object of an answer as an instance of a pydantic model, or rejects it."""
    if reply.stop_reason == "refusal":
        return Rejection(RejectionStage.REFUSED, "the model refused to answer")
    cut_off = reply.stop_reason == "max_tokens"
    fields = find_object(reply.text, model.model_fields)
    # If a further object was begun when the tokens ran out, those before it are drafts.
    if fields is None or (cut_off and "{" in _objects(reply.text)[1]):
        if reply.text.strip():
            fault = ("none that can be read", "an answer that was cut off; make it much shorter")
        else:
            no_word = "an answer that was cut off before its first word; think much less"
            fault = ("an empty answer", no_word)
        return Rejection(RejectionStage.JSON, f"Expected one JSON object, found {fault[cut_off]}.")
    try:
        return model.model_validate(fields)
    except ValidationError as error:
        return Rejection(RejectionStage.FIELDS, "\n".join(faults(error).values()))


def find_object(text: str, fields: Collection[str]) -> dict[str, Any] | None:
    """The JSON object of an answer's text; None if there is none or the text is too long.

    Of several it is the last with all of the fields, or else with any of them, or else the last:
    drafts come before the answer. Text around it or inside `<think>` is ignored.
    """

    def rank(place: int) -> tuple[bool, bool, int]:
        present = [field in objects[place] for field in fields]
        return all(present), any(present), place

    objects = _objects(text)[0] if len(text) <= MAX_ANSWER else []
    return objects[max(range(len(objects)), key=rank)] if objects else None


def _objects(text: str) -> tuple[list[dict[str, Any]], str]:
    """The outermost JSON objects of an answer, and the text after the last one."""
    text = _THINKING.sub(" ", text)
    text = _THOUGHT.split(text)[-1]  # some servers omit the opening tag
    decoder = json.JSONDecoder(strict=False)  # accepts line breaks inside strings
    objects: list[dict[str, Any]] = []
    end, at = 0, text.find("{")
    for _ in range(_CANDIDATES):
        if at < 0:
            break
        try:
            value, end = decoder.raw_decode(text, at)
        except (ValueError, RecursionError):
            at = text.find("{", at + 1)
        else:
            objects.append(value)
            at = text.find("{", end)
    return objects, text[end:]


def check_decision(reply: Reply, rates: RateSettings) -> Accepted | Rejection:
    """Checks a decision on the mutation rate."""
    answer = read_answer(reply, DecisionAnswer)
    if isinstance(answer, Rejection):
        return answer
    advised = answer.mutation_rate
    rate = min(rates.most, max(rates.least, advised))
    if rate != advised and rates.outside == "repair":
        expected = f"a number from {rates.least} to {rates.most}"
        error = f"mutation_rate: expected {expected}, found {advised}"
        return Rejection(RejectionStage.RANGE, error)
    decision = Guidance(tree=None, source="llm", **{**dict(answer), "mutation_rate": rate})
    return Accepted(decision, "" if rate == advised else f"clamped from {advised}")


def check_proposal(
    reply: Reply,
    limits: Limits,
    vocabulary: Vocabulary,
    targets: tuple[str, ...],
    existing: frozenset[str] | None = None,
) -> Accepted | Rejection:
    """Checks a tree.

    With `existing`, the canonical texts of existing trees, these are rejected, and trees that
    `islandgp check` warns of.
    """
    answer = read_answer(reply, proposal_model(targets))
    if isinstance(answer, Rejection):
        return answer
    values = dict(answer)
    tree = _check_tree(values["tree"], limits, vocabulary, existing)
    if isinstance(tree, Rejection):
        return tree
    return Accepted(Guidance(mutation_rate=None, source="llm", **{**values, "tree": tree}))


def _check_tree(
    text: str, limits: Limits, vocabulary: Vocabulary, existing: frozenset[str] | None
) -> Node | Rejection:
    """Checks grammar, names and limits of a tree; with `existing`, also novelty and warnings."""
    try:
        tree = parse(text, vocabulary, name="tree")
        check_limits(tree, limits)
    except (UnknownNameError, DomainError) as error:
        return Rejection(RejectionStage.NAMES, str(error))
    except LimitError as error:
        return Rejection(RejectionStage.LIMITS, str(error))
    except TreeError as error:
        return Rejection(RejectionStage.GRAMMAR, str(error))
    if existing is None:
        return tree
    if to_text(tree) in existing:
        copied = "Expected a new tree, found a copy of a living one or of an example."
        return Rejection(RejectionStage.COPY, copied)
    if lint := warnings(text, vocabulary, name="tree"):
        return Rejection(RejectionStage.LINT, "\n".join(w.message for w in lint))
    return tree


def check_edits(
    reply: Reply,
    living: Mapping[str, str],
    existing: frozenset[str],
    vocabulary: Vocabulary,
    limits: Limits,
) -> Accepted | Rejection:
    """Checks edits, of which at least one must make a new tree.

    `living` are the texts, by id, of the trees that an edit may name; `existing` are the canonical
    texts of existing trees.
    """
    answer = read_answer(reply, EditsAnswer)
    if isinstance(answer, Rejection):
        return answer
    listed, edits, wrong = answer.edits[:MAX_EDITS], [], []
    for number, values in enumerate(listed, 1):
        try:
            edit = _edit(values)
            trees = {n: parse(living[n], vocabulary) for n in (edit.of, edit.donor) if n in living}
            text = to_text(edited(edit, trees, vocabulary, limits))
            _check_new(text, trees[edit.of], existing, vocabulary)
            edits.append(edit)
        except ValidationError as error:
            wrong.append(f"edit {number}: {'; '.join(faults(error).values())}")
        except (ValueError, TreeError) as error:
            wrong.append(f"edit {number}: {error}")
    if not edits:
        return Rejection(RejectionStage.EDITS, "\n".join(wrong))
    change = f"{len(edits)} of {len(listed)} edits: {'; '.join(wrong)}" if wrong else ""
    return Accepted(Guidance(None, None, "llm", edits=tuple(edits)), change[:MAX_EXPLANATION])


def _edit(values: Mapping[str, Any]) -> Edit:
    """An edit from JSON values; those that its kind does not need are ignored.

    Raises ValueError or TreeError if they are not those of an edit.
    """
    answer = EditAnswer.model_validate({k: v for k, v in values.items() if v not in (None, "")})
    needs = EDITS[answer.kind].needs
    if needs not in answer.model_fields_set:
        raise ValueError(f"{needs}: expected a value in an edit {answer.kind}, found none")
    needed: Any = getattr(answer, needs)
    if needs == "branch":
        needed = parse(needed, name="branch")
    others = answer.model_dump(exclude={"branch", "number", "donor"})
    return Edit(**{**others, needs: needed})


def _check_new(text: str, before: Node, existing: frozenset[str], vocabulary: Vocabulary) -> None:
    """Raises ValueError unless an edited tree is new and has no new lint warning."""
    if text in existing:
        raise ValueError("expected a new tree, found a copy of a living tree or of an example")
    known_warnings = {w.message for w in warnings(to_text(before), vocabulary)}
    if new := [w.message for w in warnings(text, vocabulary) if w.message not in known_warnings]:
        raise ValueError(f"islandgp check warns of the edited tree: {new[0]}")
