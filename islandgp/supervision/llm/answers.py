"""The answers of a language model: their pydantic models, and reading one from a text (2.4.6)."""

from __future__ import annotations

import json
import re
from collections.abc import Collection, Mapping
from dataclasses import dataclass
from enum import StrEnum
from typing import Annotated, Any, Final, Literal, TypeVar

from pydantic import BaseModel, ConfigDict, Field, Strict, ValidationError, WithJsonSchema
from pydantic import create_model as new_model

from islandgp.gp.edits import EDITS
from islandgp.supervision.base import Pattern, Phase
from islandgp.supervision.llm.message import SANE, Reply, clean

A = TypeVar("A", bound=BaseModel)

_CANDIDATES: Final = 2000  # most places of a text at which a JSON object is searched
_THINKING: Final = re.compile(r"<(think(?:ing)?)>.*?(?:</\1>|\Z)", re.DOTALL | re.IGNORECASE)
_THOUGHT: Final = re.compile(r"</think(?:ing)?>", re.IGNORECASE)

Number = Annotated[float, Field(gt=-1e300, lt=1e300)]
"""Neither NaN, infinity nor an integer of 400 digits, all of which Python reads from JSON."""


class ModelAnswer(BaseModel, frozen=True, strict=True):
    """Base of the models of answers: exact types; further fields are ignored."""


class DecisionAnswer(ModelAnswer, frozen=True):
    """The answer to the prompt `mutation_rate`."""

    mutation_rate: Number
    phase: Annotated[Phase, Strict(False)]
    pattern: Annotated[Pattern, Strict(False)]
    intervention: bool
    risk: str
    reasoning: str


class EditAnswer(ModelAnswer, frozen=True):
    """One edit of an answer; its kind needs `branch`, `number` or `donor`."""

    model_config = ConfigDict(json_schema_extra={"required": ["kind", "of", "at", "reason"]})

    kind: Annotated[str, Field(json_schema_extra={"enum": [*EDITS]})]
    of: str = ""
    at: str = ""
    branch: str = ""
    number: Number = 0.0
    term: int = 0
    donor: str = ""
    donor_at: str = ""
    reason: str = ""


def schema(model: type[BaseModel]) -> dict[str, Any]:
    """The JSON schema of an answer, without titles, references and ranges: servers drop them."""
    whole = model.model_json_schema()

    def plain(part: Mapping[str, Any]) -> dict[str, Any]:
        if "$ref" in part:
            part = whole["$defs"][part["$ref"].rpartition("/")[2]]
        kept = {key: part[key] for key in ("type", "enum", "required") if key in part}
        if "const" in part:
            kept["enum"] = [part["const"]]
        if "items" in part:
            kept["items"] = plain(part["items"])
        if "properties" in part:
            kept["properties"] = {name: plain(p) for name, p in part["properties"].items()}
            kept["additionalProperties"] = False
        return kept

    return plain(whole)


class EditsAnswer(ModelAnswer, frozen=True):
    """The answer to the prompt `edits`. Each edit is checked by itself."""

    edits: Annotated[
        list[Annotated[dict[str, Any], WithJsonSchema(schema(EditAnswer))]], Field(min_length=1)
    ]
    reasoning: str


def proposal_model(targets: Collection[str], candidates: int = 1) -> type[ModelAnswer]:
    """The model of an answer to a prompt for a tree, or for several candidates."""
    several = (Annotated[list[str], Field(min_length=1)], ...)
    fields: dict[str, Any] = {
        **({"tree": (str, ...)} if candidates == 1 else {"trees": several}),
        "target": (Literal[tuple(targets)], ...),
        "rationale": (str, ...),
    }
    return new_model("ProposalAnswer", __base__=ModelAnswer, **fields)


def reasons_first(answer: Mapping[str, Any]) -> dict[str, Any]:
    """A schema with its fields in the other order: a model writes its decision last."""
    fields = dict(reversed(answer["properties"].items()))
    return {**answer, "properties": fields, "required": [*fields]}


_SORTS: Final = {
    # the type of a field, or that of a list's items: as a prompt shows it, and in an error
    "number": ("NUMBER", "a number"),
    "integer": ("NUMBER", "a whole number"),
    "boolean": ("true or false", "true or false"),
    "string": ("TEXT", "a text"),
    "array of string": ("[TEXT, TEXT, ...]", "a list of texts, one at least"),
    "array of object": ("[EDIT, EDIT, ...]", "a list of edits, one at least"),
}


def _sort(field: Mapping[str, Any]) -> tuple[str, str]:
    name: str = field["type"]
    return _SORTS[f"{name} of {field['items']['type']}" if "items" in field else name]


def form(answer: Mapping[str, Any]) -> str:
    """A schema as a prompt shows it."""
    fields = answer["properties"].items()
    shown = (f'"{n}": {n.upper() if "enum" in kind else _sort(kind)[0]}' for n, kind in fields)
    return "{" + ", ".join(shown) + "}"


def faults(error: ValidationError, model: type[BaseModel], answer: Mapping[str, Any]) -> list[str]:
    """The wrong fields of an answer, a line each."""
    kinds, lines = schema(model)["properties"], []
    for field in dict.fromkeys(str(e["loc"][0]) for e in error.errors()):
        if field not in answer:
            lines.append(f"{field}: expected a value, found none")
            continue
        words, text = kinds[field].get("enum"), repr(answer[field])
        wanted = f"one of {', '.join(words)}" if words else _sort(kinds[field])[1]
        shown = text if len(text) <= 60 else text[:60] + "..."
        lines.append(f"{field}: expected {wanted}, found {shown}")
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
    COPY = "copy"  # the tree is known already
    LINT = "lint"  # `islandgp check` warns of the tree
    EDITS = "edits"  # no edit makes a usable tree


@dataclass(frozen=True, slots=True)
class Rejection:
    """A rejected answer."""

    stage: RejectionStage
    error: str  # for the model, and for the record


def read_answer(reply: Reply, model: type[A]) -> A | Rejection:
    """Reads the JSON object of an answer as an instance of a pydantic model, or rejects it."""
    if reply.stop_reason == "refusal":
        return Rejection(RejectionStage.REFUSED, "the model refused to answer")
    cut_off = reply.stop_reason == "max_tokens"
    if not reply.text.strip():
        why = "an answer that was cut off before its first word; think much less"
        why = why if cut_off else "an empty answer"
        return Rejection(RejectionStage.JSON, f"Expected one JSON object, found {why}.")
    fields = find_object(reply.text, model.model_fields)
    # If a further object was begun when the tokens ran out, those before it are drafts.
    if fields is None or (cut_off and "{" in _objects(reply.text)[1]):
        why = "an answer that was cut off; make it much shorter"
        why = why if cut_off else "none that can be read"
        return Rejection(RejectionStage.JSON, f"Expected one JSON object, found {why}.")
    # JSON escapes can encode characters that were removed from the text itself.
    values = {key: cleaned(value) for key, value in fields.items()}
    try:
        return model.model_validate(values)
    except ValidationError as error:
        return Rejection(RejectionStage.FIELDS, "\n".join(faults(error, model, values)))


def cleaned(value: Any) -> Any:
    """A value with `clean` applied to a text or to the texts of a list."""
    if isinstance(value, list):
        return [clean(each) if isinstance(each, str) else each for each in value]
    return clean(value) if isinstance(value, str) else value


def find_object(text: str, fields: Collection[str]) -> dict[str, Any] | None:
    """Finds the JSON object of an answer from a server without schemas.

    Other text may surround it. Drafts come before it, and text inside `<think>` is ignored.

    Args:
        text: of the answer.
        fields: that the object should have.

    Returns:
        The last object with all of the fields, or else with any of them, or else the last one;
        None if there is none or the text is too long.
    """
    if len(text) > SANE:
        return None
    objects, _ = _objects(text)
    whole = [value for value in objects if all(field in value for field in fields)]
    some = [value for value in objects if any(field in value for field in fields)]
    return next((values[-1] for values in (whole, some, objects) if values), None)


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
