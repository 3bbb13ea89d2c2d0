"""The state of an import from BehaviorTree.CPP: trees, keys, sizes and messages."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Final, NamedTuple, NoReturn, TypeAlias

from islandgp.bt.analysis.context import without_interrupts
from islandgp.bt.analysis.names import fresh_name
from islandgp.bt.core.condition import Compound, ConditionExpr, negate, opposite, terms
from islandgp.bt.core.kinds import kind_of
from islandgp.bt.core.language import MAX_LEVELS, MAX_NODES
from islandgp.bt.core.node import ActionArgs, Node, as_subtree, commented, guarded, keys_in, walk
from islandgp.bt.core.parameters import referenced
from islandgp.bt.core.source import closest, shown
from islandgp.bt.core.vocabulary import NAME, RESERVED, Vocabulary
from islandgp.bt.export.scripts import read_condition
from islandgp.bt.export.tree_writer import HEADER
from islandgp.bt.export.xml_reader import Element, XmlTrees
from islandgp.errors import LimitError, TreeError

NOTES: Final = ("name", "_description", "_fullpath", "_uid")
"""Attributes without an effect on the tree; they become comments, `# name: ...`."""
PRECONDITIONS: Final = ("_failureIf", "_successIf", "_skipIf", "_while")
"""Attributes with conditions, in the order in which they are evaluated."""
_SKIP_IN: Final = ("Sequence", "ReactiveSequence", "SequenceWithMemory", "Fallback",
                   "ReactiveFallback")  # fmt: skip
"""The parents in which a node can be skipped."""
_SCRIPTS: Final = ("_onSuccess", "_onFailure", "_onHalted", "_post")
"""Attributes that write to the blackboard; others with _ in front are decoration of editors."""
_EXPLICIT: Final = ("Action", "Condition", "Control", "Decorator")  # <Action ID="X"/> is <X/>
_RENAMED: Final = {
    "SubTreePlus": "SubTree",
    "RetryUntilSuccesful": "RetryUntilSuccessful",
    "SequenceStar": "SequenceWithMemory",
}
"""Tags of version 3, with those of version 4."""
TRUE: Final = ("true", "1")

DIFFERENCES: Final = {
    "clock": "the library measures time by the computer's clock; islandgp counts ticks",
    "repeat": "a repetition can start in the tick in which one ends; in islandgp in the next one",
    "judged": "Parallel ends at the child that decides, and does not tick later ones in that tick",
    "waits": "ParallelAll with max_failures above 1 ends when all children have ended",
    "equal": "== and != treat two numbers that differ by at most 0.00000012 as equal",
    "order": "a branch starts before the other one is halted; islandgp halts first",
    "scope": 'a SubTree without _autoremap="true" has its own blackboard; islandgp has one',
    "skipped": "a skipped node is ignored; in islandgp it ends, and its composite continues",
    "asked": "IfThenElse evaluates its condition once; islandgp again after the second child",
    "twice": "a condition leaf before two branches is evaluated once; in islandgp for each of them",
    "memory": "SequenceWithMemory continues with the failed child; a sequence with its first",
    "rate": "a RateController starts its child at once after a node above it was reset",
    "round": "RoundRobin ends after its last child in newer releases; round_robin continues",
    "gate": "this decorator watches its child; here it is a leaf before it, of your program",
}
"""The differences in behaviour after an import; docs/exports.md explains each."""


GATES: Final = {
    "DistanceController": "sequence",
    "GoalUpdatedController": "sequence",
    "GoalUpdater": "sequence",
    "SingleTrigger": "sequence",
    "SpeedController": "sequence",
    "PathLongerOnApproach": "reactive_selector",
}
"""Decorators of Nav2 that become a leaf and their child, by the composite that holds both.

In a sequence the leaf succeeds when the child is due. In a selector the leaf, a condition, is
inverted: if it fails, the decorator succeeds without its child.
"""


class Difference(NamedTuple):
    """A difference with its first place in the file."""

    line: int
    column: int
    about: str  # of DIFFERENCES


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


Test: TypeAlias = ConditionExpr | Node
"""A condition of keys, or a tree of condition leaves that answers within its tick."""


def inverted(node: Node) -> Node:
    """A node with success and failure exchanged."""
    return node.children[0] if kind_of(node).inverts else Node("inverter", (), (node,))


def unless(test: Test) -> Test:
    """The negation of a test."""
    if isinstance(test, Node):
        return inverted(test)
    return negate(test) if isinstance(test, Compound) else opposite(test)


def only_if(test: Test, child: Node, abort: str) -> Node:
    """A node that fails if the test does not hold; `abort` is none or self."""
    if not isinstance(test, Node):
        return guarded(test, child, abort)
    return Node("sequence" if abort == "none" else "reactive_sequence", (), (test, child))


def implies(test: Test, child: Node, abort: str) -> Node:
    """A node that succeeds if the test does not hold; `abort` is none or self."""
    if not isinstance(test, Node):
        return inverted(guarded(test, inverted(child), abort))
    kind = "selector" if abort == "none" else "reactive_selector"
    return Node(kind, (), (inverted(test), child))


def if_else(test: Test, children: Sequence[Node], abort: str) -> Node:
    """An IfThenElse (abort none) or a WhileDoElse (self) without its first child."""
    if len(children) == 1:
        return only_if(test, children[0], abort)
    success_branch, otherwise = children
    if abort == "self" and not isinstance(test, Node):
        # The guards halt a branch before the other starts.
        negated = unless(test)
        assert not isinstance(negated, Node)
        branches = (guarded(test, success_branch), guarded(negated, otherwise, "self"))
        return Node("selector", (), branches)
    kind = "sequence" if abort == "none" else "reactive_sequence"
    parts = (implies(test, success_branch, abort), implies(unless(test), otherwise, abort))
    return Node(kind, (), parts)


def answers_at_once(tree: Node, vocabulary: Vocabulary) -> bool:
    """True if a tree has condition leaves, selectors, sequences and inverters only."""
    return all(
        vocabulary.action(node.action).condition
        if node.action
        else kind_of(node).inverts or kind_of(node).advance_status is not None
        for node in walk(tree)
    )


class Importer:
    """Reads each tree of a file once for each mapping of its keys, however often it is used."""

    def __init__(
        self,
        readers: Mapping[str, Reader],
        name: str,
        root: Element,
        vocabulary: Vocabulary,
        folder: Path | None,
    ) -> None:
        self.readers, self.root, self.vocabulary = readers, root, vocabulary
        self.differences: dict[str, Difference] = {}
        self._name = name  # of the present file
        self._trees = XmlTrees(root, name, folder).by_id
        self._keys: dict[str, str] = {}  # of the present tree, with the blackboard's
        self._done: dict[tuple[str, frozenset[tuple[str, str]]], tuple[Node, bool]] = {}
        self._names = {*RESERVED, *vocabulary.actions}  # of subtrees, and reserved ones
        self._open: list[str] = []  # trees that are being read
        self.above: list[str] = []  # tags of the elements that are being read
        self._elements = 0  # read so far
        self._sizes: dict[int, tuple[Node, int, int]] = {}  # nodes and levels of a node, by its id

    # Trees

    def tree(self, identity: str | None) -> Node:
        """The tree of that ID; None: the main tree."""
        if identity is None:
            identity = self.root.attributes.get("main_tree_to_execute", "")
            if not identity and len(self._trees) > 1:
                self.fail(
                    self.root,
                    "expected main_tree_to_execute, as there are several trees:"
                    f" {_listed(self._trees)}; add it, or choose one by --tree ID",
                )
            identity = identity or next(iter(self._trees))
        return self._subtree(identity, self.root)[0]

    def _subtree(self, identity: str, user: Element) -> tuple[Node, bool]:
        """A tree, and whether it reads the blackboard."""
        key = identity, frozenset(self._keys.items())
        if key in self._done:
            return self._done[key]
        if identity not in self._trees:
            trees = _listed(self._trees)
            self.fail(user, f"there is no <BehaviorTree ID={shown(identity)}>; there are {trees}")
        if identity in self._open:
            self.fail(user, f"the tree {shown(identity)} contains itself")
        tree, file = self._trees[identity]
        name, self._name = self._name, file
        self._open.append(identity)
        node = commented(self.child(self._without_text(tree)), notes_of(tree))
        self._open.pop()
        self._name = name
        if self._open:  # it is used, not the tree that is asked for
            new_name = fresh_name(identity, self._names)
            self._names.add(new_name)
            node = as_subtree(node, new_name)
        self._done[key] = node, _reads(node)
        return self._done[key]

    def use(self, element: Element, _: str) -> Node:
        given = element.attributes
        remapped = {
            key: self._keys.get(value[1:-1], value[1:-1])
            for key, value in given.items()
            if NAME.fullmatch(key) and value[:1] + value[-1:] == "{}"
        }
        for key in remapped:
            del given[key]
        outside, self._keys = self._keys, {**self._keys, **remapped}
        node, reads = self._subtree(given.get("ID", ""), element)
        self._keys = outside
        remaps = ("_autoremap", "__autoremap", "__shared_blackboard")
        if reads and not remapped and not any(given.get(name) in TRUE for name in remaps):
            self.differs(element, "scope")
        return node

    # Nodes

    def node(self, element: Element) -> Node:
        """A node with its comments."""
        tag, given = tag_of(element), dict(element.attributes)
        self._elements += 1
        if self._elements > 2 * MAX_NODES or len(self.above) >= MAX_LEVELS:
            raise self.too_large(element)
        is_action = tag in self.vocabulary.actions
        reader = self.readers.get(tag, self.readers["Action"] if is_action else _unknown)
        own = replace(self._without_text(element), attributes=given)
        tests = [(name, self.condition(own, name)) for name in PRECONDITIONS if name in given]
        self.above.append(tag)
        try:
            node = reader(self, own, tag)
        except ValueError as error:
            self.fail(element, str(error))
        self.above.pop()
        for attribute in given:  # those that the reader did not take
            if attribute in _SCRIPTS or not (attribute in ("ID", *NOTES) or attribute[0] == "_"):
                self.fail(element, f"the language has no equivalent of {shown(attribute)} of {tag}")
        for name, test in reversed(tests):
            node = self._tested(element, name, test, without_interrupts(node))
        return self.sized(element, commented(node, notes_of(element)))

    def _tested(self, element: Element, name: str, test: ConditionExpr, node: Node) -> Node:
        """A node with the condition of an attribute, which is evaluated before it starts."""
        fails = name == "_failureIf"
        if name in ("_skipIf", "_while"):
            parent = self.above[-1] if self.above else ""
            if parent not in _SKIP_IN:
                self.fail(element, f"{shown(name)} is imported only in a Sequence or a Fallback")
            self.differs(element, "skipped")
            fails = parent.endswith("Fallback")
        rule = only_if if fails else implies
        return rule(test, node, "self") if name == "_while" else rule(unless(test), node, "none")

    def sized(self, element: Element, node: Node) -> Node:
        """The node. Raises LimitError if it is too large; trees may double each other."""
        _, nodes, levels = self._measured(node)
        if nodes > MAX_NODES or levels > MAX_LEVELS:
            raise self.too_large(element)
        return node

    def _measured(self, node: Node) -> tuple[Node, int, int]:
        if id(node) not in self._sizes:
            below = [self._measured(child) for child in node.children]
            nodes, levels = (sum(n for _, n, _ in below), max((n for *_, n in below), default=0))
            self._sizes[id(node)] = node, 1 + nodes, 1 + levels
        return self._sizes[id(node)]

    def too_large(self, element: Element) -> TreeError:
        """The error for a tree that is too large."""
        limits = f"{MAX_LEVELS} levels and {MAX_NODES} nodes, each SubTree expanded"
        return element.error(f"expected a tree of at most {limits}", self._name, LimitError)

    def nodes(self, element: Element) -> tuple[Node, ...]:
        if not element.children:
            self.fail(element, f"expected children in <{element.tag}>")
        return tuple(map(self.node, element.children))

    def child(self, element: Element) -> Node:
        if len(element.children) != 1:
            found = len(element.children)
            self.fail(element, f"expected one child in <{element.tag}>, found {found}")
        return self.node(element.children[0])

    def code(self, check: Element) -> ConditionExpr:
        """The condition of a ScriptCondition."""
        return self.condition(replace(check, attributes={**check.attributes}), "code")

    def condition(self, element: Element, attribute: str) -> ConditionExpr:
        """The condition that an attribute asks in the library's script language; takes it."""
        try:
            expr = read_condition(self.script(element, attribute), self.vocabulary)
        except ValueError as error:
            self.fail(element, str(error))
        if any(term.operator in ("==", "!=") for term in terms(expr)):
            self.differs(element, "equal")
        return expr

    def script(self, element: Element, attribute: str) -> str:
        """A script with the keys of the blackboard."""
        text = element.attributes.pop(attribute, "")
        return NAME.sub(lambda word: self._keys.get(word[0], word[0]), text)

    def key(self, text: str) -> str:
        """The key of the blackboard that a port names, as `{key}` or `key`."""
        name = text.strip("{}")
        return self._keys.get(name, name)

    # Messages

    def differs(self, element: Element, about: str) -> None:
        """Notes a difference of DIFFERENCES."""
        self.differences.setdefault(about, Difference(element.line, element.column, about))

    def fail(self, element: Element, message: str) -> NoReturn:
        """Raises TreeError with the place of an element."""
        raise element.error(message, self._name)

    def _without_text(self, element: Element) -> Element:
        """The element. Raises TreeError for text between nodes, which has no meaning."""
        if element.text:
            self.fail(
                element,
                f"expected nodes in {shown(element.tag)}, found the text {shown(element.text)};"
                " make it a comment, <!-- ... -->",
            )
        return element


def is_check(element: Element) -> bool:
    """True for a condition without attributes that mean more than its code."""
    special = {*PRECONDITIONS, *_SCRIPTS}.intersection(element.attributes)
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
    importer.fail(element, f"the language has no node {shown(tag)}; {hint}")


Reader: TypeAlias = Callable[[Importer, Element, str], Node]
"""Reads the nodes of a tag. It takes the attributes that it knows from the element."""
