"""Reads BehaviorTree.CPP XML, version 4, for the nodes that the language has too.

The nodes of `nodes/islandgp_nodes.hpp` are those of the language. Of the library's
own, a condition at the front of a ReactiveSequence checks itself. What does not mean
quite the same here is told with its place; what has no equal here is refused with its
place and a reason, never guessed.
"""

from __future__ import annotations

import re
from collections.abc import Collection, Sequence
from pathlib import Path
from typing import Final, NamedTuple, NoReturn

from islandgp.bt.analysis.truth import hidden
from islandgp.bt.core.condition import Compound, negate, opposite, terms
from islandgp.bt.core.includes import MAX_FILES
from islandgp.bt.core.kinds import ABORTS, POLICIES, REPEATS, SECONDS
from islandgp.bt.core.language import MAX_LEVELS, MAX_NODES, parse, parse_condition
from islandgp.bt.core.node import (
    CountArgs,
    Node,
    ParallelArgs,
    Policy,
    SecondsArgs,
    Used,
    Value,
    guarded,
)
from islandgp.bt.core.parameters import fits, value_range
from islandgp.bt.core.printer import with_subtrees
from islandgp.bt.core.source import closest, shown
from islandgp.bt.core.vocabulary import NAME, RESERVED, Vocabulary
from islandgp.bt.export.behaviortree_cpp import EQUAL, JUDGED, NODES, REPEAT, REST, TAGS
from islandgp.bt.export.plan import CLOCK, Loss, fresh_name
from islandgp.bt.export.scripts import read_condition
from islandgp.bt.export.xml_reader import Element, read_xml
from islandgp.errors import LimitError, TreeError

_NUMBER: Final = re.compile(r"[0-9]{1,9}(\.[0-9]{1,9})?")
_SIGNED: Final = re.compile(r"-?[0-9]{1,9}(\.[0-9]{1,9})?")
_EXPLICIT: Final = ("Action", "Condition", "Control", "Decorator")  # <Action ID="X"/> is <X/>
_RENAMED: Final = {"SubTreePlus": "SubTree", "RetryUntilSuccesful": "RetryUntilSuccessful"}
"""Tags of version 3, with those of version 4."""
_NOTES: Final = ("_description", "_fullpath", "_uid")
"""Attributes that editors write, without a meaning for the tree."""
MAX_XML: Final = 1_000_000  # characters of an included file
_ATTRIBUTES: Final = {
    "SubTree": ("_autoremap", "__autoremap"),
    **{node.tag: node.attributes for node in NODES.values()},
}
_COMPOSITES: Final = {
    tag: "selector" if tag.endswith("Fallback") else "sequence"
    for tag in TAGS
    if tag.endswith(("Fallback", "Sequence"))
}

_DECORATORS: Final = {
    "Inverter": "inverter",
    "ForceSuccess": "force_success",
    "ForceFailure": "force_failure",
}
_COUNTED: Final = {
    "Repeat": ("repeater", "num_cycles"),
    "RepeatPerTick": ("repeater", "num_cycles"),
    "RetryUntilSuccessful": ("retry", "num_attempts"),
    "RetryPerTick": ("retry", "num_attempts"),
}

_TIMED: Final = {
    "WaitTicks": ("wait", "seconds", 1),
    "TimeoutTicks": ("timeout", "seconds", 1),
    "Delay": ("wait", "delay_msec", 1000),
    "Timeout": ("timeout", "msec", 1000),
}
"""By tag: our kind, the attribute, and how many of its units are a second."""

SCOPE = Loss(
    "scope",
    'a SubTree without _autoremap="true" has a blackboard of its own, in which the keys of its'
    " conditions are not set; here there is one blackboard",
)


class Difference(NamedTuple):
    """A loss, and where in the file it comes in first."""

    line: int
    column: int
    loss: Loss


class Imported(NamedTuple):
    """A tree, and what does not mean the same as in the file: each kind of loss once."""

    tree: Node
    differences: tuple[Difference, ...]  # in the order of the file
    text: str  # the tree with its SubTrees as named subtrees


def read_tree(
    text: str,
    vocabulary: Vocabulary,
    *,
    name: str = "<xml>",
    tree: str | None = None,
    folder: Path | None = None,
) -> Imported:
    """A tree of a file.

    Args:
        text: the file.
        vocabulary: the actions and keys that there are.
        name: what messages call the file.
        tree: the ID of the tree; None: the file's main tree.
        folder: of the file; what it includes is there or below. None: it includes none.

    Raises:
        TreeError: not such a file, or it holds something that the language has not; the message
            tells the place.
        LimitError: the tree is larger than any limit on trees could allow.
    """
    importer = _Importer(name, read_xml(text, name=name), vocabulary, folder)
    found = importer.tree(tree)
    # The text of the tree is read again, as only the language knows what a right tree is.
    written = with_subtrees(found)
    checked = parse(written, vocabulary, name=f"{name}, as text")
    return Imported(checked, tuple(sorted(importer.differences.values())), written)


class _XmlTree(NamedTuple):
    element: Element
    file: str  # what messages call it


class _ReadSubtree(NamedTuple):
    node: Node
    nodes: int
    levels: int
    asks: bool  # the blackboard


class _Importer:
    """Reads each tree of a file once, however often it is used.

    Sizes are counted with a SubTree as large as its tree, so that trees which double each other
    are refused before they are expanded.
    """

    def __init__(
        self, name: str, root: Element, vocabulary: Vocabulary, folder: Path | None
    ) -> None:
        self._name = name
        self._folder = folder
        self._included: set[Path] = set()
        self._keys: dict[str, str] = {}  # of the tree that is being read, with the blackboard's
        self._vocabulary = vocabulary
        self._root = root
        self._trees: dict[str, _XmlTree] = {}
        self._add_trees(root, folder)
        self._read: dict[tuple[str, frozenset[tuple[str, str]]], _ReadSubtree] = {}
        self._names = {*RESERVED, *vocabulary.actions}  # that no other subtree can have
        self._open: list[str] = []  # trees that are being read
        self._nodes = 0  # of the tree that is being read, so far
        self._level = 0  # in it
        self._levels = 0
        self._asks = False
        self.differences: dict[Loss, Difference] = {}

    def tree(self, identity: str | None) -> Node:
        """The tree of that ID; None: the main tree."""
        if identity is not None:
            return self._subtree(identity, self._root).node
        asked = self._root.attributes.get("main_tree_to_execute", "")
        if not asked and len(self._trees) > 1:
            self._fail(
                self._root,
                "expected main_tree_to_execute, as there are several trees:"
                f" {_listed(self._trees)}; add it, or choose one by --tree ID",
            )
        return self._subtree(asked or next(iter(self._trees)), self._root).node

    def _add_trees(self, root: Element, beside: Path | None) -> None:
        """The trees of a file, and of those that it includes."""
        if root.tag != "root":
            self._fail(root, f"expected <root> with a <BehaviorTree>, found <{shown(root.tag)}>")
        version = root.attributes.get("BTCPP_format", "3")
        if version not in ("3", "4"):
            self._fail(root, f'expected BTCPP_format="4", found version {shown(version)}')
        for element in root.children:
            if element.tag == "include":
                self._include(element, beside)
                continue
            if element.tag == "TreeNodesModel":
                continue
            if element.tag != "BehaviorTree":
                self._fail(element, f"expected a <BehaviorTree>, found <{shown(element.tag)}>")
            identity = element.attributes.get("ID", "")
            if identity in self._trees:
                self._fail(element, f"the tree {shown(identity)} stands twice; rename one")
            self._trees[identity] = _XmlTree(element, self._name)
        if not self._trees:
            self._fail(root, "expected <root> with a <BehaviorTree>, found none")

    def _include(self, element: Element, beside: Path | None) -> None:
        """The trees of a file in the folder of the main file, or below it; each file once."""
        written = element.attributes.get("path", "")
        if self._folder is None or beside is None or not written or "\0" in written:
            self._fail(element, "expected the path of a file beside this one")
        path = (beside / written).resolve()
        if Path(written).is_absolute() or not path.is_relative_to(self._folder.resolve()):
            self._fail(element, f"{shown(written)} leads out of the folder of the tree")
        if path in self._included:
            return
        self._included.add(path)
        if len(self._included) > MAX_FILES or not path.is_file():
            self._fail(element, f"expected a file, and {MAX_FILES} at most, found {shown(written)}")
        try:
            with path.open(encoding="utf-8") as file:
                text = file.read(MAX_XML)
        except (OSError, UnicodeDecodeError):
            self._fail(element, f"{shown(written)} cannot be read as UTF-8 text")
        name, self._name = self._name, str(path.relative_to(self._folder.resolve()))
        self._add_trees(read_xml(text, name=self._name), path.parent)
        self._name = name

    def _subtree(self, identity: str, user: Element) -> _ReadSubtree:
        key = identity, frozenset(self._keys.items())
        if key in self._read:
            return self._read[key]
        if identity not in self._trees:
            self._fail(
                user,
                f"there is no <BehaviorTree ID={shown(identity)}>; there are"
                f" {_listed(self._trees)}",
            )
        if identity in self._open:
            self._fail(user, f"the tree {shown(identity)} contains itself")
        if len(self._open) >= MAX_LEVELS:
            self._fail(user, f"expected at most {MAX_LEVELS} SubTrees in each other")
        tree, file = self._trees[identity]
        name, self._name = self._name, file
        if len(tree.children) != 1:
            self._fail(tree, f"expected one node in a <BehaviorTree>, found {len(tree.children)}")
        self._open.append(identity)
        outside = self._nodes, self._level, self._levels, self._asks
        self._nodes = self._level = self._levels = 0
        self._asks = False
        node = self._node(tree.children[0])
        self._open.pop()
        self._name = name
        if self._open:  # it is used, not the tree that is asked for
            word = fresh_name(identity, self._names)
            self._names.add(word)
            node = Used.of(node, word)
        self._read[key] = _ReadSubtree(node, self._nodes, self._levels, self._asks)
        self._nodes, self._level, self._levels, self._asks = outside
        return self._read[key]

    def _count(self, element: Element, nodes: int, levels: int) -> None:
        """Takes in nodes below the present level."""
        self._nodes += nodes
        self._levels = max(self._levels, self._level + levels)
        if self._nodes > MAX_NODES or self._levels > MAX_LEVELS:
            raise LimitError(
                f"{self._name}:{element.line}:{element.column}: expected a tree of at most"
                f" {MAX_LEVELS} levels and {MAX_NODES} nodes, each SubTree expanded",
                line=element.line,
                column=element.column,
            )

    def _node(self, element: Element) -> Node:
        tag = _tag(element)
        if tag == "SubTree":
            return self._use(element)
        self._count(element, 1, 1)
        self._level += 1
        node = self._inside(element, tag)
        self._level -= 1
        return node

    def _use(self, element: Element) -> Node:
        remapped = {
            key: self._keys.get(value[1:-1], value[1:-1])
            for key, value in element.attributes.items()
            if NAME.fullmatch(key) and value[:1] + value[-1:] == "{}"
        }
        self._check_attributes(element, "SubTree")
        outside, self._keys = self._keys, {**self._keys, **remapped}
        found = self._subtree(element.attributes.get("ID", ""), element)
        self._keys = outside
        self._count(element, found.nodes, found.levels)
        self._asks |= found.asks
        if found.asks and not remapped and _autoremap(element) not in ("true", "1"):
            self._differs(element, SCOPE)
        return found.node

    def _inside(self, element: Element, tag: str) -> Node:
        if tag not in TAGS and tag not in self._vocabulary.actions:
            self._unknown(element, tag)
        self._check_attributes(element, tag)
        if tag in ("Sequence", "Fallback"):
            return self._with_memory(element, self._children(element))
        if tag in ("ReactiveSequence", "ReactiveFallback"):
            return self._reactive(element, self._children(element))
        if tag in _COMPOSITES:
            return Node(_COMPOSITES[tag], (), self._nodes_of(element))
        if tag == "When":
            return self._own_guard(element)
        if tag == "JudgedParallel":
            defaults = (("success", "all"), ("failure", "one"))
            policies = [self._policy(element, *each) for each in defaults]
            return Node("parallel", ParallelArgs(*policies), self._nodes_of(element))
        if tag in _DECORATORS:
            return Node(_DECORATORS[tag], (), (self._node(self._only_child(element)),))
        if tag in _COUNTED:
            return self._repeat(element, tag)
        if tag in _TIMED:
            return self._timed(element, tag)
        if tag == "Parallel":
            return self._parallel(element)
        if tag == "ScriptCondition":
            self._fail(
                element,
                "a condition must stand before something that it guards, in a Sequence or Fallback",
            )
        if element.children:
            self._fail(element, f"the action {tag} has no children")
        return self._leaf(element, tag)

    def _leaf(self, element: Element, tag: str) -> Node:
        """A leaf; the values of its ports are arguments."""
        parameters = self._vocabulary.action(tag).arguments
        values: dict[str, Value] = {}
        for port, text in element.attributes.items():
            if port in parameters:
                parameter = parameters[port]
                word = {"true": "yes", "1": "yes", "false": "no", "0": "no"}.get(text, text)
                numeric = parameter.numeric and _SIGNED.fullmatch(text)
                values[port] = (
                    float(text) if numeric else word if parameter.sort == "flag" else text
                )
                if not fits(parameter, values[port]):
                    self._fail(
                        element,
                        f"expected {port} of {value_range(parameter)}, found {shown(text)}",
                    )
        return self._vocabulary.leaf(tag, values)

    def _with_memory(self, element: Element, elements: Sequence[Element]) -> Node:
        """A condition guards all that stands behind it."""
        kind = _COMPOSITES[_tag(element)]
        parts: list[Node] = []
        for index, each in enumerate(elements[:-1]):
            if _tag(each) == "ScriptCondition":
                parts.append(self._guarding(each, element, elements[index + 1 :], "none"))
                break
            # In that library no composite observes the guards of this branch.
            parts.append(hidden(self._node(each)))
        else:
            last = elements[-1]
            node = self._node(last)
            ours = last.attributes.get("name") == REST and node.kind == kind
            parts += node.children if ours and parts else (node,)  # as our own export nested it
        return parts[0] if len(parts) == 1 and len(elements) > 1 else Node(kind, (), tuple(parts))

    def _reactive(self, element: Element, elements: Sequence[Element]) -> Node:
        """A condition at the front guards the rest and checks itself."""
        first, *rest = elements
        if _tag(first) == "ScriptCondition" and rest:
            return self._guarding(first, element, rest, "self")
        return Node(f"reactive_{_COMPOSITES[_tag(element)]}", (), tuple(map(self._node, elements)))

    def _guarding(
        self, condition: Element, element: Element, behind: Sequence[Element], abort: str
    ) -> Node:
        """A condition in a composite, and all that stands behind it there."""
        inverted = _COMPOSITES[_tag(element)] == "selector"
        self._count(condition, 1, 1)
        self._level += 1
        if len(behind) == 1:
            inner = self._node(behind[0])
        elif abort == "none":
            inner = self._with_memory(element, behind)
        else:
            inner = self._reactive(element, behind)
        self._level -= 1
        # In that library no composite observes a guard behind a condition.
        return self._guard(condition, hidden(inner), abort, inverted=inverted)

    def _guard(self, element: Element, child: Node, abort: str, *, inverted: bool) -> Node:
        """Runs its child where a condition holds; inverted: succeeds there, else runs the child."""
        self._check_attributes(element, "ScriptCondition")
        self._asks = True
        try:
            expr = read_condition(self._asked(element, "code"), self._vocabulary)
        except ValueError as error:
            self._fail(element, str(error))
        if any(term.operator in ("==", "!=") for term in terms(expr)):
            self._differs(element, EQUAL)
        if not inverted:
            return guarded(expr, child, abort)
        against = negate(expr) if isinstance(expr, Compound) else opposite(expr)
        guard = guarded(against, Node("inverter", (), (child,)), abort)
        return Node("inverter", (), (guard,))

    def _asked(self, element: Element, attribute: str) -> str:
        """A condition's text with the keys of the blackboard."""
        text = element.attributes.get(attribute, "")
        return NAME.sub(lambda word: self._keys.get(word[0], word[0]), text)

    def _own_guard(self, element: Element) -> Node:
        self._asks = True
        given = element.attributes
        abort = given.get("abort", "both")
        if abort not in ABORTS:
            self._fail(
                element, f"expected abort {', '.join(ABORTS)}, found {shown(abort)}; choose one"
            )
        try:
            expr = parse_condition(self._asked(element, "condition"), self._vocabulary)
        except TreeError as error:
            said = [line.strip() for line in str(error).splitlines()]
            self._fail(element, "; ".join(["in the condition, place " + said[0], *said[3:]]))
        return guarded(expr, self._node(self._only_child(element)), abort)

    def _repeat(self, element: Element, tag: str) -> Node:
        kind, attribute = _COUNTED[tag]
        count = element.attributes.get(attribute, "")
        fewest, most = REPEATS
        if not (count.isdecimal() and len(count) < 10 and fewest <= int(count) <= most):
            self._fail(
                element, f"expected {attribute} from {fewest} to {most}, found {shown(count)}"
            )
        if not tag.endswith("PerTick") and int(count) != 1:
            self._differs(element, REPEAT)
        return Node(kind, CountArgs(int(count)), (self._node(self._only_child(element)),))

    def _timed(self, element: Element, tag: str) -> Node:
        kind, attribute, unit = _TIMED[tag]
        text = element.attributes.get(attribute, "")
        seconds = float(text) / unit if _NUMBER.fullmatch(text) else 0.0
        least, most = SECONDS
        if not least <= seconds <= most:
            self._fail(
                element,
                f"expected {attribute} from {least * unit:g} to {most * unit:,}, found"
                f" {shown(text)}",
            )
        if unit != 1:
            self._differs(element, CLOCK)
        return Node(kind, SecondsArgs(seconds), (self._node(self._only_child(element)),))

    def _policy(self, element: Element, attribute: str, default: str) -> Policy:
        found = element.attributes.get(attribute, default)
        if found in POLICIES:
            return found
        if not (found.isdecimal() and len(found) < 10 and REPEATS[0] <= int(found) <= REPEATS[1]):
            self._fail(element, f"expected {attribute} one, all or a number, found {shown(found)}")
        return int(found)

    def _parallel(self, element: Element) -> Node:
        children = self._children(element)
        count = len(children)
        success = self._threshold(element, "success_count", "-1", count)
        failure = self._threshold(element, "failure_count", "1", count)
        # It fails when it can't succeed any more.
        failure = min(failure, count - success + 1)
        if len(children) > 1:
            self._differs(element, JUDGED)
        return Node(
            "parallel",
            ParallelArgs(_policy(success, count), _policy(failure, count)),
            tuple(map(self._node, children)),
        )

    def _threshold(self, element: Element, attribute: str, default: str, count: int) -> int:
        value = element.attributes.get(attribute, default)
        number = int(value) if re.fullmatch(r"-?[0-9]{1,4}", value) else 0
        number = max(0, count + number + 1) if number < 0 else number  # -1 is all
        if not 1 <= number <= min(count, REPEATS[1]):
            self._fail(
                element, f"expected {attribute} 1 to {count}, or -1 for all, found {shown(value)}"
            )
        return number

    def _nodes_of(self, element: Element) -> tuple[Node, ...]:
        return tuple(map(self._node, self._children(element)))

    def _children(self, element: Element) -> list[Element]:
        if not element.children:
            self._fail(element, f"expected children in <{element.tag}>")
        return element.children

    def _only_child(self, element: Element) -> Element:
        if len(element.children) != 1:
            self._fail(
                element, f"expected one child in <{element.tag}>, found {len(element.children)}"
            )
        return element.children[0]

    def _check_attributes(self, element: Element, tag: str) -> None:
        for attribute, value in element.attributes.items():
            if attribute in _NOTES or (tag == "SubTree" and value[:1] + value[-1:] == "{}"):
                continue
            ports = self._vocabulary.action(tag).arguments
            if attribute not in ("name", "ID", *ports, *_ATTRIBUTES.get(tag, ())):
                self._fail(element, f"the language has nothing like {shown(attribute)} of {tag}")

    def _differs(self, element: Element, loss: Loss) -> None:
        self.differences.setdefault(loss, Difference(element.line, element.column, loss))

    def _unknown(self, element: Element, tag: str) -> NoReturn:
        known = (*TAGS, "SubTree", *self._vocabulary.actions)
        guess = closest(tag, known)
        hint = f"did you mean {guess}?" if guess else f"there are {', '.join(known)}"
        self._fail(element, f"the language has no node {shown(tag)}; {hint}")

    def _fail(self, element: Element, message: str) -> NoReturn:
        line, column = element.line, element.column
        raise TreeError(f"{self._name}:{line}:{column}: {message}", line=line, column=column)


def _policy(number: int, count: int) -> Policy:
    return "one" if number == 1 else "all" if number == count else number


def _listed(names: Collection[str]) -> str:
    """The first names of many."""
    first = [shown(name) for name in list(names)[:10]]
    return ", ".join(first) + (", ..." if len(names) > 10 else "")


def _tag(element: Element) -> str:
    """What node it is: <Action ID="X"/> is <X/>, and some had other names in version 3."""
    if element.tag in _EXPLICIT:
        return element.attributes.get("ID", element.tag)
    return _RENAMED.get(element.tag, element.tag)


def _autoremap(element: Element) -> str:
    return element.attributes.get("_autoremap", element.attributes.get("__autoremap", ""))
