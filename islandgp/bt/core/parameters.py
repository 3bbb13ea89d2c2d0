"""Arguments of actions, declared by a domain: numbers, whole numbers, words, flags and texts.

    "MoveTo": Action("goes to a place", arguments={
        "goal": one_of("where to", ("dock", "door")),
        "speed": real("how fast", 0.1, 1.0, unit="m/s", default=0.5),
    })

A tree has e.g. `MoveTo(goal: door, speed: 0.8)`. Arguments that are left out have their defaults.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass, fields
from functools import cache
from math import inf, isfinite, sqrt
from numbers import Real
from types import UnionType
from typing import Any, Final, Literal, get_args, get_origin, get_type_hints

from islandgp.bt.core.kinds import NAME
from islandgp.bt.core.node import ActionArgs, Node, Value
from islandgp.errors import DomainError

NO_YES: Final = ("no", "yes")
"""The words of a flag."""

MAX_MAGNITUDE: Final = 1_000_000  # magnitude of a number
SMALLEST_STEP: Final = 1e-9  # smallest step of random numbers


@dataclass(frozen=True, slots=True)
class Parameter:
    """An argument of an action."""

    meaning: str  # one line
    sort: Literal["number", "integer", "word", "flag", "text"]
    default: Value  # a number, or a word; of a flag "no" or "yes"
    low: float = 0.0  # of a number
    high: float = 1.0
    step: float | None = None  # random numbers are `low` plus a multiple of it; None: any number
    logarithmic: bool = False  # True: random numbers are log-uniform
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
        key: value == NO_YES[1]
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
        if not isinstance(each, Parameter):
            raise DomainError(
                f"Expected real, whole, one_of, switch or text for {at}, found {each!r}."
            )
        check_fields(each, at)
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
            _check_range(each, at)
        if not fits(each, each.default):
            raise DomainError(
                f"Expected a default of {value_range(each)} for {at}, found {each.default!r}."
            )


def _check_range(each: Parameter, at: str) -> None:
    least = 0.0 if each.logarithmic else -inf
    if not (-MAX_MAGNITUDE <= each.low < each.high <= MAX_MAGNITUDE and each.low > least):
        above = " above 0" if each.logarithmic else ""
        raise DomainError(
            f"Expected low < high{above}, at most {MAX_MAGNITUDE:,}, for {at}, found {each.low:g},"
            f" {each.high:g}."
        )
    if each.step is not None and not SMALLEST_STEP <= each.step <= each.high - each.low:
        raise DomainError(
            f"Expected a step from {SMALLEST_STEP:g} to high - low, or None, for {at}, found"
            f" {each.step:g}."
        )
    if each.sort == "integer" and (each.low != int(each.low) or each.high != int(each.high)):
        raise DomainError(f"Expected whole numbers as low and high of {at}.")


def check_fields(entry: object, where: str) -> None:
    """Check the types of a dataclass's fields, and that its numbers are finite.

    Args:
        entry: an instance of a dataclass.
        where: its name in messages.

    Raises:
        DomainError: a field has a value of another type than its annotation.
    """
    kind: Any = type(entry)
    for name in (each.name for each in fields(kind)):
        value, hint = getattr(entry, name), _hints(kind)[name]
        if not _fits(value, hint):
            raise DomainError(
                f"Expected {_expected(hint)} as {name} of {where}, found {value!r:.60}."
            )


@cache
def _hints(kind: type) -> dict[str, Any]:
    return get_type_hints(kind)


def _expected(hint: Any) -> str:
    """An annotation in words."""
    if get_origin(hint) is UnionType:
        return " or ".join(map(_expected, get_args(hint)))
    names = {float: "a finite number", str: "a text", bool: "True or False", type(None): "None"}
    return names.get(hint) or str(hint).replace("collections.abc.", "").replace(", ...", "")


def _fits(value: object, hint: Any) -> bool:
    """True if a value has the annotated type; a number must be finite."""
    origin, parts = get_origin(hint), get_args(hint)
    if origin is UnionType:
        return any(_fits(value, item) for item in parts)
    if origin is Literal:
        return value in parts
    if origin is tuple:
        return isinstance(value, tuple) and all(_fits(item, parts[0]) for item in value)
    if origin is frozenset:
        return isinstance(value, frozenset) and all(_fits(item, parts[0]) for item in value)
    if origin is Mapping:
        return isinstance(value, Mapping)
    if hint is float:
        return isinstance(value, Real) and _is_finite(value)
    return isinstance(value, hint)


def _is_finite(value: Real) -> bool:
    try:
        return isfinite(value)
    except OverflowError:
        return False
