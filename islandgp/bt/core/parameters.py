"""Arguments of actions, declared by a domain: numbers, whole numbers, words, flags and texts.

    "MoveTo": Action("goes to a place", arguments={
        "goal": one_of("where to", ("dock", "door")),
        "speed": real("how fast", 0.1, 1.0, unit="m/s", default=0.5),
    })

A tree has e.g. `MoveTo(goal: door, speed: 0.8)`. Arguments that are left out have their defaults.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Collection, Iterable, Mapping
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import cache
from math import isfinite, sqrt
from typing import Annotated, Any, ClassVar, Final, Literal, TypeAlias

from pydantic import (
    AfterValidator,
    BeforeValidator,
    ConfigDict,
    PlainSerializer,
    PlainValidator,
    Strict,
    TypeAdapter,
    ValidationError,
)

from islandgp.bt.core.condition import FLAG_OPERATORS, OPERATORS, Condition
from islandgp.bt.core.kinds import NAME, RESERVED
from islandgp.bt.core.node import FAILURE, RUNNING, STATUS_NAMES, SUCCESS, ActionArgs, Node, Value
from islandgp.errors import DomainError

NO_YES: Final = ("no", "yes")  # the words of a flag

MAX_MAGNITUDE: Final = 1_000_000  # magnitude of a number
SMALLEST_STEP: Final = 1e-9  # smallest step of random numbers


def expect(holds: object, expected: str, found: object) -> None:
    """Raises ValueError unless a declaration holds what is expected."""
    if not holds:
        raise ValueError(f"expected {expected}, found {found}")


def _finite(value: Any) -> Any:
    with suppress(TypeError, OverflowError):
        if not isinstance(value, bool | str) and isfinite(value):
            return value
    raise ValueError("expected a finite number")


def _identifier(word: str) -> str:
    expect(NAME.fullmatch(word), "names and words of letters, digits and _", f"{word!r}; rename it")
    return word


def _name(word: str) -> str:
    expected = "a name of letters, digits and _ that is not a keyword of the language"
    expect(is_name(word), expected, f"{word!r}; rename it")
    return word


Number: TypeAlias = Annotated[float, PlainValidator(_finite), PlainSerializer(lambda n: n)]
Flag: TypeAlias = Annotated[bool, Strict()]
Identifier: TypeAlias = Annotated[str, AfterValidator(_identifier)]
Name: TypeAlias = Annotated[str, AfterValidator(_name)]
CHECKED: Final = ConfigDict(extra="forbid", revalidate_instances="always")
"""How `validated` reads the fields of a declaration."""


STATUSES: Final = frozenset({FAILURE, SUCCESS, RUNNING})


def is_name(word: object) -> bool:
    """True if a word is a valid name of an action or a key."""
    return isinstance(word, str) and NAME.fullmatch(word) is not None and word not in RESERVED


def _statuses(declared: Any) -> Any:
    """Statuses from their names."""
    if isinstance(declared, str) or not isinstance(declared, Collection):
        return declared
    numbers = [STATUS_NAMES.index(s) if s in STATUS_NAMES else s for s in declared]
    is_known = numbers and STATUSES.issuperset(numbers)
    expect(is_known, "statuses among FAILURE, SUCCESS and RUNNING", [*declared])
    return numbers


def _condition(declared: Any) -> Condition:
    """A condition from a list of a key, an operator and a right side: a number, word or key."""
    if isinstance(declared, Condition):
        return declared
    is_triple = isinstance(declared, list | tuple) and len(declared) == 3
    expect(is_triple, "a key, an operator, and a number, word or key", declared)
    key, operator, right = declared
    operators = (*OPERATORS, *FLAG_OPERATORS)
    expect(operator in operators, f"one of {', '.join(operators)}", repr(operator))
    is_word = isinstance(right, str)
    return Condition(key, operator, 0.0 if is_word else float(right), right if is_word else "")


def _word(word: str) -> str:
    is_word = is_name(word) or (not NAME.fullmatch(word) and is_text(word))
    expect(is_word, "words that are names, or lines of text without double quotes", repr(word))
    return word


Word: TypeAlias = Annotated[str, AfterValidator(_word)]
Statuses: TypeAlias = Annotated[
    frozenset[Annotated[int, Strict()]],
    BeforeValidator(_statuses),
    PlainSerializer(lambda statuses: [STATUS_NAMES[each] for each in sorted(statuses)]),
]
Conditions: TypeAlias = tuple[
    Annotated[
        Condition,
        PlainValidator(_condition),
        PlainSerializer(
            lambda c: [c.key, c.operator, c.other or getattr(c.number, "name", c.number)]
        ),
    ],
    ...,
]


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
    words: tuple[Identifier, ...] = ()  # of a word or a flag
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
    meaning: str, low: int, high: int, *, default: int | None = None, **rest: Any
) -> Parameter:
    """A whole number from `low` to `high`; its default is `low` if none is given.

    `rest`: logarithmic and unit, as of `real`.
    """
    default = low if default is None else default
    return replace(real(meaning, low, high, default=default, step=1.0, **rest), sort="integer")


def one_of(meaning: str, words: Collection[str], default: str | None = None) -> Parameter:
    """One of a few words; its default is the first if none is given."""
    listed = listed_words(words)
    return Parameter(meaning, "word", listed[0] if default is None else default, words=listed)


def listed_words(words: Collection[str]) -> tuple[str, ...]:
    """The declared words as a tuple. Raises DomainError if there is none, or for a text."""
    if isinstance(words, str) or not isinstance(words, Collection) or not words:
        raise DomainError(f"Expected a list of words, as in ['dock', 'door'], found {words!r}.")
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


def spelled_out(tree: Node, parameters: Callable[[str], Mapping[str, Parameter]]) -> Node:
    """A tree with the arguments of its actions that have their defaults, too, to be read.

    `parameters`: returns those of the action with a name.
    """
    args = tree.args
    if isinstance(args, ActionArgs):
        values = argument_values(args, parameters(args.name))
        args = ActionArgs(args.name, tuple(values.items()))
    return Node(tree.kind, args, tuple(spelled_out(child, parameters) for child in tree.children))


def bound(args: ActionArgs, parameters: Mapping[str, Parameter]) -> dict[str, Value | bool]:
    """`argument_values` for the leaf's code: a flag is True or False, a whole number an int."""
    return {
        name: value if referenced(value) else _bound(value, parameters[name].sort)
        for name, value in argument_values(args, parameters).items()
    }


def _bound(value: Value, sort: str) -> Value | bool:
    return value == NO_YES[1] if sort == "flag" else int(value) if sort == "integer" else value


def check_range(entry: Any, whole: Iterable[float], *, above_0: bool = False) -> None:
    """Raises ValueError for an empty or too large range of a parameter or a key.

    Args:
        entry: with low, high and step.
        whole: numbers that have no decimals.
        above_0: True if all values are above 0.
    """
    low, high, step = entry.low, entry.high, entry.step
    expect(
        -MAX_MAGNITUDE <= low < high <= MAX_MAGNITUDE and not (above_0 and low <= 0),
        f"low < high{' above 0' * above_0}, both from -{MAX_MAGNITUDE:,} to {MAX_MAGNITUDE:,}",
        f"{low:g}, {high:g}",
    )
    is_step = step is None or SMALLEST_STEP <= step <= high - low
    expect(is_step, f"a step from {SMALLEST_STEP:g} to high - low", step)
    expect(not any(n % 1 for n in whole), "whole numbers as low, high, step and most", [*whole])


def _checked(each: Parameter) -> Parameter:
    """Raises ValueError for a parameter whose fields contradict each other."""
    is_flag = each.sort == "flag"
    is_switch = not is_flag or each.words == NO_YES
    expect(is_switch, "no and yes as the words of a flag (use switch)", [*each.words])
    is_choice = each.sort != "word" or (each.words and len({*each.words}) == len(each.words))
    expect(is_choice, "at least one word, each once", [*each.words])
    if each.numeric:
        whole = (each.low, each.high) if each.sort == "integer" else ()
        check_range(each, whole, above_0=each.logarithmic)
    expect(fits(each, each.default), f"a default of {value_range(each)}", repr(each.default))
    return each


def _from_declaration(declaration: object) -> object:
    """The fields of a `Parameter` from those in a file: a flag may be true or false."""
    if not isinstance(declaration, Mapping):
        return declaration
    fields = {"meaning": "", **declaration}
    if fields.get("sort") == "flag":
        default = fields.get("default", False)
        default = NO_YES[default] if isinstance(default, bool) else default
        fields = {"words": NO_YES, **fields, "default": default}
    return fields


Arguments: TypeAlias = Mapping[
    Identifier, Annotated[Parameter, BeforeValidator(_from_declaration), AfterValidator(_checked)]
]


PLAINER: Final = {"field required": "a value", "unexpected keyword argument": "no such field"}
"""What is expected, for messages of pydantic that say what is wrong."""


def validated(kind: Any, value: Any, where: str, context: Any = None) -> Any:
    """Validate declarations with their annotations.

    Args:
        kind: a type.
        value: of this type.
        where: its name in messages; if it has {}, of the entry of a mapping.
        context: for the validators of the type.

    Returns:
        The value; lists as tuples, and mappings of fields as objects.

    Raises:
        DomainError: a part of the value has another type.
    """
    try:
        return adapter(kind).validate_python(value, context=context)
    except ValidationError as error:
        at, message, value = first_fault(error)
        if "{}" in where:
            where = where.format(at.pop(0) if at else "NAME")
        if at[:1] == ["arguments"] and at[1:]:
            where, at = f"the argument {at[1]} of {where}", at[2:]
        plainer = re.sub("^(expected|input should be) ", "", PLAINER.get(message, message))
        expected, _, found = plainer.partition(", found ")
        field = f"as {'.'.join(at)} of" if at else "for"
        found = found or f"{value!r:.60}"
        raise DomainError(f"Expected {expected} {field} {where}, found {found}.") from None


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
