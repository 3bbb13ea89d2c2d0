"""The state of an import from BehaviorTree.CPP: trees, keys, sizes and messages."""

from __future__ import annotations

import re
from collections.abc import Callable, Collection, Mapping
from dataclasses import replace
from itertools import islice
from pathlib import Path
from typing import Final, NoReturn, TypeAlias, TypeVar

from islandgp.bt.analysis.context import without_interrupts
from islandgp.bt.analysis.names import fresh_name
from islandgp.bt.core.builder import MAX_LEVELS, MAX_NODES
from islandgp.bt.core.condition import ConditionExpr, opposite, terms
from islandgp.bt.core.kinds import UNLIMITED
from islandgp.bt.core.language import parse
from islandgp.bt.core.node import (
    ActionArgs,
    AlwaysArgs,
    Args,
    GuardArgs,
    Node,
    SetArgs,
    as_subtree,
    commented,
    guarded,
    keys_in,
    sequence,
    walk,
)
from islandgp.bt.core.parameters import referenced
from islandgp.bt.core.source import closest, shown
from islandgp.bt.core.vocabulary import NAME, RESERVED, Vocabulary
from islandgp.bt.export.scripts import read_assignments, read_condition
from islandgp.bt.export.tree_writer import HEADER
from islandgp.bt.export.xml_reader import Element, XmlTrees
from islandgp.errors import LimitError

T = TypeVar("T")

NOTES: Final = ("name", "_description", "_fullpath", "_uid")
"""Attributes without an effect on the tree; they become comments, `# name: ...`."""
PRECONDITIONS: Final = ("_failureIf", "_successIf", "_skipIf", "_while")
"""Attributes with conditions, in the order in which they are evaluated."""
POSTCONDITIONS: Final = {
    "_onSuccess": "sequence { NODE SET }",
    "_onFailure": "selector { NODE sequence { SET always failure } }",
    "_post": "selector { sequence { NODE SET } sequence { SET always failure } }",
}
"""Attributes that write to the blackboard when a node ends, in this order; see `filled`."""
_SKIP_IN: Final = ("Sequence", "Fallback", "SequenceWithMemory")
"""The parents in which a node can be skipped, also reactive ones."""
_EXPLICIT: Final = ("Action", "Condition", "Control", "Decorator")  # <Action ID="X"/> is <X/>
_RENAMED: Final = {
    "SubTreePlus": "SubTree",
    "RetryUntilSuccesful": "RetryUntilSuccessful",
    "SequenceStar": "SequenceWithMemory",
}
"""Tags of version 3, with those of version 4."""
TRUE: Final = ("true", "1")
_CHILDREN: Final = {(1, 1): "one child", (2, 2): "two children", (2, 3): "two or three children"}
_TOO_LARGE: Final = (
    f"expected a tree of at most {MAX_LEVELS} levels and {MAX_NODES} nodes, each SubTree expanded"
)
_IN_SCRIPT: Final = re.compile(r"'[^']*'|@?(?<![\w.])(?P<name>[A-Za-z_]\w*)")
_PLAIN: Final = re.compile(r"\{@?\w+\}|-?[0-9.]+|true|false")

DIFFERENCES: Final = {
    "clock": "the library measures time by the computer's clock; islandgp counts ticks",
    "repeat": "a repetition can start in the tick in which one ends; in islandgp in the next one",
    "judged": "Parallel ends at the child that decides, and does not tick later ones in that tick",
    "waits": "ParallelAll with max_failures above 1 ends when all children have ended",
    "equal": "== and != treat two numbers that differ by at most 0.00000012 as equal",
    "order": "a branch starts before the other one is halted; islandgp halts first",
    "scope": 'a SubTree without _autoremap="true" has its own blackboard; islandgp has one',
    "skipped": "a skipped node is ignored; in islandgp it ends, and its composite continues",
    "twice": "a condition leaf before two branches is evaluated once; in islandgp for each of them",
    "outside": "this SubTree is in no file of the folder; here it is a leaf, of your program",
    "async": "an AsyncSequence or AsyncFallback starts the next child in the next tick",
    "memory": "SequenceWithMemory continues with the failed child; a sequence with its first",
    "rate": "a RateController starts its child at once after a node above it was reset",
    "round": "RoundRobin ends after its last child in newer releases; round_robin continues",
    "gate": "this decorator watches its child; here it is a leaf before it, of your program",
}
"""The differences in behaviour after an import; docs/exports.md explains each."""


GATES: Final = {
    "DistanceController": "sequence { LEAF CHILD }",
    "GoalUpdatedController": "sequence { LEAF CHILD }",
    "GoalUpdater": "sequence { LEAF CHILD }",
    "SingleTrigger": "sequence { LEAF CHILD }",
    "SpeedController": "sequence { LEAF CHILD }",
    "PathLongerOnApproach": "reactive_selector { inverter { LEAF } CHILD }",
    "ForEach": "recovery 1000000 { inverter { LEAF } CHILD }",
    "ForEachUntilSuccess": (
        "inverter { recovery 1000000 { inverter { LEAF } inverter { CHILD } } }"
    ),
}
"""Decorators of Nav2 and MoveIt Pro that become a leaf and their child; see `filled`.

The leaf of a sequence succeeds when the child is due. That of PathLongerOnApproach is a condition:
if it fails, the decorator succeeds without its child. That of a loop succeeds as long as there is a
next element.
"""

_DIFFERING: Final = {
    **dict.fromkeys(("Delay", "Timeout", "Sleep", "RateController"), "clock"),
    **dict.fromkeys(("AsyncSequence", "AsyncFallback"), "async"),
    "SequenceWithMemory": "memory",
    **dict.fromkeys(GATES, "gate"),
}
"""Tags whose nodes always differ."""


def notes_of(element: Element) -> list[str]:
    """The comments above an element, and its attributes without a meaning, as comments."""
    lines = [line.strip() for comment in element.comments for line in comment.splitlines()]
    values = {name: " ".join(element.attributes.get(name, "").split()) for name in NOTES}
    if values["name"] in (tag_of(element), element.attributes.get("ID")):
        del values["name"]
    comments = [line for line in lines if line and not line.startswith(f"Needs {HEADER}")]
    return [*comments, *(f"{name}: {value}" for name, value in values.items() if value)]


def tag_of(element: Element) -> str:
    """The node's tag in the compact form of version 4: <Action ID="X"/> is X."""
    if element.tag in _EXPLICIT:
        return element.attributes.get("ID", element.tag)
    return _RENAMED.get(element.tag, element.tag)


ALWAYS: Final = {status: Node("always", AlwaysArgs(status)) for status in ("success", "failure")}


def filled(template: str, **nodes: Node) -> Node:
    """The tree of a template, with nodes in the place of its leaves of these names."""

    def visit(node: Node) -> Node:
        return nodes.get(node.action) or node._replace(children=tuple(map(visit, node.children)))

    return visit(parse(template))


def check(test: ConditionExpr) -> Node:
    """A leaf that succeeds if a condition holds, and else fails."""
    return guarded(test, ALWAYS["success"], "none")


def unless(ends: ConditionExpr, node: Node, status: str, *, watches: bool = False) -> Node:
    """A node that ends with a status, success or failure, without its child if a condition holds.

    `watches`: also while the child runs, which is then stopped.
    """
    if status == "failure":
        return guarded(opposite(ends), node, "self" if watches else "none")
    return Node("reactive_selector" if watches else "selector", (), (check(ends), node))


class Importer:
    """Reads each tree of a file once for each mapping of its keys, however often it is used."""

    def __init__(
        self,
        readers: Mapping[str, Reader],
        root: Element,
        vocabulary: Vocabulary,
        folder: Path | None,
        *,
        any_key: bool = False,
    ) -> None:
        """`any_key`: the vocabulary declares no keys, and scripts can have any."""
        self.readers, self.root, self.vocabulary = readers, root, vocabulary
        self.words = None if any_key else vocabulary  # of scripts
        self.used: list[Args] = []  # what has been read with keys
        self.differences: dict[str, tuple[int, int]] = {}  # first line and column of each
        self._trees = XmlTrees(root, folder)
        self._passed: dict[str, str] = {}  # texts and {entries} by the keys of the present tree
        self._done: dict[tuple[str, frozenset[tuple[str, str]]], Node] = {}
        self._names = {*RESERVED, *vocabulary.actions}  # of subtrees, and reserved ones
        self._open: list[str] = []  # trees that are being read
        self.above: list[str] = []  # tags of the elements that are being read
        self._elements = 0  # read so far

    # Trees

    def tree(self, identity: str | None) -> Node:
        """The tree of that ID; None: the main tree."""
        self._open, self.above = [], []  # also after an error
        if identity is None:
            identity = self.root.attributes.get("main_tree_to_execute", "")
            trees = self._trees.by_id
            if not identity and len(trees) > 1:
                raise self.root.error(
                    "expected main_tree_to_execute, as there are several trees:"
                    f" {_listed(trees)}; add it, or choose one by --tree ID"
                )
            identity = identity or next(iter(trees))
        return self._subtree(identity, self.root)

    def _subtree(self, identity: str, user: Element) -> Node:
        """A tree of the file."""
        key = identity, frozenset(self._passed.items())
        if key in self._done:
            return self._done[key]
        tree = self._trees.find(identity)
        if tree is None:
            message = f"there is no <BehaviorTree ID={shown(identity)}>"
            raise user.error(f"{message}; there are {_listed(self._trees.by_id)}")
        if identity in self._open:
            raise user.error(f"the tree {shown(identity)} contains itself")
        self._open.append(identity)
        node = commented(self.child(tree), notes_of(tree))
        self._open.pop()
        if any(islice(walk(node), MAX_NODES, None)):  # trees may double each other
            raise user.error(_TOO_LARGE, LimitError)
        if self._open:  # it is used, not the tree that is asked for
            new_name = fresh_name(identity, self._names)
            self._names.add(new_name)
            node = as_subtree(node, new_name)
        self._done[key] = node
        return node

    def use(self, element: Element, _: str) -> Node:
        """A SubTree; one that is in no file is a leaf, if the vocabulary has it."""
        given, identity = element.attributes, element.attributes.get("ID", "")
        leaf = re.sub(r"\W", "_", identity)
        if leaf in self.vocabulary.actions and self._trees.find(identity) is None:
            self.differs(element, "outside")
            return self.readers["Action"](self, element, leaf)
        # In version 3, a SubTree passes entries without braces.
        bare = element.tag == "SubTree" and self.root.attributes.get("BTCPP_format", "3") == "3"
        passed: dict[str, str] = {}
        for key in [
            k for k in given if NAME.fullmatch(k) and k[0] != "_" and k not in ("ID", *NOTES)
        ]:
            value = given.pop(key)
            value = f"{{{key}}}" if value == "{=}" else value
            passed[key] = self.resolved(f"{{{value}}}" if bare and value[:1] != "{" else value)
        outside, self._passed = self._passed, {**self._passed, **passed}
        node = self._subtree(identity, element)
        self._passed = outside
        remaps = ("_autoremap", "__autoremap", "__shared_blackboard")
        if not passed and not any(given.get(name) in TRUE for name in remaps) and _reads(node):
            self.differs(element, "scope")
        return node

    # Nodes

    def node(self, element: Element) -> Node:
        """A node with its comments."""
        tag, given = tag_of(element), dict(element.attributes)
        self._elements += 1
        if self._elements > 2 * MAX_NODES or len(self.above) >= MAX_LEVELS:
            raise element.error(_TOO_LARGE, LimitError)
        is_action = tag in self.vocabulary.actions
        reader = self.readers.get(tag, self.readers["Action"] if is_action else _unknown)
        if tag == "Sleep" and is_action and "msec" not in given:  # one of the program
            reader = self.readers["Action"]
        elif tag in _DIFFERING:
            self.differs(element, _DIFFERING[tag])
        own = replace(element, attributes=given)
        before = [name for name in PRECONDITIONS if name in given]
        scripts = {name: given.pop(name) for name in (*before, *POSTCONDITIONS) if name in given}
        self.above.append(tag)
        try:
            node = reader(self, own, tag)
        except ValueError as error:
            raise element.error(str(error)) from None
        self.above.pop()
        for attribute in given:  # those that the reader did not take
            is_decoration = attribute in ("ID", *NOTES) or attribute[0] == "_"
            if attribute == "_onHalted" or not is_decoration:
                raise element.error(
                    f"the language has no equivalent of {shown(attribute)} of {tag}"
                )
        if scripts:
            node = without_interrupts(node)
        for name in POSTCONDITIONS:
            if name in scripts:
                script = self.assignments(element, scripts[name])
                node = filled(POSTCONDITIONS[name], NODE=node, SET=script)
        for name in reversed(before):
            node = self._tested(element, name, scripts[name], node)
        return commented(node, notes_of(element))

    def _tested(self, element: Element, name: str, code: str, node: Node) -> Node:
        """A node with the condition of an attribute, which is evaluated before it starts."""
        runs_while = name == "_while"
        if code == ("true" if runs_while else "false"):
            return node
        status = "failure" if name == "_failureIf" else "success"
        if name in ("_skipIf", "_while"):
            parent = self.above[-1] if self.above else ""
            if parent.removeprefix("Reactive") not in _SKIP_IN:
                raise element.error(f"{shown(name)} is imported only in a Sequence or a Fallback")
            self.differs(element, "skipped")
            status = "failure" if parent.endswith("Fallback") else "success"
        if code in ("true", "false"):
            return ALWAYS[status]
        test = self.condition(element, code)
        return unless(opposite(test) if runs_while else test, node, status, watches=runs_while)

    def nodes(
        self, element: Element, children: tuple[int, int] = (1, UNLIMITED)
    ) -> tuple[Node, ...]:
        """The children; `children`: fewest and most."""
        fewest, most = children
        if not fewest <= len(element.children) <= most:
            expected = _CHILDREN.get(children, "children")
            found = len(element.children)
            raise element.error(f"expected {expected} in <{element.tag}>, found {found}")
        return tuple(map(self.node, element.children))

    def child(self, element: Element) -> Node:
        """The only child."""
        return self.nodes(element, (1, 1))[0]

    def condition(self, element: Element, code: str) -> ConditionExpr:
        """The condition that an element asks in the library's script language."""
        expr = self.read(element, read_condition, code)
        self.used.append(GuardArgs(expr))
        if any(term.operator in ("==", "!=") for term in terms(expr)):
            self.differs(element, "equal")
        return expr

    def assignments(self, element: Element, code: str) -> Node:
        """The node for a script that writes to the blackboard."""
        args = [*map(SetArgs, self.read(element, read_assignments, code))]
        self.used += args
        nodes = [Node("set", each) for each in args]
        return nodes[0] if len(nodes) == 1 else sequence(*nodes)

    def read(self, element: Element, reader: Callable[[str, Vocabulary | None], T], code: str) -> T:
        """What is read from a script, with the keys and texts that are passed to this tree."""

        def passed(match: re.Match[str]) -> str:
            given = self._passed.get(match["name"] or "")
            return match[0].removeprefix("@") if given is None else literal(given)

        try:
            return reader(_IN_SCRIPT.sub(passed, code.replace('"', "'")), self.words)
        except ValueError as error:
            raise element.error(str(error)) from None

    def resolved(self, text: str) -> str:
        """The text of a port, `{key}` of the blackboard, or a text that is passed for a key."""
        text = text.replace("{@", "{")
        return self._passed.get(text[1:-1], text) if text[:1] + text[-1:] == "{}" else text

    # Messages

    def differs(self, element: Element, about: str) -> None:
        """Notes a difference of DIFFERENCES."""
        self.differences.setdefault(about, (element.line, element.column))


def literal(text: str) -> str:
    """A text that a port or a SubTree gives, as scripts have it: a key, a value or a word."""
    return text.strip("{}") if _PLAIN.fullmatch(text) else f"'{text}'"


def is_check(element: Element) -> bool:
    """True for a condition without attributes that mean more than its code."""
    special = {*PRECONDITIONS, *POSTCONDITIONS}.intersection(element.attributes)
    return tag_of(element) == "ScriptCondition" and not special


def _listed(names: Collection[str]) -> str:
    """The first names of many."""
    first = [shown(name) for name in list(names)[:10]]
    return ", ".join(first) + (", ..." if len(names) > 10 else "")


def _reads(tree: Node) -> bool:
    """True if a tree reads or writes the blackboard."""
    leaves = (node.args for node in walk(tree) if isinstance(node.args, ActionArgs))
    return bool(keys_in(tree)) or any(referenced(v) for args in leaves for _, v in args.values)


def _unknown(importer: Importer, element: Element, tag: str) -> NoReturn:
    tags = [*importer.readers, *importer.vocabulary.actions]
    guess = closest(tag, tags)
    hint = f"did you mean {guess}?" if guess else f"known nodes: {', '.join(tags)}"
    raise element.error(f"the language has no node {shown(tag)}; {hint}")


Reader: TypeAlias = Callable[[Importer, Element, str], Node]
"""Reads the nodes of a tag. It takes the attributes that it knows from the element."""
