"""SubTrees of BehaviorTree.CPP files: their expansion, blackboards and sizes."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Collection, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final, NamedTuple, NoReturn

from islandgp.bt.core.language import MAX_LEVELS, MAX_NODES
from islandgp.bt.core.node import Node, as_subtree, commented
from islandgp.bt.core.source import shown
from islandgp.bt.core.vocabulary import NAME, RESERVED, Vocabulary
from islandgp.bt.export.behaviortree_cpp import HEADER, NOTES, REST
from islandgp.bt.export.branching import PRECONDITIONS
from islandgp.bt.export.plan import SemanticDifference, fresh_name
from islandgp.bt.export.xml_reader import Element
from islandgp.bt.export.xml_trees import trees_of
from islandgp.errors import LimitError

_EXPLICIT: Final = ("Action", "Condition", "Control", "Decorator")  # <Action ID="X"/> is <X/>
_RENAMED: Final = {
    "SubTreePlus": "SubTree",
    "RetryUntilSuccesful": "RetryUntilSuccessful",
    "SequenceStar": "SequenceWithMemory",
}
"""Tags of version 3, with those of version 4."""

SCOPE = SemanticDifference(
    "scope",
    'a SubTree without _autoremap="true" has its own blackboard, in which the keys of its'
    " conditions are not set; islandgp has one blackboard",
)


class Difference(NamedTuple):
    """A loss with its first place in the file."""

    line: int
    column: int
    loss: SemanticDifference


@dataclass(slots=True)
class TreeState:
    """What is known about a tree that is being read."""

    nodes: int = 0  # so far
    levels: int = 0  # so far
    level: int = 0  # of the present node
    asks: bool = False  # True: it reads the blackboard
    parents: list[str] = field(default_factory=list)  # tags of the nodes around


class SubtreeReader(ABC):
    """Reads each tree of a file once, however often it is used.

    Sizes are counted with a SubTree as large as its tree, so trees that double each other are
    rejected before they are expanded.
    """

    def __init__(
        self, name: str, root: Element, vocabulary: Vocabulary, folder: Path | None
    ) -> None:
        self._name = name
        self.keys: dict[str, str] = {}  # of the tree that is being read, with the blackboard's
        self.vocabulary = vocabulary
        self.root = root
        self._trees = trees_of(root, name, folder)
        self._read: dict[tuple[str, frozenset[tuple[str, str]]], tuple[Node, TreeState]] = {}
        self._names = {*RESERVED, *vocabulary.actions}  # of subtrees, and reserved ones
        self._open: list[str] = []  # trees that are being read
        self.state = TreeState()  # of the tree that is being read
        self.differences: dict[SemanticDifference, Difference] = {}

    def tree(self, identity: str | None) -> Node:
        """The tree of that ID; None: the main tree."""
        if identity is not None:
            return self._subtree(identity, self.root)[0]
        main_tree = self.root.attributes.get("main_tree_to_execute", "")
        if not main_tree and len(self._trees) > 1:
            self.fail(
                self.root,
                "expected main_tree_to_execute, as there are several trees:"
                f" {_listed(self._trees)}; add it, or choose one by --tree ID",
            )
        return self._subtree(main_tree or next(iter(self._trees)), self.root)[0]

    def _subtree(self, identity: str, user: Element) -> tuple[Node, TreeState]:
        key = identity, frozenset(self.keys.items())
        if key in self._read:
            return self._read[key]
        if identity not in self._trees:
            self.fail(
                user,
                f"there is no <BehaviorTree ID={shown(identity)}>; there are"
                f" {_listed(self._trees)}",
            )
        if identity in self._open:
            self.fail(user, f"the tree {shown(identity)} contains itself")
        if len(self._open) >= MAX_LEVELS:
            self.fail(user, f"expected at most {MAX_LEVELS} nested SubTrees")
        tree, file = self._trees[identity]
        name, self._name = self._name, file
        if len(tree.children) != 1:
            self.fail(tree, f"expected one node in a <BehaviorTree>, found {len(tree.children)}")
        self._open.append(identity)
        outside, self.state = self.state, TreeState()
        node = commented(self.node(tree.children[0]), notes_of(tree))
        self._open.pop()
        self._name = name
        if self._open:  # it is used, not the tree that is asked for
            new_name = fresh_name(identity, self._names)
            self._names.add(new_name)
            node = as_subtree(node, new_name)
        self._read[key] = node, self.state
        self.state = outside
        return self._read[key]

    def count(self, element: Element, nodes: int, levels: int) -> None:
        """Counts nodes below the present level. Raises LimitError if there are too many."""
        state = self.state
        state.nodes += nodes
        state.levels = max(state.levels, state.level + levels)
        if state.nodes > MAX_NODES or state.levels > MAX_LEVELS:
            limits = f"{MAX_LEVELS} levels and {MAX_NODES} nodes, each SubTree expanded"
            raise element.error(f"expected a tree of at most {limits}", self._name, LimitError)

    def node(self, element: Element) -> Node:
        tag = tag_of(element)
        if conditions := [name for name in PRECONDITIONS if name in element.attributes]:
            return self.preconditions(element, conditions)
        if tag == "SubTree":
            return commented(self._use(element), notes_of(element))
        self.count(element, 1, 1)
        self.state.level += 1
        self.state.parents.append(tag)
        try:
            node = self.inside(element, tag)
        except ValueError as error:  # of an attribute
            self.fail(element, str(error))
        self.state.parents.pop()
        self.state.level -= 1
        return commented(node, notes_of(element))

    def _use(self, element: Element) -> Node:
        remapped = {
            key: self.keys.get(value[1:-1], value[1:-1])
            for key, value in element.attributes.items()
            if NAME.fullmatch(key) and value[:1] + value[-1:] == "{}"
        }
        self.check_attributes(element, "SubTree")
        outside, self.keys = self.keys, {**self.keys, **remapped}
        node, subtree = self._subtree(element.attributes.get("ID", ""), element)
        self.keys = outside
        self.count(element, subtree.nodes, subtree.levels)
        self.state.asks |= subtree.asks
        if subtree.asks and not remapped and _autoremap(element) not in ("true", "1"):
            self.differs(element, SCOPE)
        return node

    def nodes_of(self, element: Element) -> tuple[Node, ...]:
        return tuple(map(self.node, self.children(element)))

    def children(self, element: Element) -> list[Element]:
        if not element.children:
            self.fail(element, f"expected children in <{element.tag}>")
        return element.children

    def child(self, element: Element) -> Node:
        if len(element.children) != 1:
            self.fail(
                element, f"expected one child in <{element.tag}>, found {len(element.children)}"
            )
        return self.node(element.children[0])

    @abstractmethod
    def inside(self, element: Element, tag: str) -> Node:
        """A node that is not a SubTree. Raises ValueError for an invalid attribute."""

    @abstractmethod
    def preconditions(self, element: Element, names: Sequence[str]) -> Node:
        """A node with the conditions of these attributes, which are checked before it starts."""

    @abstractmethod
    def check_attributes(self, element: Element, tag: str) -> None:
        """Raises TreeError for an attribute without an equivalent in the language."""

    def differs(self, element: Element, loss: SemanticDifference) -> None:
        self.differences.setdefault(loss, Difference(element.line, element.column, loss))

    def fail(self, element: Element, message: str) -> NoReturn:
        raise element.error(message, self._name)


def _listed(names: Collection[str]) -> str:
    """The first names of many."""
    first = [shown(name) for name in list(names)[:10]]
    return ", ".join(first) + (", ..." if len(names) > 10 else "")


def notes_of(element: Element) -> list[str]:
    """The comments above an element, and its attributes without a meaning, as comments."""
    lines = [line.strip() for comment in element.comments for line in comment.splitlines()]
    values = {name: " ".join(element.attributes.get(name, "").split()) for name in NOTES}
    if values["name"] in (tag_of(element), element.attributes.get("ID"), REST):
        del values["name"]
    comments = [line for line in lines if line and not line.startswith(f"Needs {HEADER}")]
    return [*comments, *(f"{name}: {value}" for name, value in values.items() if value)]


def tag_of(element: Element) -> str:
    """The node's tag in the compact form of version 4: <Action ID="X"/> is X."""
    if element.tag in _EXPLICIT:
        return element.attributes.get("ID", element.tag)
    return _RENAMED.get(element.tag, element.tag)


def _autoremap(element: Element) -> str:
    names = ("_autoremap", "__autoremap", "__shared_blackboard")
    return next((element.attributes[n] for n in names if n in element.attributes), "")
