"""Arguments of actions, declared by a domain: numbers, whole numbers, words, flags and texts.

    "MoveTo": Action("goes to a place", arguments={
        "goal": one_of("where to", ("dock", "door")),
        "speed": real("how fast", 0.1, 1.0, unit="m/s", default=0.5),
    })

A tree has e.g. `MoveTo(goal: door, speed: 0.8)`. Arguments that are left out have their defaults.
"""

from __future__ import annotations

import json
import re
from collections.abc import Collection, Iterable, Mapping
from contextlib import suppress
from dataclasses import dataclass
from functools import cache
from math import isfinite, sqrt
from typing import Annotated, Any, ClassVar, Final, Literal, TypeAlias

from pydantic import (
    ConfigDict,
    PlainSerializer,
    PlainValidator,
    Strict,
    TypeAdapter,
    ValidationError,
)

from islandgp.bt.core.kinds import NAME
from islandgp.bt.core.node import ActionArgs, Node, Value
from islandgp.errors import DomainError

NO_YES: Final = ("no", "yes")
"""The words of a flag."""

MAX_MAGNITUDE: Final = 1_000_000  # magnitude of a number
SMALLEST_STEP: Final = 1e-9  # smallest step of random numbers


def _finite(value: Any) -> Any:
    with suppress(TypeError, OverflowError):
        if not isinstance(value, bool | str) and isfinite(value):
            return value
    raise ValueError("expected a finite number")


Number: TypeAlias = Annotated[float, PlainValidator(_finite), PlainSerializer(lambda n: n)]
Flag: TypeAlias = Annotated[bool, Strict()]
CHECKED: Final = ConfigDict(extra="forbid", revalidate_instances="always")
"""How `validated` reads the fields of a declaration."""


@dataclass(frozen=True, slots=True)
class Parameter:
    """An argument of an action."""

    __pydantic_config__: ClassVar = CHECKED

    meaning: str  # one line
    sort: Literal["number", "integer", "word", "flag", "text"]
    default: Number | str  # a number, or a word; of a flag "no" or "yes"
    low: Number = 0.0  # of a number
    high: Number = 1.0
    step: Number | None = None  # random numbers are `low` plus a multiple of it; None: any number
    logarithmic: Flag = False  # True: random numbers are log-uniform
    words: tuple[str, ...] = ()  # of a word or a flag
    unit: str = ""

    @property
    def numeric(self) -> bool:
        """True if its values are numbers."""
        return self.sort in ("number", "integer")


def real(
    meaning: str,
    low: float,
    high: float,
    *,
    default: float | None = None,
    step: float | None = None,
    logarithmic: bool = False,
    unit: str = "",
) -> Parameter:
    """A number from `low` to `high`; its default is the middle of the range if none is given."""
    if default is None:
        try:
            default = sqrt(low * high) if logarithmic and low > 0 else (low + high) / 2
        except (TypeError, OverflowError):  # the vocabulary reports the range
            default = 0.0
    return Parameter(meaning, "number", default, low, high, step, logarithmic, (), unit)


def whole(
    meaning: str,
    low: int,
    high: int,
    *,
    default: int | None = None,
    logarithmic: bool = False,
    unit: str = "",
) -> Parameter:
    """A whole number from `low` to `high`; its default is `low` if none is given."""
    default = low if default is None else default
    return Parameter(meaning, "integer", default, low, high, 1.0, logarithmic, (), unit)


def one_of(meaning: str, words: Collection[str], default: str | None = None) -> Parameter:
    """One of a few words; its default is the first if none is given."""
    listed = word_list(words, meaning)
    first = listed[0] if listed else ""
    return Parameter(meaning, "word", first if default is None else default, words=listed)


def word_list(words: Collection[str], meaning: str) -> tuple[str, ...]:
    """The words of a declaration as a tuple. Raises DomainError for a text or another object."""
    if isinstance(words, str) or not isinstance(words, Collection):
        raise DomainError(
            f"Expected a list of words, as in ['dock', 'door'], for {meaning!r}, found {words!r}."
        )
    return (*words,)


def text(meaning: str, default: str = "") -> Parameter:
    """A line of text without double quotes, such as a name of ROS; evolution never changes it."""
    return Parameter(meaning, "text", default)


def switch(meaning: str, *, default: bool = False) -> Parameter:
    """Yes or no."""
    word = NO_YES[default] if isinstance(default, bool) else default
    return Parameter(meaning, "flag", word, words=NO_YES)


def value_range(parameter: Parameter) -> str:
    """The values that a parameter can have, in words: `0.1 to 1 m/s`, `dock | door`."""
    if parameter.words:
        return " | ".join(parameter.words)
    if parameter.sort == "text":
        return '"a text"'
    kind = "a whole number from " if parameter.sort == "integer" else ""
    return f"{kind}{parameter.low:g} to {parameter.high:g} {parameter.unit}".rstrip()


def signature(name: str, parameters: Mapping[str, Parameter]) -> str:
    """An action as text, with the ranges of its arguments."""
    ranges = (f"{key}: {value_range(each)}" for key, each in parameters.items())
    return f"{name}({', '.join(ranges)})" if parameters else name


def described(meaning: str, parameters: Mapping[str, Parameter], uses: Collection[str] = ()) -> str:
    """The meaning of an action, with its arguments, their defaults, and the resources it uses."""
    lines = (f"{key} {each.meaning}, else {each.default}" for key, each in parameters.items())
    used = [f"uses {', '.join(uses)}"] * bool(uses)
    return "; ".join([meaning, *lines, *used])


REFERENCE: Final = re.compile(r"\{([A-Za-z_][A-Za-z0-9_]*)\}")
"""An argument's value that is the value of a key, `"{place}"`, as in BehaviorTree.CPP."""


def referenced(value: object) -> str:
    """The key that gives an argument its value; "" if it is none."""
    match = REFERENCE.fullmatch(value) if isinstance(value, str) else None
    return match[1] if match else ""


def is_text(value: str) -> bool:
    """True if a text can be written between double quotes."""
    return value.isprintable() and '"' not in value


def fits(parameter: Parameter, value: object) -> bool:
    """True if a parameter can have a value."""
    if parameter.words:
        return isinstance(value, str) and value in parameter.words
    if parameter.sort == "text":
        return isinstance(value, str) and is_text(value)
    if isinstance(value, bool) or not isinstance(value, float | int):
        return False
    is_whole = parameter.sort == "number" or value == int(value)
    return parameter.low <= value <= parameter.high and is_whole


def leaf_of(name: str, values: Mapping[str, Value], parameters: Mapping[str, Parameter]) -> Node:
    """A leaf in its canonical form: values in the declared order, and without defaults."""
    non_default = tuple(
        (key, values[key])
        for key, parameter in parameters.items()
        if key in values and values[key] != parameter.default
    )
    return Node("action", ActionArgs(name, non_default))


def argument_values(args: ActionArgs, parameters: Mapping[str, Parameter]) -> dict[str, Value]:
    """The value of each parameter of a leaf with these arguments, as in the text of a tree."""
    values = dict(args.values)
    return {key: values.get(key, each.default) for key, each in parameters.items()}


def bound(args: ActionArgs, parameters: Mapping[str, Parameter]) -> dict[str, Value | bool]:
    """`argument_values` for the leaf's code: a flag is True or False, a whole number an int."""
    return {
        key: value
        if referenced(value)
        else value == NO_YES[1]
        if parameters[key].sort == "flag"
        else _number(value, parameters[key])
        for key, value in argument_values(args, parameters).items()
    }


def _number(value: Value, parameter: Parameter) -> Value:
    return int(value) if parameter.sort == "integer" else value


def check_parameters(parameters: Mapping[str, Parameter], where: str) -> None:
    """Raises DomainError for an invalid declaration of a parameter.

    Args:
        parameters: by name.
        where: the action, for messages.
    """
    for name, each in parameters.items():
        at = f"the argument {name} of {where}"
        for word in (name, *each.words):
            if not isinstance(word, str) or not NAME.fullmatch(word):
                raise DomainError(
                    f"Expected names and words of letters, digits and _ for {at}, found {word!r};"
                    " rename it."
                )
        if (each.sort == "flag") != (each.words == NO_YES and each.sort != "word"):
            raise DomainError(f"Expected no and yes as the words of a flag, for {at}; use switch.")
        if each.sort == "word" and len(set(each.words)) < max(1, len(each.words)):
            raise DomainError(
                f"Expected at least one word, each once, for {at}, found {[*each.words]}."
            )
        if each.numeric:
            whole = (each.low, each.high) if each.sort == "integer" else ()
            check_range(each, at, whole, above_0=each.logarithmic)
        if not fits(each, each.default):
            raise DomainError(
                f"Expected a default of {value_range(each)} for {at}, found {each.default!r}."
            )


def check_range(entry: Any, where: str, whole: Iterable[float] = (), *, above_0: bool) -> None:
    """Raises DomainError for an empty or too large range of a parameter or a key.

    Args:
        entry: with low, high and step.
        where: its name in messages.
        whole: numbers that have no decimals.
        above_0: True if all values are above 0.
    """
    low, high, step = entry.low, entry.high, entry.step
    if not -MAX_MAGNITUDE <= low < high <= MAX_MAGNITUDE or (above_0 and low <= 0):
        raise DomainError(
            f"Expected low < high{' above 0' * above_0}, both from -{MAX_MAGNITUDE:,} to"
            f" {MAX_MAGNITUDE:,}, for {where}, found {low:g}, {high:g}."
        )
    if step is not None and not SMALLEST_STEP <= step <= high - low:
        raise DomainError(
            f"Expected a step from {SMALLEST_STEP:g} to high - low for {where}, found {step:g}."
        )
    if wrong := [number for number in whole if number % 1]:
        raise DomainError(
            f"Expected whole numbers as low, high, step and most of {where}, found {wrong[0]!r}."
        )


def from_declaration(declaration: object) -> object:
    """The fields of a `Parameter` from those in a file: a flag may be true or false."""
    if not isinstance(declaration, Mapping):
        return declaration
    fields = {"meaning": "", **declaration}
    if fields.get("sort") == "flag":
        fields = {"words": NO_YES, **fields}
        default = fields.get("default", NO_YES[0])
        fields["default"] = NO_YES[default] if isinstance(default, bool) else default
        if fields["default"] not in NO_YES:
            found = json.dumps(default)
            raise ValueError(f"expected no | yes as the default of a flag, found {found}")
    return fields


def validated(kind: Any, value: Any, where: str) -> Any:
    """Validate declarations with their annotations.

    Args:
        kind: a type.
        value: of this type.
        where: its name in messages; if it has {}, of the entry of a mapping.

    Returns:
        The value; lists as tuples, and mappings of fields as objects.

    Raises:
        DomainError: a part of the value has another type.
    """
    try:
        return adapter(kind).validate_python(value)
    except ValidationError as error:
        at, expected, found = first_fault(error)
        if "{}" in where:
            where = where.format(at.pop(0) if at else "NAME")
        if at[:1] == ["arguments"]:
            where, at = f"the argument {at[1]} of {where}", at[2:]
        expected = re.sub("^(expected|input should be) ", "", expected)
        field = f"as {'.'.join(at)} of" if at else "for"
        raise DomainError(f"Expected {expected} {field} {where}, found {found!r:.60}.") from None


def first_fault(error: ValidationError) -> tuple[list[str], str, Any]:
    """The path of the first wrong part, what is expected there, and what was found."""
    first = error.errors(include_url=False, include_context=False)[0]
    at = [str(each) for each in first["loc"] if each != "str" and "[" not in str(each)]
    message = first["msg"].removeprefix("Value error, ")
    return at, message[0].lower() + message[1:], first["input"]


@cache
def adapter(kind: Any) -> TypeAdapter[Any]:
    """Reads and writes values of a type."""
    return TypeAdapter(kind)
