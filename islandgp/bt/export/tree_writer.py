"""Writes trees for other libraries.

A node becomes the library's own where that means the same, and otherwise one of `nodes/`. A
selector or sequence that observes guards becomes an interruptible one, and its guards `When` nodes.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Final

from islandgp.bt.analysis.context import has_interrupting_guard
from islandgp.bt.analysis.names import fresh_name
from islandgp.bt.core.kind import Target
from islandgp.bt.core.kinds import kind_of
from islandgp.bt.core.node import AlwaysArgs, Node, marks_of
from islandgp.bt.core.vocabulary import Vocabulary
from islandgp.errors import DomainError

HEADER: Final = "islandgp_nodes.hpp"  # the name of the C++ header with our nodes


class TreeWriter(ABC):
    """Writes the nodes of a tree, and collects its named subtrees."""

    def __init__(self, vocabulary: Vocabulary, reserved: Iterable[str]) -> None:
        """`reserved`: names that no subtree can have."""
        self.vocabulary = vocabulary
        self.subtrees: dict[str, list[str]] = {}  # lines by name, each before its users
        self._names: dict[tuple[str, tuple[str, ...]], str] = {}
        self._taken = set(reserved)

    def node(self, node: Node, *, observed: bool = False) -> list[str]:
        """The lines of a node.

        A subtree that differs between its uses, by its numbers or because its guards are observed
        in one of them, becomes several: `recharge_20`, `recharge_30`.

        Args:
            node: with the names of subtrees and comments.
            observed: a composite above observes guards here, through decorators.
        """
        *uses, own = marks_of(node)
        lines = [*self.comments(own.comments.lines), *self.element(_expanded(node), observed)]
        for mark in reversed(uses):
            key = mark.name, tuple(lines)
            if key not in self._names:
                self._names[key] = fresh_name(mark.name, self._taken)
                self._taken.add(self._names[key])
                self.subtrees[self._names[key]] = lines
            lines = [*self.comments(mark.comments.lines), *self.use(self._names[key], lines)]
        return lines

    def children(self, node: Node, observed: bool) -> list[list[str]]:
        """The lines of a node's children."""
        observes = [observed and kind_of(node).decorates] * len(node.children)
        if kind_of(node).remembers_branch:
            observes = [*map(has_interrupting_guard, node.children[:-1]), False]
        pairs = zip(node.children, observes, strict=True)
        return [self.node(child, observed=each) for child, each in pairs]

    def target(self, node: Node, observed: bool) -> Target | None:
        """The node of the library, or ours; None for a `when` whose meaning the library has.

        Raises:
            DomainError: there is neither for the kind.
        """
        kind = kind_of(node)
        if kind.remembers_branch:
            is_ours = any(map(has_interrupting_guard, node.children[:-1]))
        elif node.guard:
            is_ours = observed or has_interrupting_guard(node) or self.differs(node)
        else:
            is_ours = kind.stock is None or self.differs(node)
        target = kind.ours if is_ours else kind.stock
        if not node.guard and not (target and self.has(target)):
            raise DomainError(
                f"Expected a tree without {node.kind}, for which the library has no node; use"
                f" {kind.instead or 'other nodes'}, or run it in Python (load_tree) or by a plug-in"
                " such as that of ROS."
            )
        return target

    @abstractmethod
    def has(self, target: Target) -> bool:
        """True if the library, or our nodes for it, have the node."""

    @abstractmethod
    def differs(self, node: Node) -> bool:
        """True if the library's node for a parallel, a repetition, a time or a `when` differs."""

    @abstractmethod
    def element(self, node: Node, observed: bool) -> list[str]:
        """The lines of a node without comments and the names of subtrees."""

    @abstractmethod
    def use(self, name: str, lines: list[str]) -> list[str]:
        """The lines of the use of a subtree, whose own lines are given."""

    def comments(self, texts: Sequence[str]) -> list[str]:  # noqa: ARG002
        """The lines of comments; by default none."""
        return []


def _expanded(node: Node) -> Node:
    """A node as other libraries have it: repeated without end is what has not failed."""
    match node:
        case Node("until_success", _, children):
            inverted = Node("until_failure", (), (Node("inverter", (), children),))
            return Node("inverter", (), (inverted,))
        case Node("always", AlwaysArgs("running")):
            return Node("until_failure", (), (Node("always", AlwaysArgs("success")),))
    return node


def own_nodes(name: str) -> str:
    """The text of a file in `nodes`."""
    return (Path(__file__).parent / "nodes" / name).read_text(encoding="utf-8")
