"""Reads BehaviorTree.CPP XML, version 4, with nodes that have an equivalent in the language.

The nodes of `nodes/islandgp_nodes.hpp` are those of the language. Of the library's
own, a condition at the front of a ReactiveSequence checks itself. Differences in
meaning are listed with their place; a node without an equivalent is an error.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Final, NamedTuple, NoReturn

from islandgp.bt.analysis.context import without_interrupts
from islandgp.bt.core.condition import ConditionExpr, terms
from islandgp.bt.core.kinds import ABORTS, KINDS, TARGETS
from islandgp.bt.core.language import MAX_CHARACTERS, parse, parse_condition
from islandgp.bt.core.node import AlwaysArgs, Node, SetArgs, Value, commented, guarded
from islandgp.bt.core.printer import with_subtrees
from islandgp.bt.core.source import closest, shown
from islandgp.bt.core.vocabulary import NAME, Vocabulary
from islandgp.bt.export.behaviortree_cpp import EQUAL, JUDGED, NOTES, REPEAT, REST
from islandgp.bt.export.branching import (
    ASKED,
    SKIPPED,
    SKIPS,
    TWICE,
    Test,
    answers_at_once,
    if_then_else,
    implies,
    only_if,
    switch,
    unless,
    while_do_else,
)
from islandgp.bt.export.nav2 import GATE, GATES, RATE, ROUND
from islandgp.bt.export.plan import CHECK, CLOCK, ORDER
from islandgp.bt.export.scripts import read_assignments, read_condition
from islandgp.bt.export.xml_reader import Element, read_xml
from islandgp.bt.export.xml_subtrees import Difference, SubtreeReader, notes_of, tag_of
from islandgp.bt.export.xml_values import (
    ALWAYS,
    COMMENTS,
    COUNTED,
    ENDLESS,
    MEMORY,
    PLAIN,
    THRESHOLDS,
    TIMED,
    WAITS,
    all_args,
    count_args,
    judged_args,
    parallel_args,
    period_args,
    port_value,
    seconds_args,
)
from islandgp.errors import TreeError

_BOARD: Final = re.compile(r"\{[A-Za-z_][A-Za-z0-9_]*\}")  # a port that names a blackboard entry
_ATTRIBUTES: Final = {
    "SubTree": (),
    **{target.tag: target.ports for target in (CHECK, *(t for _, t in TARGETS.values()))},
    "Parallel": ("success_count", "failure_count", *THRESHOLDS),
    "ParallelAll": ("max_failures",),
    "SetBlackboard": ("value", "output_key"),
    "Sleep": ("msec",),
    **{f"Switch{n}": ("variable", *(f"case_{i + 1}" for i in range(n))) for n in range(2, 7)},
}
_COMPOSITES: Final = {
    tag: "selector" if tag.endswith("Fallback") else "sequence"
    for tag in TARGETS
    if tag.endswith(("Fallback", "Sequence")) and tag != "PipelineSequence"
}
_SKIP_IN: Final = {
    "Sequence": implies, "ReactiveSequence": implies, "SequenceWithMemory": implies,
    "Fallback": only_if, "ReactiveFallback": only_if,
}  # fmt: skip
"""The replacement of a skipped node by its composite's tag: the node fails or succeeds."""

_SCRIPTS: Final = ("_onSuccess", "_onFailure", "_onHalted", "_post")
"""Attributes that write to the blackboard; others with _ in front are decoration of editors."""
_BRANCHING: Final = ("IfThenElse", "WhileDoElse", *(f"Switch{n}" for n in range(2, 7)))
_READ: Final = (
    *TARGETS, CHECK.tag, *PLAIN, *_BRANCHING, *ALWAYS, "ParallelAll", "Sleep", "SetBlackboard",
)  # fmt: skip


class Imported(NamedTuple):
    """A tree with the differences in meaning from the file, each kind once."""

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
        vocabulary: the valid actions and keys.
        name: of the file, in messages.
        tree: the ID of the tree; None: the file's main tree.
        folder: of the file; what it includes is there or below. None: it includes none.

    Raises:
        TreeError: the file is invalid, or has a node without an equivalent; the message has the
            place.
        LimitError: the tree is larger than any limit on trees could allow.
    """
    importer = _Importer(name, read_xml(text, name=name), vocabulary, folder)
    root = importer.tree(tree)
    # The text of the tree is parsed, as only the parser checks a whole tree.
    tree_text = with_subtrees(commented(root, notes_of(importer.root)))
    if len(tree_text) > MAX_CHARACTERS:
        importer.differs(importer.root, COMMENTS)
        tree_text = with_subtrees(root, comments=False)
    checked = parse(tree_text, vocabulary, name=f"{name}, as text")
    return Imported(checked, tuple(sorted(importer.differences.values())), tree_text)


class _Importer(SubtreeReader):
    """Reads the nodes of a file; the base class reads SubTrees."""

    def preconditions(self, element: Element, names: Sequence[str]) -> Node:
        """A node with the conditions that its attributes ask before it starts."""
        parent = self.state.parents[-1] if self.state.parents else ""
        rest = {k: v for k, v in element.attributes.items() if k not in names}
        node = without_interrupts(self.node(replace(element, attributes=rest)))
        for name in reversed(names):
            self.count(element, 2, 2)
            test: Test = self._condition(element, name)
            abort = "self" if name == "_while" else "none"
            if name in SKIPS:
                if parent not in _SKIP_IN:
                    self.fail(
                        element, f"{shown(name)} is imported only in a Sequence or a Fallback"
                    )
                self.differs(element, SKIPPED)
                test = test if name == "_while" else unless(test)
                node = _SKIP_IN[parent](test, node, abort)
            else:
                node = (only_if if name == "_failureIf" else implies)(unless(test), node, abort)
        return node

    def inside(self, element: Element, tag: str) -> Node:
        attributes = element.attributes
        if tag not in _READ and tag not in self.vocabulary.actions:
            self._unknown(element, tag)
        self.check_attributes(element, tag)
        if tag in ("Sequence", "Fallback"):
            return self._with_memory(element, self.children(element))
        if tag in ("ReactiveSequence", "ReactiveFallback"):
            return self._reactive(element, self.children(element))
        if tag in PLAIN:
            return self._plain(element, tag)
        if tag in _COMPOSITES:
            return Node(_COMPOSITES[tag], (), self.nodes_of(element))
        if tag in _BRANCHING:
            return self._branching(element, tag)
        if tag == "When":
            return self._own_guard(element)
        if tag == "JudgedParallel":
            return Node("parallel", judged_args(attributes), self.nodes_of(element))
        if tag in COUNTED:
            return self._repeat(element, tag)
        if tag in ("Script", "SetBlackboard"):
            return self._assignments(element, tag)
        if tag in ALWAYS:
            return Node("always", AlwaysArgs(ALWAYS[tag]))
        if tag in TIMED:
            kind, attribute, unit = TIMED[tag]
            if unit != 1:
                self.differs(element, CLOCK)
            args = seconds_args(attributes, attribute, unit)
            if tag == "Sleep":
                self.count(element, 1, 2)
                return Node(kind, args, (Node("always", AlwaysArgs("success")),))
            return Node(kind, args, (self.child(element),))
        if tag == "RateController":
            self.differs(element, CLOCK)
            if self.state.parents[-2:-1] != ["PipelineSequence"]:
                self.differs(element, RATE)
            return Node("every", period_args(attributes), (self.child(element),))
        if tag == "ParallelAll":
            children = self.children(element)
            policy = all_args(attributes, len(children))
            if policy.success != "all":
                self.differs(element, WAITS)
            return Node("parallel", policy, tuple(map(self.node, children)))
        if tag == "Parallel":
            children = self.children(element)
            if len(children) > 1:
                self.differs(element, JUDGED)
            policy = parallel_args(attributes, len(children))
            return Node("parallel", policy, tuple(map(self.node, children)))
        if tag == "ScriptCondition":
            expr = self._condition(element, "code")
            self.count(element, 1, 2)
            return guarded(expr, Node("always", AlwaysArgs("success")), "none")
        if tag in GATES:
            self.differs(element, GATE)
            composite, leaf = GATES[tag], self._leaf(element, tag)
            first = leaf if composite == "sequence" else Node("inverter", (), (leaf,))
            self.count(element, 2, 3)
            return Node(composite, (), (first, self.child(element)))
        if element.children:
            self.fail(element, f"expected no children of the action {tag}")
        return self._leaf(element, tag)

    def _plain(self, element: Element, tag: str) -> Node:
        """A node without arguments."""
        kind = PLAIN[tag]
        if tag == "RoundRobin" and element.attributes.get("wrap_around") not in ("true", "1"):
            self.differs(element, ROUND)
        if tag == "SequenceWithMemory":
            self.differs(element, MEMORY)
        one = KINDS[kind].decorates
        children = (self.child(element),) if one else self.nodes_of(element)
        match kind, children:  # exports have no node for these two
            case "until_failure", (Node("always", AlwaysArgs("success")),):
                return Node("always", AlwaysArgs("running"))
            case "inverter", (Node("until_failure", (), (Node("inverter", (), inside),)),):
                return Node("until_success", (), inside)
        return Node(kind, (), children)

    def _leaf(self, element: Element, tag: str) -> Node:
        """A leaf; the values of its ports are arguments."""
        parameters = self.vocabulary.action(tag).arguments
        values: dict[str, Value] = {}
        for port, text in element.attributes.items():
            if port in parameters:
                if _BOARD.fullmatch(text):
                    key = self.keys.get(text[1:-1], text[1:-1])
                    if self.vocabulary.gives(key, parameters[port]):
                        self.state.asks = True
                        values[port] = f"{{{key}}}"
                        continue
                values[port] = port_value(port, text, parameters[port])
        return self.vocabulary.leaf(tag, values)

    def _branching(self, element: Element, tag: str) -> Node:
        """An IfThenElse, a WhileDoElse or a Switch."""
        children = element.children
        self.count(element, 4 * len(children), 6)
        if tag.startswith("Switch"):
            cases = [self._case(element, i) for i in range(1, int(tag[-1]) + 1)]
            if len(children) != len(cases) + 1:
                self.fail(element, f"expected {len(cases) + 1} children in <{tag}>")
            return switch(cases, [without_interrupts(self.node(child)) for child in children])
        if not 2 <= len(children) <= 3:
            self.fail(element, f"expected two or three children in <{tag}>")
        first, *rest = children
        test: Test
        if tag_of(first) == "ScriptCondition":
            self.check_attributes(first, "ScriptCondition")
            test = self._condition(first, "code")
        else:
            test = self.node(first)
            if not answers_at_once(test, self.vocabulary):
                self.fail(first, f"expected a condition as the first child of {tag}")
            if len(rest) > 1:
                self.differs(element, TWICE)
        nodes = [without_interrupts(self.node(child)) for child in rest]
        if tag == "WhileDoElse":
            if isinstance(test, Node):
                self.differs(element, ORDER)
            return while_do_else(test, nodes)
        if len(rest) > 1:
            self.differs(element, ASKED)
        return if_then_else(test, nodes)

    def _case(self, element: Element, number: int) -> ConditionExpr:
        """The condition of a case of a Switch: its variable has the case's value."""
        attributes = element.attributes
        variable = attributes.get("variable", "").strip("{}")
        code = f"{variable} == {attributes.get(f'case_{number}', '')}"
        return self._condition(replace(element, attributes={"code": code}), "code")

    def _condition(self, element: Element, attribute: str) -> ConditionExpr:
        """The condition that an attribute asks in the library's script language."""
        self.state.asks = True
        try:
            expr = read_condition(self._condition_text(element, attribute), self.vocabulary)
        except ValueError as error:
            self.fail(element, str(error))
        if any(term.operator in ("==", "!=") for term in terms(expr)):
            self.differs(element, EQUAL)
        return expr

    def _assignments(self, element: Element, tag: str) -> Node:
        """A Script or a SetBlackboard."""
        self.state.asks = True
        code = self._condition_text(element, "code")
        if tag == "SetBlackboard":
            name = element.attributes.get("output_key", "").strip("{}")
            name, value = self.keys.get(name, name), element.attributes.get("value", "")
            key = self.vocabulary.keys.get(name)
            if value[:1] + value[-1:] == "{}":
                value = self.keys.get(value[1:-1], value[1:-1])
            elif key is not None and key.words:
                value = f"'{value}'"
            code = f"{name} := {value}"
        try:
            assigned = read_assignments(code, self.vocabulary)
        except ValueError as error:
            self.fail(element, str(error))
        self.count(element, len(assigned) - 1, 2 if len(assigned) > 1 else 1)
        nodes = tuple(Node("set", SetArgs(each)) for each in assigned)
        return nodes[0] if len(nodes) == 1 else Node("sequence", (), nodes)

    def _with_memory(self, element: Element, elements: Sequence[Element]) -> Node:
        """A composite with memory: a condition guards all later children."""
        kind = _COMPOSITES[tag_of(element)]
        parts: list[Node] = []
        for index, each in enumerate(elements[:-1]):
            if tag_of(each) == "ScriptCondition":
                parts.append(self._guarding(each, element, elements[index + 1 :], "none"))
                break
            # In that library composites do not observe the guards of this branch.
            parts.append(without_interrupts(self.node(each)))
        else:
            last = elements[-1]
            node = self.node(last)
            is_nested_run = last.attributes.get("name") == REST and node.kind == kind
            # Our own export nests the rest of a composite in one of the same kind.
            parts += node.children if is_nested_run and parts else (node,)
        return parts[0] if len(parts) == 1 and len(elements) > 1 else Node(kind, (), tuple(parts))

    def _reactive(self, element: Element, elements: Sequence[Element]) -> Node:
        """A condition at the front guards the rest and checks itself."""
        first, *rest = elements
        if tag_of(first) == "ScriptCondition" and rest:
            return self._guarding(first, element, rest, "self")
        return Node(f"reactive_{_COMPOSITES[tag_of(element)]}", (), tuple(map(self.node, elements)))

    def _guarding(
        self, condition: Element, element: Element, behind: Sequence[Element], abort: str
    ) -> Node:
        """A condition in a composite, as the guard of all later children."""
        inverted = _COMPOSITES[tag_of(element)] == "selector"
        self.count(condition, 1, 1)
        self.state.level += 1
        if len(behind) == 1:
            inner = self.node(behind[0])
        elif abort == "none":
            inner = self._with_memory(element, behind)
        else:
            inner = self._reactive(element, behind)
        self.state.level -= 1
        self.check_attributes(condition, "ScriptCondition")
        expr = self._condition(condition, "code")
        # In that library no composite observes a guard behind a condition.
        inner = without_interrupts(inner)
        guard = implies(unless(expr), inner, abort) if inverted else guarded(expr, inner, abort)
        return commented(guard, notes_of(condition))

    def _condition_text(self, element: Element, attribute: str) -> str:
        """A condition's text with the keys of the blackboard."""
        text = element.attributes.get(attribute, "")
        return NAME.sub(lambda word: self.keys.get(word[0], word[0]), text)

    def _own_guard(self, element: Element) -> Node:
        self.state.asks = True
        abort = element.attributes.get("abort", "both")
        if abort not in ABORTS:
            self.fail(
                element, f"expected abort {', '.join(ABORTS)}, found {shown(abort)}; choose one"
            )
        # Words of keys have quotes there.
        text = re.sub(r"'(\w+)'", r"\1", self._condition_text(element, "condition"))
        try:
            expr = parse_condition(text, self.vocabulary)
        except TreeError as error:
            lines = [line.strip() for line in str(error).splitlines()]
            self.fail(element, "; ".join(["in the condition, place " + lines[0], *lines[3:]]))
        return guarded(expr, self.child(element), abort)

    def _repeat(self, element: Element, tag: str) -> Node:
        kind, attribute = COUNTED[tag]
        if kind in ENDLESS and element.attributes.get(attribute) == "-1":
            self.differs(element, REPEAT)
            return Node(ENDLESS[kind], (), (self.child(element),))
        args = count_args(element.attributes, attribute, "1" if kind == "recovery" else "")
        if kind == "recovery":
            if len(element.children) != 2:
                self.fail(element, f"expected two children, found {len(element.children)}")
            return Node(kind, args, self.nodes_of(element))
        if not tag.endswith("PerTick") and args.times != 1:
            self.differs(element, REPEAT)
        return Node(kind, args, (self.child(element),))

    def check_attributes(self, element: Element, tag: str) -> None:
        for attribute, value in element.attributes.items():
            if attribute in NOTES or (attribute[0] == "_" and attribute not in _SCRIPTS):
                continue
            if (tag == "Parallel" and attribute in THRESHOLDS) or (
                tag == "SubTree" and value[:1] + value[-1:] == "{}"
            ):
                continue
            ports = self.vocabulary.action(tag).arguments
            if attribute not in ("ID", *ports, *_ATTRIBUTES.get(tag, ())):
                self.fail(element, f"the language has no equivalent of {shown(attribute)} of {tag}")

    def _unknown(self, element: Element, tag: str) -> NoReturn:
        if tag == "UnsetBlackboard":
            self.fail(element, f"the language has no node {shown(tag)}; set another value")
        tags = dict.fromkeys((*_READ, "SubTree", *self.vocabulary.actions))
        guess = closest(tag, tags)
        hint = f"did you mean {guess}?" if guess else f"known nodes: {', '.join(tags)}"
        self.fail(element, f"the language has no node {shown(tag)}; {hint}")
