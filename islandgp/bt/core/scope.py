"""Resolves the words of a tree's text: numbers, constants, subtrees and their parameters.

    subtree fetch(key, least, go) = when key > least { sequence { go Grasp } }
    use fetch(charge, 20, MoveTo(goal: bin))

`key` is in the place of a key, `least` of a value that a key is compared with, and `go` of an
action. An argument is built where it is written, so that it does not depend on the names of the
subtree that it is passed to.
"""

from __future__ import annotations

import re
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import chain, repeat
from textwrap import shorten
from typing import Any, Final, TypeAlias

from islandgp.bt.core.kind import Argument
from islandgp.bt.core.kinds import COUNTED, TIMED
from islandgp.bt.core.node import Node
from islandgp.bt.core.printer import Named
from islandgp.bt.core.source import Source, closest, shown
from islandgp.bt.core.vocabulary import Vocabulary
from islandgp.errors import TreeError, UnknownNameError

# lark.Tree and lark.Token: trees mix both, at places determined by the grammar.
_Tree: TypeAlias = Any
_Token: TypeAlias = Any

MAX_NUMBER: Final = 1_000_000  # largest magnitude of a threshold

_NUMBER: Final = re.compile(r"-?[0-9]+(\.[0-9]+)?")


@dataclass(frozen=True, slots=True)
class ScopedWord:
    """A word with its meaning in its place; in place of a parameter, the argument passed for it."""

    token: _Token  # an argument has the place of its `use`
    source: Source
    number: float | None = None  # of a constant, or of an argument that is a number
    parameter: str = ""  # that it is passed for: `level of recharge`; "": it is no argument
    open: bool = False  # a parameter of the subtree that is being defined; any argument fits
    part: Any = None  # of an action or a subtree that is passed: the BuiltSubtree

    @property
    def text(self) -> str:
        """The word as it is written, a text without its quotes."""
        return str(self.token).strip('"')

    def error(
        self,
        message: str,
        *,
        expected: str = "",
        guess: str = "",
        kind: type[TreeError] = TreeError,
    ) -> TreeError:
        """The error for the word; that of an argument names the parameter."""
        if self.parameter:
            message = f"{message} (parameter {self.parameter})"
        return self.source.error_at(self.token, message, expected=expected, guess=guess, kind=kind)


@dataclass(frozen=True, slots=True)
class Scope:
    """The names that are defined at a place of a text."""

    source: Source
    constants: dict[str, float] = field(default_factory=dict)  # that are defined so far
    values: dict[str, ScopedWord] = field(default_factory=dict)  # of the subtree's parameters
    named: bool = False  # True: the numbers of constants and parameters are `Named`

    def word(self, token: _Token) -> ScopedWord:
        """The word of a token."""
        if token.type != "NAME":
            return ScopedWord(token, self.source)
        if token in self.values:
            return self.values[token]
        return ScopedWord(token, self.source, self.constants.get(token))

    def has_name(self, name: str) -> bool:
        """True if a constant or a parameter has this name."""
        return name in self.values or name in self.constants

    def number(self, token: _Token) -> float:
        """A number, or the value of the constant or parameter of that name."""
        word = self.word(token)
        value = word.number
        if value is None:
            value = self._written_number(word)
        return Named(str(token), value) if self.named and token.type == "NAME" else value

    def _written_number(self, word: ScopedWord) -> float:
        if word.token.type == "NAME":
            raise self.unknown_number(word)
        if not _NUMBER.fullmatch(word.token):
            raise word.error(
                f"{shown(word.token)} is not a plain number",
                expected="digits with an optional decimal point and no unit: 25, 12.5 or -3",
            )
        value = float(word.token) + 0.0  # turns -0.0 into 0.0
        if abs(value) > MAX_NUMBER:
            raise word.error(
                f"{shown(word.token)} is out of range",
                expected=f"a number from {-MAX_NUMBER} to {MAX_NUMBER}",
            )
        return value

    def seconds(self, kind: str, argument: Argument, token: _Token) -> float:
        """A duration of a node of that kind, in seconds within the argument's range."""
        low, high = argument.range
        seconds = self.number(token)
        if not low <= seconds <= high:
            word = self.word(token)
            raise word.error(
                f"a {kind} can't last {shown(word.token)} seconds",
                expected=f"seconds from {low:g} to {high:,}",
            )
        return seconds

    def count_of(self, argument: Argument, token: _Token, message: str) -> float:
        """A whole number within the argument's range; `message` names another one as `{}`."""
        low, high = argument.range
        count = 0.0
        if token.type == "NAME":
            count = self.number(token)
        elif token.isdecimal() and len(token) < 10:
            count = int(token)
        if count != int(count) or not low <= count <= high:
            word = self.word(token)
            raise word.error(
                message.format(shown(word.token)), expected=f"a whole number from {low} to {high:,}"
            )
        return count if isinstance(count, Named) else int(count)

    def unknown_number(self, word: ScopedWord, keys: Sequence[str] = ()) -> TreeError:
        """The error of an unknown name; `keys`: the keys that could be in its place."""
        names = self.constants if word.parameter else {**self.values, **self.constants}
        listing = shorten(", ".join(names), 200, placeholder=" ...")
        others = f" or a key ({', '.join(keys)})" if keys else ""
        return word.error(
            f"unknown constant {'or key ' * bool(keys)}{shown(word.token)}",
            expected=f"a number{',' if keys else ' or'} a constant that is defined above"
            f" ({listing or 'none so far'}){others}",
            guess=closest(word.token, [*names, *keys]),
            kind=UnknownNameError,
        )


ParameterType: TypeAlias = frozenset[str]
"""The forms of arguments that fit a place: number, key, word, text, node."""

NUMBER: Final[ParameterType] = frozenset({"number"})
KEY: Final[ParameterType] = frozenset({"key"})
TERM: Final[ParameterType] = NUMBER | KEY  # of a sum
OPERAND: Final[ParameterType] = frozenset({"number", "word", "key"})  # on the right of a comparison
VALUE: Final[ParameterType] = frozenset({"number", "word", "text"})  # of an action's argument
NODE: Final[ParameterType] = frozenset({"node"})
ANYTHING: Final[ParameterType] = NUMBER | KEY | VALUE | NODE  # of a parameter that is never used

_FORMS: Final = {
    "number": "a number",
    "key": "a key",
    "word": "a word",
    "text": "a text in quotes",
    "node": "an action or a `use`",
}


@dataclass(frozen=True, slots=True)
class BuiltSubtree:
    """A subtree that has been built with its arguments."""

    node: Node
    nodes: int  # expanded
    levels: int  # expanded
    places: list[Any]  # of its nodes, in document order: a word, or (a subtree, its use)
    source: Source


@dataclass(frozen=True, slots=True)
class Template:
    """The definition of a subtree. One with parameters is built for each set of arguments."""

    parameters: Mapping[str, ParameterType]  # in order
    body: _Tree
    tree: BuiltSubtree  # with open parameters


def in_words(fitting: ParameterType) -> str:
    """The arguments that fit a place: `a number or a key`."""
    *others, last = (words for form, words in _FORMS.items() if form in fitting)
    return f"{', '.join(others)} or {last}" if others else last


def parameter_types(
    parameters: Sequence[_Token], body: _Tree, templates: Mapping[str, Template], source: Source
) -> dict[str, ParameterType]:
    """What fits each parameter of a subtree: what fits all places that have it.

    Raises:
        TreeError: nothing fits all places of a parameter.
    """
    fittings = {str(parameter): ANYTHING for parameter in parameters}
    for token, fitting in name_places(body, templates):
        if token not in fittings:
            continue
        common = fittings[token] & fitting
        if not common:
            raise source.error_at(
                token,
                f"parameter {shown(token)} is {in_words(fitting)} here, and"
                f" {in_words(fittings[token])} in an earlier place",
                expected="a separate parameter for each",
            )
        fittings[str(token)] = common
    return fittings


def name_places(
    tree: _Tree, templates: Mapping[str, Template]
) -> Iterator[tuple[_Token, ParameterType]]:
    """The names that can be parameters or constants in a parse tree, in order, and what fits."""
    waiting = [tree]
    while waiting:
        part = waiting.pop()
        below: Sequence[Any] = ()
        match str(part.data), part.children:
            case "comparison", [key, _, right] if not hasattr(right, "children"):
                yield from _names((key, KEY), (right, OPERAND))
                below = [key]
            case "assignment", [key, right] if not hasattr(right, "children"):
                yield from _names((key, KEY), (right, OPERAND))
                below = []
            case "comparison" | "flag" | "assignment", [*below]:
                yield from _names((below[0], KEY), *((each, TERM) for each in below[1:]))
            case "sum" | "product" | "negative", [*below]:
                yield from _names(*((each, TERM) for each in below))
            case "action", [name]:
                yield name, NODE
            case "action", [_, values]:
                yield from _names(*((each.children[1], VALUE) for each in values.children))
            case "use", [name, *arguments]:
                template = templates.get(str(name))
                fitting = chain(template.parameters.values() if template else (), repeat(ANYTHING))
                passed = [each for part in arguments for each in part.children]
                yield from _names(*zip(passed, fitting, strict=False))
                below = passed
            case "constant", [_, number]:
                yield from _names((number, NUMBER))
            case "success" | "failure", [number]:
                yield from _names((number, NUMBER))
            case kind, [_, number, *below] if kind in COUNTED or kind in TIMED:
                yield from _names((number, NUMBER))
            case _, below:
                pass
        waiting += [each for each in reversed(below) if hasattr(each, "children")]


def _names(*places: tuple[Any, ParameterType]) -> Iterator[tuple[_Token, ParameterType]]:
    return (place for place in places if getattr(place[0], "type", "") == "NAME")


def check_form(
    word: ScopedWord, form: str, fitting: ParameterType, vocabulary: Vocabulary | None
) -> None:
    """Raises TreeError unless an argument of that form fits."""
    if form not in fitting:
        raise _unfit(word, fitting, vocabulary)


def check_name(
    word: ScopedWord,
    fitting: ParameterType,
    scope: Scope,
    vocabulary: Vocabulary | None,
    subtrees: Collection[str],
) -> None:
    """Raises TreeError unless a name that is passed is one of what fits.

    Where a word of a key or an action would fit, the place of the parameter decides.
    """
    name = str(word.token)
    known = {"number": name in scope.constants}
    if vocabulary is not None:
        known |= {"key": name in vocabulary.keys, "node": name in vocabulary.actions}
    (form, *others) = fitting
    if others or known.get(form, True):
        return
    if fitting == NODE and name in subtrees:
        raise _unfit(word, fitting, vocabulary, guess=f"use {name}")
    if any(known.values()):
        raise _unfit(word, fitting, vocabulary)
    if fitting == KEY and vocabulary is not None:
        from islandgp.bt.core.unknown_names import unknown_key  # only for this error

        raise unknown_key(word, vocabulary)
    if fitting == NODE and vocabulary is not None:
        from islandgp.bt.core.unknown_names import unknown_node  # only for this error

        raise unknown_node(word, subtrees, vocabulary)
    raise scope.unknown_number(word)


def _unfit(
    word: ScopedWord, fitting: ParameterType, vocabulary: Vocabulary | None, guess: str = ""
) -> TreeError:
    keys = ", ".join(vocabulary.keys) if vocabulary and fitting == KEY else ""
    return word.error(
        f"{shown(word.token)} does not fit",
        expected=in_words(fitting) + f": {keys}" * bool(keys),
        guess=guess,
    )
