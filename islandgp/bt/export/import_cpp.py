"""Reads BehaviorTree.CPP XML, version 4, with nodes that have an equivalent in the language.

The nodes of `nodes/islandgp_nodes.hpp` are those of the language. Of the library's
own, a condition at the front of a ReactiveSequence checks itself. Differences in
meaning are listed with their place; a node without an equivalent is an error.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Final, NamedTuple

from islandgp.bt.analysis.context import without_interrupts
from islandgp.bt.core.kinds import (
    ABORTS,
    COUNTED,
    COUNTS,
    KINDS,
    POLICIES,
    SECONDS,
    TARGETS,
    TIMED,
)
from islandgp.bt.core.language import MAX_LEVELS, parse, parse_condition
from islandgp.bt.core.node import (
    AlwaysArgs,
    CountArgs,
    Node,
    ParallelArgs,
    Policy,
    SecondsArgs,
    SetArgs,
    Value,
    commented,
    guarded,
)
from islandgp.bt.core.parameters import fits, value_range
from islandgp.bt.core.printer import with_subtrees
from islandgp.bt.core.source import shown
from islandgp.bt.core.vocabulary import Vocabulary
from islandgp.bt.export.cpp_importer import (
    GATES,
    TRUE,
    Difference,
    Importer,
    Reader,
    Test,
    answers_at_once,
    if_else,
    implies,
    inverted,
    is_check,
    notes_of,
    unless,
)
from islandgp.bt.export.scripts import read_assignments, read_script
from islandgp.bt.export.xml_reader import Element, read_xml

_BOARD: Final = re.compile(r"\{[A-Za-z_][A-Za-z0-9_]*\}")  # a port that names a blackboard entry
_NUMBER: Final = re.compile(r"[0-9]{1,9}(\.[0-9]{1,20})?")
_FLAGS: Final = {"true": "yes", "1": "yes", "false": "no", "0": "no"}


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
    importer = Importer(READERS, name, read_xml(text, name=name), vocabulary, folder)
    root = importer.tree(tree)
    # The text of the tree is parsed, as only the parser checks a whole tree.
    tree_text = with_subtrees(commented(root, notes_of(importer.root)))
    checked = parse(tree_text, vocabulary, name=f"{name}, as text")
    return Imported(checked, tuple(sorted(importer.differences.values())), tree_text)


# The readers of nodes, by tag. Each takes the attributes that it knows from the element.


def _composite(importer: Importer, element: Element, tag: str) -> Node:
    """A condition in a composite guards all later children; of a reactive one, only in front."""
    reactive = tag.startswith("Reactive")
    base = "selector" if tag.endswith("Fallback") else "sequence"
    kind, abort = (f"reactive_{base}", "self") if reactive else (base, "none")
    parts: list[Test] = []
    for each in element.children[:-1]:
        guards = not reactive or not any(isinstance(part, Node) for part in parts)
        if is_check(each) and guards:
            if sum(not isinstance(part, Node) for part in parts) >= MAX_LEVELS:
                raise importer.too_large(each)
            parts.append(importer.code(each))
        else:
            node = importer.node(each)
            # In that library composites do not observe the guards of this branch.
            parts.append(node if reactive else without_interrupts(node))
    *_, last = importer.nodes(replace(element, children=element.children[-1:]))
    nodes = [last]
    for each, part in zip(element.children[-2::-1], reversed(parts), strict=True):
        if isinstance(part, Node):
            nodes.insert(0, part)
            continue
        # In that library no composite observes a guard behind a condition.
        inner = nodes[0] if len(nodes) == 1 else Node(kind, (), tuple(nodes))
        inner = without_interrupts(inner)
        inverted = base == "selector"
        guard = implies(unless(part), inner, abort) if inverted else guarded(part, inner, abort)
        nodes = [importer.sized(each, commented(guard, notes_of(each)))]
    return nodes[0] if len(nodes) == 1 < len(element.children) else Node(kind, (), tuple(nodes))


def _plain(importer: Importer, element: Element, tag: str) -> Node:
    """A node without arguments."""
    kind = "sequence" if tag == "SequenceWithMemory" else TARGETS[tag][0]
    if tag == "SequenceWithMemory":
        importer.differs(element, "memory")
    if tag == "RoundRobin" and element.attributes.pop("wrap_around", "") not in TRUE:
        importer.differs(element, "round")
    one = KINDS[kind].decorates
    children = (importer.child(element),) if one else importer.nodes(element)
    match kind, children:  # exports have no node for these two
        case "until_failure", (Node("always", AlwaysArgs("success")),):
            return Node("always", AlwaysArgs("running"))
        case "inverter", (Node("until_failure", (), (Node("inverter", (), inside),)),):
            return Node("until_success", (), inside)
    return Node(kind, (), children)


def _number(given: dict[str, str], port: str, low: float, high: float, default: str = "") -> float:
    text = given.pop(port, default)
    number = float(text) if _NUMBER.fullmatch(text) else -1.0
    if not low <= number <= high:
        raise ValueError(f"expected {port} from {low:.6g} to {high:,}, found {shown(text)}")
    return number


def _whole(given: dict[str, str], port: str, default: str = "") -> int:
    if "." in given.get(port, ""):
        raise ValueError(f"expected a whole number as {port}, found {shown(given[port])}")
    return int(_number(given, port, *COUNTS, default))


def _counted(importer: Importer, element: Element, tag: str) -> Node:
    kind, target = TARGETS[tag]
    port, given = target.ports[0], element.attributes
    endless = {"repeater": "until_failure", "retry": "until_success"}
    if kind == "recovery":
        args = CountArgs(_whole(given, port, "1"))
        children = importer.nodes(element)
        if len(children) != 2:
            raise ValueError(f"expected two children, found {len(children)}")
        return Node(kind, args, children)
    is_endless = given.get(port) == "-1" and given.pop(port)
    args = CountArgs(1) if is_endless else CountArgs(_whole(given, port))
    if is_endless or (target.category == "" and args.times != 1):
        importer.differs(element, "repeat")
    child = importer.child(element)
    return Node(endless[kind], (), (child,)) if is_endless else Node(kind, args, (child,))


def _timed(importer: Importer, element: Element, tag: str) -> Node:
    least, most = SECONDS
    if tag == "Sleep":
        kind, port, unit = "wait", "msec", 1000
    else:
        kind, target = TARGETS[tag]
        port, unit = target.ports[0], 1 if target.category else 1000
    if unit != 1:
        importer.differs(element, "clock")
    seconds = _number(element.attributes, port, least * unit, most * unit) / unit
    child = Node("always", AlwaysArgs("success")) if tag == "Sleep" else importer.child(element)
    return Node(kind, SecondsArgs(seconds), (child,))


def _rate(importer: Importer, element: Element, _: str) -> Node:
    importer.differs(element, "clock")
    if importer.above[-2:-1] != ["PipelineSequence"]:
        importer.differs(element, "rate")
    least, most = SECONDS
    hz = _number(element.attributes, "hz", 1 / most, 1 / least, "10")
    return Node("every", SecondsArgs(round(1 / hz, 6)), (importer.child(element),))


def _judged(importer: Importer, element: Element, _: str) -> Node:
    given = element.attributes
    policies: list[Policy] = [
        given.pop(port, default) if given.get(port, default) in POLICIES else _whole(given, port)
        for port, default in (("success", "all"), ("failure", "one"))
    ]
    return Node("parallel", ParallelArgs(*policies), importer.nodes(element))


def _parallel(importer: Importer, element: Element, tag: str) -> Node:
    """A Parallel, which fails when it can no longer succeed, or a ParallelAll."""
    count, given = len(element.children), element.attributes
    if tag == "ParallelAll":
        failure = _threshold(given, ("max_failures",), "1", count)
        if failure > 1:
            importer.differs(element, "waits")
        success, fails = count - failure + 1, count
    else:
        ports = ("success_count", "success_threshold", "threshold")
        success = _threshold(given, ports, "-1", count)
        fails = _threshold(given, ("failure_count", "failure_threshold"), "1", count)
        fails = min(fails, count - success + 1)
        if count > 1:
            importer.differs(element, "judged")
    words: dict[int, Policy] = {count: "all", 1: "one"}
    succeeds: Policy = "all" if success == count else words.get(success, success)
    fail: Policy = "all" if tag == "ParallelAll" else words.get(fails, fails)
    return Node("parallel", ParallelArgs(succeeds, fail), importer.nodes(element))


def _threshold(given: dict[str, str], ports: Sequence[str], default: str, count: int) -> int:
    """A number of children; -1 is all of them. Version 3 has other ports."""
    values = [given.pop(port) for port in ports if port in given] or [default]
    number = int(values[0]) if re.fullmatch(r"-?[0-9]{1,4}", values[0]) else 0
    number = count + number + 1 if number < 0 else number
    if count and not 1 <= number <= count:
        raise ValueError(f"expected {ports[0]} 1 to {count}, or -1, found {shown(values[0])}")
    return number


def _when(importer: Importer, element: Element, _: str) -> Node:
    abort = element.attributes.pop("abort", "both")
    if abort not in ABORTS:
        raise ValueError(f"expected abort {', '.join(ABORTS)}, found {shown(abort)}; choose one")
    # Words of keys have quotes there.
    text = re.sub(r"'(\w+)'", r"\1", importer.script(element, "condition"))
    expr = read_script(lambda: parse_condition(text, importer.vocabulary), text)
    return guarded(expr, importer.child(element), abort)


def _check(importer: Importer, element: Element, _: str) -> Node:
    always = Node("always", AlwaysArgs("success"))
    return guarded(importer.condition(element, "code"), always, "none")


def _always(importer: Importer, element: Element, tag: str) -> Node:  # noqa: ARG001
    return Node("always", AlwaysArgs(tag.removeprefix("Always").lower()))


def _branching(importer: Importer, element: Element, tag: str) -> Node:
    """An IfThenElse or a WhileDoElse."""
    if not 2 <= len(element.children) <= 3:
        raise ValueError(f"expected two or three children in <{tag}>")
    first, *rest = element.children
    test: Test
    if is_check(first):
        test = importer.code(first)
    else:
        test = importer.node(first)
        if not answers_at_once(test, importer.vocabulary):
            importer.fail(first, f"expected a condition as the first child of {tag}")
        if len(rest) > 1:
            importer.differs(element, "twice")
    nodes = [without_interrupts(importer.node(child)) for child in rest]
    if tag == "IfThenElse":
        if len(rest) > 1:
            importer.differs(element, "asked")
        return if_else(test, nodes, "none")
    if isinstance(test, Node):
        importer.differs(element, "order")
    return if_else(test, nodes, "self")


def _switch(importer: Importer, element: Element, tag: str) -> Node:
    """A tree that runs the child of the first case that holds, else the last child."""
    variable = element.attributes.pop("variable", "").strip("{}")
    cases = [
        importer.condition(replace(element, attributes={"code": f"{variable} == {value}"}), "code")
        for i in range(int(tag[-1]))
        for value in [element.attributes.pop(f"case_{i + 1}", "")]
    ]
    if len(element.children) != len(cases) + 1:
        raise ValueError(f"expected {len(cases) + 1} children in <{tag}>")
    *branches, node = (without_interrupts(child) for child in importer.nodes(element))
    for case, branch in zip(reversed(cases), reversed(branches), strict=True):
        node = if_else(case, (branch, node), "self")
    return node


def _set(importer: Importer, element: Element, tag: str) -> Node:
    """A Script or a SetBlackboard."""
    code = importer.script(element, "code")
    if tag == "SetBlackboard":
        name = importer.key(element.attributes.pop("output_key", ""))
        value = element.attributes.pop("value", "")
        key = importer.vocabulary.keys.get(name)
        if value[:1] + value[-1:] == "{}":
            value = importer.key(value)
        elif key is not None and key.words:
            value = f"'{value}'"
        code = f"{name} := {value}"
    assigned = read_assignments(code, importer.vocabulary)
    nodes = tuple(Node("set", SetArgs(each)) for each in assigned)
    return nodes[0] if len(nodes) == 1 else Node("sequence", (), nodes)


def _action(importer: Importer, element: Element, tag: str) -> Node:
    """A leaf; the values of its ports are arguments."""
    if element.children:
        raise ValueError(f"expected no children of the action {tag}")
    vocabulary, given = importer.vocabulary, element.attributes
    values: dict[str, Value] = {}
    for port, parameter in vocabulary.action(tag).arguments.items():
        if port not in given:
            continue
        text = given.pop(port)
        key = importer.key(text)
        if _BOARD.fullmatch(text) and vocabulary.gives(key, parameter):
            values[port] = f"{{{key}}}"
            continue
        values[port] = _FLAGS.get(text, text) if parameter.sort == "flag" else text
        if parameter.numeric and _NUMBER.fullmatch(text.removeprefix("-")):
            values[port] = float(text)
        if not fits(parameter, values[port]):
            raise ValueError(f"expected {port} of {value_range(parameter)}, found {shown(text)}")
    return vocabulary.leaf(tag, values)


def _gate(importer: Importer, element: Element, tag: str) -> Node:
    if tag not in importer.vocabulary.actions:
        raise ValueError(f"expected the node {tag} in the vocabulary, as a leaf")
    importer.differs(element, "gate")
    leaf = _action(importer, replace(element, children=[]), tag)
    first = leaf if GATES[tag] == "sequence" else inverted(leaf)
    return Node(GATES[tag], (), (first, importer.child(element)))


def _reader(kind: str) -> Reader:
    """The reader of the nodes of the libraries for a kind."""
    if kind in COUNTED:
        return _counted
    return _timed if kind in TIMED else _plain


READERS: Final[Mapping[str, Reader]] = {
    **{tag: _reader(kind) for tag, (kind, _) in TARGETS.items()},
    **dict.fromkeys(("Sequence", "Fallback", "ReactiveSequence", "ReactiveFallback"), _composite),
    "SequenceWithMemory": _plain,
    "When": _when,
    "JudgedParallel": _judged,
    "Parallel": _parallel,
    "ParallelAll": _parallel,
    "RateController": _rate,
    "Sleep": _timed,
    "Script": _set,
    "SetBlackboard": _set,
    "ScriptCondition": _check,
    "AlwaysSuccess": _always,
    "AlwaysFailure": _always,
    "IfThenElse": _branching,
    "WhileDoElse": _branching,
    **{f"Switch{n}": _switch for n in range(2, 7)},
    **dict.fromkeys(GATES, _gate),
    "SubTree": Importer.use,
    "Action": _action,
}
"""The readers by tag; the tags of actions are their names."""
