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

from pydantic import BeforeValidator, PlainSerializer, PlainValidator, Strict

from islandgp.bt.core.condition import FLAG_OPERATORS, OPERATORS, WHOLE
from islandgp.bt.core.condition import Condition as Condition  # for those who declare actions
from islandgp.bt.core.kinds import NAME as NAME
from islandgp.bt.core.kinds import RESERVED as RESERVED
from islandgp.bt.core.node import FAILURE, RUNNING, STATUS_NAMES, SUCCESS, Node, Value
from islandgp.bt.core.parameters import (
    CHECKED,
    NO_YES,
    Flag,
    Number,
    Parameter,
    check_parameters,
    check_range,
    from_declaration,
    leaf_of,
    validated,
    word_list,
)
from islandgp.bt.core.printer import Named
from islandgp.errors import DomainError

STATUSES: Final = frozenset({FAILURE, SUCCESS, RUNNING})

EQUALITY: Final = ("==", "!=")
"""The operators that compare words."""


def _statuses(declared: Any) -> Any:
    """Statuses from their names."""
    if isinstance(declared, Collection) and not isinstance(declared, str):
        if unknown := [s for s in declared if s not in STATUS_NAMES and s not in STATUSES]:
            raise ValueError(f"expected FAILURE, SUCCESS or RUNNING, found {unknown[0]!r}")
        return [STATUS_NAMES.index(s) if s in STATUS_NAMES else s for s in declared]
    return declared


def _condition(declared: Any) -> Condition:
    """A condition from a list of a key, an operator and a right side: a number, word or key."""
    if isinstance(declared, Condition):
        return declared
    if not isinstance(declared, list | tuple) or len(declared) != 3:
        raise ValueError("expected a key, an operator, and a number, word or key")
    key, operator, right = declared
    if operator not in (*OPERATORS, *FLAG_OPERATORS):
        raise ValueError(f"expected one of {', '.join((*OPERATORS, *FLAG_OPERATORS))}")
    is_word = isinstance(right, str)
    return Condition(key, operator, 0.0 if is_word else float(right), right if is_word else "")


def _key(declared: Any) -> Any:
    """The fields of a `Key` from those in a file; one with a range is a number by default."""
    if not isinstance(declared, dict):
        return declared
    if declared.get("words") or {"words", "flag"} & declared.keys() == {"words"}:
        last = len(word_list(declared["words"], "a key")) - 1
        if last < 0:
            raise ValueError("expected at least one word, found none")
        return {**declared, "flag": False, "whole": True, "high": last, "most": last}
    fields = {"flag": not declared.keys() & {"low", "high", "step", "most", "whole"}, **declared}
    if isinstance(fields.get("initial"), bool):
        fields["initial"] = NO_YES[fields["initial"]]
    return fields


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
    arguments: Mapping[str, Annotated[Parameter, BeforeValidator(from_declaration)]] = field(
        default_factory=dict
    )
    """By name, in the order in which trees are written."""
    condition: Flag = False  # never RUNNING and without effect; see `condition_leaf`
    sets: tuple[str, ...] = ()
    """Keys that its end can write, before the rest of the tree is ticked."""
    uses: tuple[str, ...] = ()
    """Resources that it holds until it ends, such as the base of a robot. Two actions that share
    one never run in the same tick."""


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
    words: tuple[str, ...] = ()  # its values if it is one of some words; else empty
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
    def operators(self) -> tuple[str, ...]:
        """The operators of its comparisons: words have no order, and flags no comparison."""
        return () if self.flag else EQUALITY if self.words else OPERATORS

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


def integer(
    meaning: str,
    low: int,
    high: int,
    step: int = 1,
    *,
    most: int | None = None,
    noise: float = 0.0,
    initial: int | None = None,
) -> Key:
    """A key that is a whole number, with noise too; otherwise as `number`."""
    return Key(meaning, False, low, high, step, most, noise, whole=True, initial=initial)


def enumeration(meaning: str, words: Collection[str], *, initial: str | None = None) -> Key:
    """A key whose value is one of some words, such as the mode of a robot.

    Its value on a blackboard is the index of the word. With `initial`, its first word, trees can
    write it.
    """
    if not (listed := word_list(words, meaning)):
        raise DomainError(f"Expected at least one word for the key {meaning!r}, found none.")
    last = len(listed) - 1
    return Key(meaning, flag=False, high=last, most=last, whole=True, words=listed, initial=initial)


def is_name(word: str) -> bool:
    """True if a word is a valid name of an action or a key."""
    return isinstance(word, str) and NAME.fullmatch(word) is not None and word not in RESERVED


def _check_action(action: Action, where: str, keys: Mapping[str, Key]) -> None:
    """Raises DomainError for invalid statuses, conditions or changes."""
    if not action.statuses or not STATUSES.issuperset(action.statuses):
        raise DomainError(
            f"Expected statuses among FAILURE, SUCCESS and RUNNING for {where}, found"
            f" {action.statuses!r}."
        )
    if action.condition and (RUNNING in action.statuses or action.changes):
        raise DomainError(
            f"Expected neither RUNNING nor changes of {where}, which is a condition; use"
            " condition_leaf(...), or leave out `condition`."
        )
    if wrong_name := [name for name in action.uses if not is_name(name)]:
        raise DomainError(
            f"Expected names of letters, digits and _ as uses of {where}, found {wrong_name[0]!r}."
        )
    terms = (*action.to_start, *action.to_succeed, *action.gives)
    for key in (*(key for term in terms for key in term.keys), *action.changes):
        if key not in keys:
            raise DomainError(
                f"Expected keys of the vocabulary in the conditions and changes of {where}, found"
                f" {key!r}."
            )
    for term in terms:
        if term.operator not in (operators := keys[term.key].operators or FLAG_OPERATORS):
            raise DomainError(
                f"Expected one of {', '.join(operators)} with {term.key} in the conditions of"
                f" {where}, found {term.operator!r}."
            )
    if unwritable := [key for key in action.sets if key not in keys or not keys[key].writable]:
        raise DomainError(
            f"Expected keys with an initial value as sets of {where}, found {unwritable[0]!r}."
        )
    if wrong := [change for change in action.changes.values() if change not in (-1, 1)]:
        raise DomainError(f"Expected -1 or 1 as the changes of {where}, found {wrong[0]!r}.")


def _check_range(key: Key, where: str) -> None:
    """Raises DomainError for a number whose range is empty or too large."""
    whole = (key.low, key.high, key.step, key.most or 0) if key.whole else ()
    check_range(key, where, whole, above_0=False)
    if key.most is not None and key.most <= key.low:
        raise DomainError(f"Expected most above low for {where}, found {key.most:g}, {key.low:g}.")
    if key.noise < 0:
        raise DomainError(f"Expected noise of at least 0 for {where}, found {key.noise:g}.")


def _check_initial(key: Key, where: str) -> None:
    """Raises DomainError for an initial value that a key cannot have."""
    words = NO_YES if key.flag else key.words
    value, most = key.initial, inf if key.most is None else key.most
    if value is None or (words and value in words):
        return
    if words or isinstance(value, str) or not key.low <= value <= most or (key.whole and value % 1):
        expected = " | ".join(words) or f"a number from {key.low:g} to {most:g}"
        raise DomainError(f"Expected {expected} as initial of {where}, found {value!r}.")


def _check_words(key: Key, where: str, keys: Mapping[str, Key]) -> None:
    """Raises DomainError for an invalid declaration of a flag or an enumeration."""
    if key.noise or (key.flag and (key.words or key.whole)):
        raise DomainError(
            f"Expected noise and whole of numbers only, and words of an enumeration, for {where};"
            " use flag(...), enumeration(...) or number(...)."
        )
    for word in key.words:
        if not is_name(word) or word in keys:
            raise DomainError(
                f"Expected words of letters, digits and _ for {where} that are neither keys nor"
                f" keywords of the language, found {word!r}; rename it."
            )
    if len(set(key.words)) < len(key.words):
        raise DomainError(f"Expected different words for {where}, found {[*key.words]}.")


def _with_words(action: Action, keys: Mapping[str, Key]) -> Action:
    """The action with the numbers of words in its conditions."""

    def numbered(term: Condition) -> Condition:
        key = keys.get(term.key)
        if key is None or term.other not in key.words:
            return term
        return Condition(term.key, term.operator, key.number_of(term.other))

    declared = (action.to_start, action.to_succeed, action.gives)
    start, succeed, gives = (tuple(map(numbered, each)) for each in declared)
    return replace(action, to_start=start, to_succeed=succeed, gives=gives)


Actions: TypeAlias = Mapping[str, Action]
Keys: TypeAlias = Mapping[str, Annotated[Key, BeforeValidator(_key)]]

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
        for name in (self.domain, *self.actions, *self.keys):
            if not is_name(name):
                raise DomainError(
                    "Expected a name of letters, digits and _ that is not a keyword of the"
                    f" language, found {name!r} in the domain {self.domain!r}; rename it."
                )
        of_domain = f"of the domain {self.domain}"
        keys = validated(Keys, self.keys, f"the key {{}} {of_domain}")
        actions = validated(Actions, self.actions, f"the action {{}} {of_domain}")
        actions = {name: _with_words(action, keys) for name, action in actions.items()}
        object.__setattr__(self, "keys", keys)
        object.__setattr__(self, "actions", actions)
        if twice := self.actions.keys() & self.keys.keys():
            raise DomainError(
                f"Expected each name once in the domain {self.domain}, found {min(twice)!r} as an"
                " action and as a key; rename one."
            )
        for name, action in self.actions.items():
            where = f"the action {name} of the domain {self.domain}"
            _check_action(action, where, self.keys)
            check_parameters(action.arguments, where)
            if self.resources and (unknown := [u for u in action.uses if u not in self.resources]):
                raise DomainError(
                    f"Expected resources of the vocabulary ({', '.join(self.resources)}) as uses of"
                    f" {where}, found {unknown[0]!r}."
                )
            for before in action.after:
                if before not in self.actions or before == name:
                    raise DomainError(
                        f"Expected other actions of the domain {self.domain} as `after` of the"
                        f" action {name}, found {before!r}."
                    )
        for name, key in self.keys.items():
            where = f"the key {name} of the domain {self.domain}"
            _check_initial(key, where)
            if key.words or key.flag:
                _check_words(key, where, self.keys)
            else:
                _check_range(key, where)

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
        return bool(number) if key.flag else key.words[int(number)] if key.words else number

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


EMPTY_VOCABULARY: Final = Vocabulary("nothing", {}, {})
"""A vocabulary that declares nothing."""
