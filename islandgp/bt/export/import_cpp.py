"""Reads BehaviorTree.CPP XML, version 4, for the nodes that the language has too.

Reactive composites become guards with abort rules: a condition in a
ReactiveSequence checks itself, one in a ReactiveFallback interrupts. What has
no equal here is refused with its place and a reason, never guessed.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final, NoReturn

from islandgp.bt.export.behaviortree_cpp import REST, TAGS
from islandgp.bt.export.plan import hands_over
from islandgp.bt.export.scripts import OPPOSITE, read_condition
from islandgp.bt.export.xml_reader import Element, read_xml
from islandgp.bt.language import MAX_LEVELS, parse, to_text
from islandgp.bt.node import REPEATS, Node
from islandgp.bt.source import closest
from islandgp.bt.truth import with_aborts
from islandgp.bt.vocabulary import Vocabulary
from islandgp.errors import TreeError

_EXPLICIT: Final = ("Action", "Condition", "Control", "Decorator")  # <Action ID="X"/> is <X/>
_ATTRIBUTES: Final[dict[str, tuple[str, ...]]] = {
    "ScriptCondition": ("code",),
    "Repeat": ("num_cycles",),
    "Parallel": ("success_count", "failure_count"),
    "SubTree": ("_autoremap",),
}


def from_xml(text: str, vocabulary: Vocabulary, *, name: str = "<xml>") -> Node:
    """The main tree of a file, with its SubTrees expanded.

    Raises:
        TreeError: not such a file, or it holds something that the language has not; the message
            tells the place.
    """
    root = read_xml(text, name=name)
    tree = _Importer(name, root, vocabulary).main()
    # The text of the tree is read again, as only the language knows what a right tree is.
    return parse(to_text(tree), vocabulary, name=f"{name}, as text")


class _Importer:
    def __init__(self, name: str, root: Element, vocabulary: Vocabulary) -> None:
        self._name = name
        self._vocabulary = vocabulary
        self._root = root
        self._trees = {
            element.attributes.get("ID", ""): element
            for element in root.children
            if element.tag == "BehaviorTree"
        }
        self._open: list[str] = []  # trees that are being expanded
        self._level = 0

    def main(self) -> Node:
        if self._root.tag != "root" or not self._trees:
            self._fail(self._root, "expected <root> with a <BehaviorTree>")
        version = self._root.attributes.get("BTCPP_format", "3")
        if version != "4":
            self._fail(self._root, f'expected BTCPP_format="4", found version {version}')
        first = next(iter(self._trees))
        asked = self._root.attributes.get("main_tree_to_execute")
        if asked is None and len(self._trees) > 1:
            self._fail(self._root, "expected main_tree_to_execute, as there are several trees")
        return self._tree(asked or first, self._root)

    def _tree(self, identity: str, user: Element) -> Node:
        if identity not in self._trees:
            known = ", ".join(self._trees)
            self._fail(user, f"there is no <BehaviorTree ID={identity!r}>; there are {known}")
        if identity in self._open:
            self._fail(user, f"the tree {identity!r} contains itself")
        tree = self._trees[identity]
        if len(tree.children) != 1:
            self._fail(tree, f"expected one node in a <BehaviorTree>, found {len(tree.children)}")
        self._open.append(identity)
        node = self._node(tree.children[0])
        self._open.pop()
        return node

    def _node(self, element: Element) -> Node:
        self._level += 1
        if self._level > MAX_LEVELS:
            self._fail(element, f"expected at most {MAX_LEVELS} levels")
        node = self._read(element)
        self._level -= 1
        return node

    def _read(self, element: Element) -> Node:
        tag = _tag(element)
        if tag == "SubTree":
            self._check_attributes(element, tag)
            return self._tree(element.attributes.get("ID", ""), element)
        if tag not in TAGS.values() and tag not in self._vocabulary.actions:
            self._unknown(element, tag)
        self._check_attributes(element, tag)
        if tag in ("Sequence", "Fallback"):
            return self._with_memory(tag, self._children(element))
        if tag in ("ReactiveSequence", "ReactiveFallback"):
            return self._reactive(element, self._children(element))
        if tag == "Inverter":
            return Node("inverter", (), (self._node(self._only_child(element)),))
        if tag == "Repeat":
            return self._repeat(element)
        if tag == "Parallel":
            return self._parallel(element)
        if tag == "ScriptCondition":
            self._fail(
                element,
                "a condition must stand before something that it guards, in a Sequence or Fallback",
            )
        if element.children:
            self._fail(element, f"the action {tag} has no children")
        return Node("action", (tag,))

    def _with_memory(self, tag: str, elements: Sequence[Element]) -> Node:
        """A condition guards all that stands behind it."""
        kind = "sequence" if tag == "Sequence" else "selector"
        parts: list[Node] = []
        for index, element in enumerate(elements):
            behind = elements[index + 1 :]
            if _tag(element) == "ScriptCondition" and behind:
                inner = (
                    self._node(behind[0]) if len(behind) == 1 else self._with_memory(tag, behind)
                )
                parts.append(self._guard(element, inner, "none", inverted=kind == "selector"))
                break
            part = self._node(element)
            if element.attributes.get("name") == REST and part.kind == kind and not behind:
                parts += part.children  # as our own export nested it
            else:
                parts.append(part)
        return parts[0] if len(parts) == 1 and len(elements) > 1 else Node(kind, (), tuple(parts))

    def _reactive(self, element: Element, elements: Sequence[Element]) -> Node:
        """Conditions at the front guard the rest and check themselves; the others interrupt."""
        kind = "sequence" if _tag(element) == "ReactiveSequence" else "selector"
        first, *rest = elements
        if _tag(first) != "ScriptCondition" or not rest:
            return self._interrupting(kind, element, elements)
        inner = self._node(rest[0]) if len(rest) == 1 else self._reactive(element, rest)
        return self._guard(first, inner, "self", inverted=kind == "selector")

    def _interrupting(self, kind: str, element: Element, elements: Sequence[Element]) -> Node:
        """A composite whose branches, but for the last, begin with a guard that interrupts."""
        *earlier, last = elements
        parts = []
        for branch in earlier:
            part = self._node(branch)
            if not hands_over(part, kind):
                self._fail(
                    branch,
                    f"in a {element.tag}, all but the last child must begin with a condition:"
                    " the language takes a branch up again only when a condition asks for it",
                )
            parts.append(with_aborts(part, {"none": "lower", "self": "both"}))
        end = self._node(last)
        nested = last.attributes.get("name") == REST and end.kind == kind
        parts += end.children if nested else [end]
        return Node(kind, (), tuple(parts))

    def _guard(self, element: Element, child: Node, abort: str, *, inverted: bool) -> Node:
        """Runs its child where a condition holds; inverted: succeeds there, else runs the child."""
        self._check_attributes(element, "ScriptCondition")
        for key, operator, number in reversed(self._conditions(element, alone=inverted)):
            if inverted:
                guard = Node(
                    "when",
                    (key, OPPOSITE[operator], number, abort),
                    (Node("inverter", (), (child,)),),
                )
                child = Node("inverter", (), (guard,))
            else:
                child = Node("when", (key, operator, number, abort), (child,))
        return child

    def _conditions(self, element: Element, *, alone: bool) -> list[tuple[str, str, float]]:
        code = element.attributes.get("code", "")
        try:
            return [
                read_condition(term, self._vocabulary)
                for term in ([code] if alone else code.split("&&"))
            ]
        except ValueError as error:
            self._fail(element, str(error))

    def _repeat(self, element: Element) -> Node:
        count = element.attributes.get("num_cycles", "")
        fewest, most = REPEATS
        if not (count.isdecimal() and fewest <= int(count) <= most):
            self._fail(element, f"expected num_cycles from {fewest} to {most}, found {count!r}")
        return Node("repeater", (int(count),), (self._node(self._only_child(element)),))

    def _parallel(self, element: Element) -> Node:
        children = self._children(element)
        policies = []
        for attribute, default in (("success_count", "-1"), ("failure_count", "1")):
            value = element.attributes.get(attribute, default)
            if value in ("-1", str(len(children))) and value != "1":
                policies.append("all")
            elif value == "1":
                policies.append("one")
            else:
                self._fail(
                    element,
                    f"expected {attribute} 1 or all {len(children)} (-1), found {value!r}:"
                    " a parallel here asks one child or all",
                )
        return Node("parallel", tuple(policies), tuple(map(self._node, children)))

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
        for attribute in element.attributes:
            if attribute not in ("name", "ID", *_ATTRIBUTES.get(tag, ())):
                self._fail(element, f"the language has nothing like {attribute!r} of {tag}")

    def _unknown(self, element: Element, tag: str) -> NoReturn:
        known = (*TAGS.values(), "SubTree", *self._vocabulary.actions)
        guess = closest(tag, known)
        hint = f"did you mean {guess}?" if guess else f"there are {', '.join(known)}"
        self._fail(element, f"the language has no node {tag!r}; {hint}")

    def _fail(self, element: Element, message: str) -> NoReturn:
        line, column = element.line, element.column
        raise TreeError(f"{self._name}:{line}:{column}: {message}", line=line, column=column)


def _tag(element: Element) -> str:
    return element.attributes.get("ID", "") if element.tag in _EXPLICIT else element.tag
