"""The vocabulary of a domain: its actions and blackboard keys (section 2.2.3).

The parser, random trees, prompts, exporters and documentation all use the vocabulary; actions and
keys are declared nowhere else.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from math import inf
from typing import Annotated, Any, ClassVar, Final, TypeAlias

from pydantic import AfterValidator, BeforeValidator, ValidationInfo

from islandgp.bt.core.arithmetic import Named
from islandgp.bt.core.condition import FLAG_OPERATORS, OPERATORS, WHOLE
from islandgp.bt.core.condition import Condition as Condition  # for those who declare actions
from islandgp.bt.core.kinds import NAME as NAME
from islandgp.bt.core.kinds import RESERVED as RESERVED
from islandgp.bt.core.node import FAILURE, RUNNING, SUCCESS, Node, Value
from islandgp.bt.core.parameters import (
    CHECKED,
    NO_YES,
    STATUSES,
    Arguments,
    Conditions,
    Flag,
    Name,
    Number,
    Parameter,
    Statuses,
    Word,
    check_range,
    expect,
    leaf_of,
    listed_words,
    validated,
)
from islandgp.errors import DomainError

EQUALITY: Final = ("==", "!=")  # the operators that compare words


@dataclass(frozen=True, slots=True)
class Action:
    """A leaf that acts on the world.

    Statuses and conditions must hold in every world of the domain: `simplify` relies on the
    statuses, and `check` on the conditions.
    """

    __pydantic_config__: ClassVar = CHECKED

    meaning: str = ""  # one line: what it does, when it succeeds and fails
    statuses: Statuses = STATUSES  # that it can return
    to_start: Conditions = ()  # it fails in its first tick unless these hold
    to_succeed: Conditions = ()  # these hold in the tick in which it succeeds
    gives: Conditions = ()  # these hold after its success, for searches that plan
    changes: Mapping[str, int] = field(default_factory=dict)
    """Keys that its success changes: -1 makes the value smaller, 1 larger."""
    after: tuple[str, ...] = ()
    """Actions that often succeed right before it. Random trees insert some of them before it."""
    arguments: Arguments = field(default_factory=dict)
    """By name, in the order in which trees are written."""
    condition: Flag = False  # never RUNNING and without effect; see `condition_leaf`
    sets: tuple[str, ...] = ()  # keys that its end can write, before the rest of the tree is ticked
    uses: tuple[Name, ...] = ()
    """Resources that it holds until it ends, such as the base of a robot. Two actions that share
    one never run at once; one that ends frees it for the rest of the tick."""


def condition_leaf(meaning: str, arguments: Mapping[str, Parameter] | None = None) -> Action:
    """A condition evaluated by the domain's code: a leaf that succeeds or fails within its tick.

    Args:
        meaning: one line: when it succeeds.
        arguments: as those of an `Action`.
    """
    ends = frozenset({FAILURE, SUCCESS})
    return Action(meaning, ends, arguments=arguments or {}, condition=True)


@dataclass(frozen=True, slots=True)
class Key:
    """A blackboard entry that conditions can read."""

    __pydantic_config__: ClassVar = CHECKED

    meaning: str = ""  # one line, with the unit
    flag: Flag = True  # yes or no; False: a number
    low: Number = 0.0  # least value
    high: Number = 1.0  # greatest threshold of a random tree
    step: Number = 1.0  # distance between two thresholds of random trees, > 0
    most: Number | None = None  # greatest value in any world; None: unbounded
    noise: Number = 0.0  # standard deviation that perturbed worlds add to a number, >= 0
    whole: Flag = False  # True: a whole number, of which thresholds have no decimals
    words: tuple[Word, ...] = ()  # its values if it is one of some words or texts; else empty
    initial: Number | str | None = None
    """The value that it has until a tree writes it: a number, a word, yes or no. None: it belongs
    to the domain, which writes it before each tick, and no tree writes it."""

    @property
    def writable(self) -> bool:
        """True if trees can write it by `set`, or it is the result of an action."""
        return self.initial is not None

    @property
    def start(self) -> float:
        """The initial value as a number; of a word its index."""
        words = NO_YES if self.flag else self.words
        start = self.initial
        return float(words.index(start) if isinstance(start, str) else start or 0)

    @property
    def choices(self) -> tuple[str, ...]:
        """The words that it can have: those declared, or no and yes; of a number none."""
        return NO_YES if self.flag else self.words

    @property
    def kind(self) -> str:
        """The type of its values, for messages: a number, a flag, or the words."""
        if self.words:
            return f"one of {', '.join(self.words)}"
        return "a flag" if self.flag else "a number"

    @property
    def bounds(self) -> tuple[float, float]:
        """Its least and greatest value as a number; of a flag 0 and 1, of a word an index."""
        return self.low, 1.0 if self.flag else inf if self.most is None else self.most

    @property
    def operators(self) -> tuple[str, ...]:
        """The operators of its comparisons: words have no order, and flags no comparison."""
        return () if self.flag else EQUALITY if self.words else OPERATORS

    @property
    def values(self) -> str:
        """The values that it can have, in words."""
        kind = "a whole number" if self.whole else "a number"
        upper = "" if self.most is None else f" and at most {self.most:g}"
        return " | ".join(self.choices) or f"{kind} of at least {self.low:g}{upper}"

    def can_be(self, value: float | str) -> bool:
        """True if it can have a value: a number, or one of its words."""
        if self.choices or isinstance(value, str):
            return value in self.choices
        in_range = self.low <= value and (self.most is None or value <= self.most)
        return in_range and not (self.whole and value % 1)

    def example(self, name: str) -> str:
        """A condition on the key of this name."""
        if self.words:
            return f"{name} == {self.words[0]}"
        return name if self.flag else f"{name} < 5"

    def number_of(self, word: str) -> Named:
        """The value of a word on the blackboard: its index. Raises ValueError if it has none."""
        return Named(str(word), self.words.index(word))

    def indexed(self, value: Any) -> Any:
        """The index of a word; any other value unchanged."""
        return self.words.index(value) if isinstance(value, str) and value in self.words else value

    def text_of(self, value: float) -> str:
        """A value as text: a word, `yes`, `no`, or a number."""
        if self.words and 0 <= value < len(self.words):
            return self.words[int(value)]
        return ("yes" if value else "no") if self.flag else f"{value:g}"


def flag(meaning: str, *, initial: str | None = None) -> Key:
    """A key that is yes or no; with `initial` trees can write it."""
    return Key(meaning, initial=initial)


def number(
    meaning: str,
    low: float,
    high: float,
    step: float = 1.0,
    *,
    most: float | None = None,
    noise: float = 0.0,
    initial: float | None = None,
) -> Key:
    """A key that is a number >= `low`; random thresholds are on a grid up to `high`.

    With `initial`, its first value, trees can write it.
    """
    return Key(meaning, False, low, high, step, most, noise, initial=initial)


def integer(meaning: str, low: int, high: int, step: int = 1, **fields: Any) -> Key:
    """A key that is a whole number, with noise too; otherwise as `number`."""
    return replace(number(meaning, low, high, step, **fields), whole=True)


def enumeration(meaning: str, words: Collection[str], *, initial: str | None = None) -> Key:
    """A key whose value is one of some words, such as the mode of a robot.

    Its value on a blackboard is the index of the word. With `initial`, its first word, trees can
    write it.
    """
    listed = listed_words(words)
    last = len(listed) - 1
    return Key(meaning, flag=False, high=last, most=last, whole=True, words=listed, initial=initial)


def _key_fields(declared: Any) -> Any:
    """The fields of a `Key` from those in a file; one with a range is a number by default."""
    if not isinstance(declared, dict):
        return declared
    if declared.get("words") or {"words", "flag"} & declared.keys() == {"words"}:
        last = len(listed_words(declared["words"])) - 1
        return {**declared, "flag": False, "whole": True, "high": last, "most": last}
    fields = {"flag": not declared.keys() & {"low", "high", "step", "most", "whole"}, **declared}
    if isinstance(fields.get("initial"), bool):
        fields["initial"] = NO_YES[fields["initial"]]
    return fields


def _checked_key(key: Key) -> Key:
    """Raises ValueError for a key whose fields contradict each other."""
    words = key.choices
    expect(len({*words}) == len(words), "different words", [*words])
    if words:
        is_plain = not key.noise and not (key.flag and (key.words or key.whole))
        expect(is_plain, "flag(...) or enumeration(...), without noise", key.meaning)
    else:
        check_range(key, (key.low, key.high, key.step, key.most or 0) if key.whole else ())
        is_above = key.most is None or key.most > key.low
        expect(is_above, "most above low", f"{key.most}, {key.low:g}")
        expect(key.noise >= 0, "noise of at least 0", key.noise)
    can_have = key.initial is None or key.can_be(key.initial)
    expect(can_have, f"{key.values} as initial", repr(key.initial))
    return key


def _checked_action(action: Action, info: ValidationInfo) -> Action:
    """The action with the numbers of words in its conditions. Raises ValueError.

    The context is the vocabulary; None: its names are not checked.
    """
    if info.context is None:
        return action
    keys, actions, resources = info.context.keys, info.context.actions, info.context.resources

    def numbered(term: Condition) -> Condition:
        key = keys.get(term.key)
        if key is None or term.other not in key.words:
            return term
        return Condition(term.key, term.operator, key.number_of(term.other))

    declared = (action.to_start, action.to_succeed, action.gives)
    start, succeed, gives = (tuple(map(numbered, each)) for each in declared)
    is_condition = action.condition and (RUNNING in action.statuses or action.changes)
    expect(not is_condition, "neither RUNNING nor changes of a condition (condition_leaf)", "both")
    signs = [*action.changes.values()]
    expect({*signs} <= {-1, 1}, "-1 or 1 as its changes", signs)
    terms = (*start, *succeed, *gives)
    for key in (*(key for term in terms for key in term.keys), *action.changes):
        expect(key in keys, "keys of the vocabulary in its conditions and changes", repr(key))
    for term in terms:
        operators = keys[term.key].operators or FLAG_OPERATORS
        expected = f"one of {', '.join(operators)} with {term.key} in its conditions"
        expect(term.operator in operators, expected, repr(term.operator))
    for key in action.sets:
        is_writable = key in keys and keys[key].writable
        expect(is_writable, "keys with an initial value as `sets`", repr(key))
    for resource in action.uses if resources else ():
        expected = f"resources of the vocabulary ({', '.join(resources)}) as `uses`"
        expect(resource in resources, expected, repr(resource))
    for name in action.after:
        expect(name in actions, "actions of the domain as `after`", repr(name))
    return replace(action, to_start=start, to_succeed=succeed, gives=gives)


Actions: TypeAlias = Mapping[Name, Annotated[Action, AfterValidator(_checked_action)]]
Keys: TypeAlias = Mapping[
    Name, Annotated[Key, BeforeValidator(_key_fields), AfterValidator(_checked_key)]
]

UNKNOWN: Final = Action("")
"""The declaration assumed for an action that a vocabulary does not declare."""


@dataclass(frozen=True)
class Vocabulary:
    """The actions and keys of one domain.

    Raises:
        DomainError: a name is not valid, an entry is not an Action or Key, or a
            range is empty.
    """

    domain: str  # its name, as in `domain NAME` of a tree file
    actions: Actions
    keys: Keys = field(default_factory=dict)
    resources: tuple[str, ...] = ()  # that actions may use; empty: those that they name

    def __post_init__(self) -> None:
        """Checks names, types and ranges."""
        validated(Name, self.domain, "the domain")
        of_domain = f"of the domain {self.domain}"
        keys = validated(Keys, self.keys, f"the key {{}} {of_domain}")
        object.__setattr__(self, "keys", keys)
        actions = validated(Actions, self.actions, f"the action {{}} {of_domain}", self)
        object.__setattr__(self, "actions", actions)
        words = (word for key in keys.values() for word in key.words)
        if twice := [name for name in (*actions, *words) if name in keys]:
            raise DomainError(
                f"Expected each name once in the domain {self.domain}, found {twice[0]!r} as a key"
                " and as an action or a word; rename one."
            )

    def __hash__(self) -> int:
        """The hash of the names, as mappings have no hash."""
        return hash((self.domain, *self.actions, *self.keys))

    @cached_property
    def key_index(self) -> dict[str, int]:
        """The index of each key on a blackboard."""
        return {name: index for index, name in enumerate(self.keys)}

    @cached_property
    def initial(self) -> dict[int, float]:
        """The initial values of the keys that trees write, by their index on a blackboard."""
        keys = enumerate(self.keys.values())
        return {index: key.start for index, key in keys if key.writable}

    @cached_property
    def always(self) -> tuple[Condition, ...]:
        """Conditions that hold on every blackboard."""
        numbers = {name: key for name, key in self.keys.items() if not key.flag}
        return (
            *(Condition(name, ">=", key.low) for name, key in numbers.items()),
            *(Condition(n, "<=", key.most) for n, key in numbers.items() if key.most is not None),
            *(Condition(name, WHOLE, 0.0) for name, key in numbers.items() if key.whole),
        )

    def comparable(self, name: str) -> list[str]:
        """The other keys that a key can be compared with: numbers, or those of the same words."""
        key = self.keys[name]
        if key.flag:
            return []
        return [n for n, each in self.keys.items() if each.kind == key.kind and n != name]

    def gives(self, name: str, parameter: Parameter) -> bool:
        """True if an argument can have the value of the key of this name."""
        if (key := self.keys.get(name)) is None or parameter.sort == "text":
            return parameter.sort == "text"
        if key.flag or key.words:
            return {*(key.words or NO_YES)} <= {*parameter.words}
        return parameter.sort == "number" or (parameter.sort == "integer" and key.whole)

    def value(self, name: str, number: float) -> float | str | bool:
        """The value of a key as an argument of an action: a number, a word, True or False."""
        key = self.keys[name]
        if key.words:
            return key.words[int(number)]
        return bool(number) if key.flag else int(number) if key.whole else number

    def has_number(self, term: Condition) -> bool:
        """True if a condition compares a key with a number: neither a word nor another key."""
        key = self.keys.get(term.key)
        return term.single and key is not None and not (key.flag or key.words)

    def leaf(self, name: str, values: Mapping[str, Value]) -> Node:
        """A leaf in its canonical form."""
        return leaf_of(name, values, self.action(name).arguments)

    def action(self, name: str) -> Action:
        """The declaration of an action; UNKNOWN if it is not declared."""
        return self.actions.get(name, UNKNOWN)


EMPTY_VOCABULARY: Final = Vocabulary("nothing", {}, {})  # a vocabulary that declares nothing
