"""Turns what the parser found into Nodes; checks what a grammar can't: names, numbers, sizes."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from textwrap import shorten
from typing import Any, Final, TypeAlias

from islandgp.bt.condition import OPERATORS, Asked, Condition, denied, joined
from islandgp.bt.diagnosis import unknown_key, unknown_node
from islandgp.bt.node import ABORTS, REPEATS, Argument, Node
from islandgp.bt.source import Source, closest, shown
from islandgp.bt.vocabulary import Vocabulary
from islandgp.errors import LimitError, TreeError, UnknownNameError

MAX_LEVELS: Final = 100  # of a tree, a `use` counted expanded
MAX_NODES: Final = 10_000  # of a tree, a `use` counted expanded
MAX_NUMBER: Final = 1_000_000  # largest magnitude of a threshold
MAX_TERMS: Final = 16  # comparisons and flags of a condition
MAX_NESTED: Final = 16  # levels of a condition: each `and`, `or`, `not` and `(` adds one

# lark.Tree and lark.Token: trees mix both, and the grammar says which one is where.
_Tree: TypeAlias = Any
_Token: TypeAlias = Any

_NUMBER = re.compile(r"-?[0-9]+(\.[0-9]+)?")


@dataclass(frozen=True, slots=True)
class _Subtree:
    node: Node
    nodes: int  # expanded
    levels: int  # expanded


class Builder:
    """Builds the tree of one text.

    Sizes are counted while building, with a `use` as large as its subtree, so
    that subtrees which double each other are refused before they are expanded.
    """

    def __init__(self, source: Source, vocabulary: Vocabulary | None) -> None:
        """Without a vocabulary every name is an action, and every key a flag or a number."""
        self._source = source
        self._vocabulary = vocabulary
        self._subtrees: dict[str, _Subtree] = {}
        self._later: set[str] = set()  # subtrees whose definition is not finished
        self.nodes = 0  # of the tree that is being built, so far
        self.levels = 0
        self._name = ""  # of the subtree that is being built
        self._terms = 0  # of the condition that is being built

    def build(self, definitions: Sequence[_Tree], root: _Tree) -> Node:
        """The Node of `root`; raises TreeError for whatever is wrong in the text."""
        self._later = {str(definition.children[0]) for definition in definitions}
        for definition in definitions:
            self._define(*definition.children)
        return self._whole(root)

    def condition(self, tree: _Tree) -> Asked:
        """A condition alone."""
        self._terms = 0
        return self._asked(tree, 1)

    def _define(self, name: _Token, body: _Tree) -> None:
        if name in self._subtrees:
            raise self._source.error_at(
                name, f"subtree {shown(name)} is defined twice", expected="a new name"
            )
        node = self._whole(body, name)
        self._subtrees[str(name)] = _Subtree(node, self.nodes, self.levels)
        self._later.discard(str(name))

    def _whole(self, tree: _Tree, name: str = "") -> Node:
        self.nodes = self.levels = 0
        self._name = name
        return self._node(tree, 1)

    def _node(self, tree: _Tree, level: int) -> Node:
        kind, parts = str(tree.data), tree.children
        if kind == "use":
            return self._use(parts[0], level)
        self._count(parts[0], nodes=1, deepest=level)
        if kind == "action":
            words = self._vocabulary
            if words is not None and parts[0] not in words.actions:
                raise unknown_node(self._source, parts[0], self._subtrees, words)
            return Node("action", (str(parts[0]),))
        args: tuple[Argument, ...] = ()
        first = 1  # of the parts that are children
        if kind == "when":
            args, first = self._condition(parts)
        elif kind == "parallel":
            args, first = _policies(parts)
        elif kind == "repeater":
            args, first = (self._repeats(parts[1]),), 2
        return Node(kind, args, tuple([self._node(part, level + 1) for part in parts[first:]]))

    def _use(self, name: _Token, level: int) -> Node:
        subtree = self._subtrees.get(name)
        if subtree is None:
            raise self._unknown_subtree(name)
        self._count(name, nodes=subtree.nodes, deepest=level + subtree.levels - 1)
        return subtree.node

    def _count(self, token: _Token, *, nodes: int, deepest: int) -> None:
        self.nodes += nodes
        self.levels = max(self.levels, deepest)
        if self.levels > MAX_LEVELS or self.nodes > MAX_NODES:
            raise self._source.error_at(
                token,
                "the tree is too deep" if self.levels > MAX_LEVELS else "the tree is too large",
                expected=f"at most {MAX_LEVELS} levels and {MAX_NODES} nodes, each use expanded",
                kind=LimitError,
            )

    def _condition(self, parts: Sequence[_Tree]) -> tuple[tuple[Argument, ...], int]:
        asked = self.condition(parts[1])
        if parts[2].data == "abort":
            return (asked, str(parts[2].children[0])), 3
        return (asked, ABORTS[-1]), 2

    def _asked(self, tree: _Tree, level: int) -> Asked:
        form, parts = str(tree.data), tree.children
        if form in ("comparison", "flag"):
            self._terms += 1
            self._bounded(parts[0], level)
            if self._vocabulary is not None:
                self._check_key(parts[0], compared=form == "comparison", words=self._vocabulary)
            if form == "flag":
                return Condition(str(parts[0]), "is", 0.0)
            return Condition(str(parts[0]), str(parts[1]), self._number(parts[2]))
        self._bounded(_first_word(tree), level)
        inside = [self._asked(part, level + 1) for part in parts]
        if form == "negation":
            return denied(inside[0])
        if form == "brackets":
            return inside[0]
        return joined("and" if form == "conjunction" else "or", inside)

    def _bounded(self, at: _Token, level: int) -> None:
        if self._terms > MAX_TERMS or level > MAX_NESTED:
            raise self._source.error_at(
                at,
                "the condition is too long" if level <= MAX_NESTED else "the condition is too deep",
                expected=f"at most {MAX_TERMS} comparisons and flags, {MAX_NESTED} levels",
                kind=LimitError,
            )

    def _check_key(self, name: _Token, *, compared: bool, words: Vocabulary) -> None:
        key = words.keys.get(name)
        if key is None:
            raise unknown_key(self._source, name, words)
        if key.flag == compared:
            raise self._wrong_condition(name, flag=key.flag)

    def _wrong_condition(self, key: _Token, *, flag: bool) -> TreeError:
        if flag:
            return self._source.error_at(
                key,
                f"{key} is yes or no, it can't be compared with a number",
                expected=f"`when {key}` or `when not {key}`",
            )
        return self._source.error_at(
            key,
            f"{key} is a number, it must be compared with one",
            expected=f"`when {key} < 5`, with one of {' '.join(OPERATORS)}",
        )

    def _number(self, token: _Token) -> float:
        if not _NUMBER.fullmatch(token):
            raise self._source.error_at(
                token,
                f"{shown(token)} is not a plain number",
                expected="digits, with a decimal point if need be, such as 25, 12.5 or -3",
            )
        value = float(token) + 0.0  # turns -0.0 into 0.0
        if abs(value) > MAX_NUMBER:
            raise self._source.error_at(
                token,
                f"{shown(token)} is out of range",
                expected=f"a number from {-MAX_NUMBER} to {MAX_NUMBER}",
            )
        return value

    def _repeats(self, token: _Token) -> int:
        fewest, most = REPEATS
        count = int(token) if token.isdecimal() and len(token) < 10 else 0
        if not fewest <= count <= most:
            raise self._source.error_at(
                token,
                f"a repeater can't repeat {shown(token)} times",
                expected=f"a whole number from {fewest} to {most}",
            )
        return count

    def _unknown_subtree(self, name: _Token) -> TreeError:
        known = shorten(", ".join(self._subtrees), 200, placeholder=" ...")
        if name == self._name:
            message = f"subtree {shown(name)} uses itself"
        elif name in self._later:
            message = f"subtree {shown(name)} is defined further down"
        else:
            message = f"unknown subtree {shown(name)}"
        guess = closest(name, self._subtrees)
        if not guess and self._vocabulary is not None and name in self._vocabulary.actions:
            guess = f"{name}, without use"
        return self._source.error_at(
            name,
            message,
            expected=f"a subtree that is defined above: {known or 'none is defined so far'}",
            guess=guess,
            kind=UnknownNameError,
        )


def _first_word(tree: _Tree) -> _Token:
    while hasattr(tree, "children"):
        tree = tree.children[0]
    return tree


def _policies(parts: Sequence[_Tree]) -> tuple[tuple[str, str], int]:
    """The (success, failure) of a parallel, and where its children begin."""
    success, failure, first = "all", "one", 1
    if parts[first].data == "success":
        success, first = str(parts[first].children[0]), first + 1
    if parts[first].data == "failure":
        failure, first = str(parts[first].children[0]), first + 1
    return (success, failure), first
