"""Subtrees with parameters: what can be passed for a parameter, from the places that have it.

    subtree fetch(key, least, go) = when key > least { sequence { go Grasp } }
    use fetch(charge, 20, MoveTo(goal: bin))

`key` is in the place of a key, `least` of a value that a key is compared with, and `go` of an
action. An argument is built where it is written, so that it does not depend on the names of the
subtree that it is passed to.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import chain, repeat
from typing import Any, Final, TypeAlias

from islandgp.bt.core.kinds import COUNTED, TIMED
from islandgp.bt.core.node import Node
from islandgp.bt.core.scope import Scope, ScopedWord
from islandgp.bt.core.source import Source, shown
from islandgp.bt.core.vocabulary import Vocabulary
from islandgp.errors import TreeError

# lark.Tree and lark.Token: trees mix both, at places determined by the grammar.
_Tree: TypeAlias = Any
_Token: TypeAlias = Any

Fitting: TypeAlias = frozenset[str]
"""The forms of arguments that fit a place: number, key, word, text, node."""

NUMBER: Final[Fitting] = frozenset({"number"})
KEY: Final[Fitting] = frozenset({"key"})
OPERAND: Final[Fitting] = frozenset({"number", "word", "key"})  # on the right of a comparison
VALUE: Final[Fitting] = frozenset({"number", "word", "text"})  # of an action's argument
NODE: Final[Fitting] = frozenset({"node"})
ANYTHING: Final[Fitting] = NUMBER | KEY | VALUE | NODE  # of a parameter that is never used

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

    parameters: Mapping[str, Fitting]  # in order
    body: _Tree
    tree: BuiltSubtree  # with open parameters


def in_words(fitting: Fitting) -> str:
    """The arguments that fit a place: `a number or a key`."""
    *others, last = (words for form, words in _FORMS.items() if form in fitting)
    return f"{', '.join(others)} or {last}" if others else last


def fitting_of(
    parameters: Sequence[_Token], body: _Tree, templates: Mapping[str, Template], source: Source
) -> dict[str, Fitting]:
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


def name_places(tree: _Tree, templates: Mapping[str, Template]) -> Iterator[tuple[_Token, Fitting]]:
    """The names that can be parameters or constants in a parse tree, in order, and what fits."""
    waiting = [tree]
    while waiting:
        part = waiting.pop()
        below: Sequence[Any] = ()
        match str(part.data), part.children:
            case "comparison", [key, _, right]:
                yield from _names((key, KEY), (right, OPERAND))
            case "flag", [key]:
                yield key, KEY
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


def _names(*places: tuple[Any, Fitting]) -> Iterator[tuple[_Token, Fitting]]:
    return (place for place in places if getattr(place[0], "type", "") == "NAME")


def check_form(
    word: ScopedWord, form: str, fitting: Fitting, vocabulary: Vocabulary | None
) -> None:
    """Raises TreeError unless an argument of that form fits."""
    if form not in fitting:
        raise _unfit(word, fitting, vocabulary)


def check_name(
    word: ScopedWord,
    fitting: Fitting,
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
    word: ScopedWord, fitting: Fitting, vocabulary: Vocabulary | None, guess: str = ""
) -> TreeError:
    keys = ", ".join(vocabulary.keys) if vocabulary and fitting == KEY else ""
    return word.error(
        f"{shown(word.token)} does not fit",
        expected=in_words(fitting) + f": {keys}" * bool(keys),
        guess=guess,
    )
