"""Reads BehaviorTree.CPP XML, version 4, with nodes that have an equivalent in the language.

The nodes of `nodes/islandgp_nodes.hpp` are those of the language. Of the library's
own, a condition at the front of a ReactiveSequence checks itself. Differences in
meaning are listed with their place; a node without an equivalent is an error.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import replace
from itertools import takewhile
from pathlib import Path
from typing import Final, NamedTuple

from islandgp.bt.analysis.context import without_interrupts
from islandgp.bt.core.condition import combine, opposite
from islandgp.bt.core.kinds import (
    ABORTS,
    COUNTED,
    KINDS,
    POLICIES,
    TARGETS,
    TIMED,
)
from islandgp.bt.core.language import parse, parse_condition
from islandgp.bt.core.node import (
    COUNTS,
    SECONDS,
    AlwaysArgs,
    CountArgs,
    Node,
    ParallelArgs,
    Policy,
    SecondsArgs,
    Value,
    commented,
    guarded,
    switch,
    walk,
)
from islandgp.bt.core.node_builder import MAX_TERMS
from islandgp.bt.core.parameters import fits, value_range
from islandgp.bt.core.printer import with_subtrees
from islandgp.bt.core.source import shown
from islandgp.bt.core.vocabulary import Vocabulary
from islandgp.bt.export.cpp_importer import (
    ALWAYS,
    GATES,
    TRUE,
    Difference,
    Importer,
    Reader,
    check,
    is_check,
    notes_of,
    unless,
)
from islandgp.bt.export.scripts import read_script, unquoted
from islandgp.bt.export.xml_reader import Element, read_xml

_BOARD: Final = re.compile(r"\{[A-Za-z_][A-Za-z0-9_]*\}")  # a port that names a blackboard entry
_NUMBER: Final = re.compile(r"[0-9]{1,9}(\.[0-9]{1,20})?")
NO_ELSE: Final = "no else"  # name of an AlwaysFailure in place of a third child
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
    """A composite; conditions in front of a sequence are a guard of what follows them."""
    base = "selector" if tag.endswith("Fallback") else "sequence"
    reactive = tag.startswith("Reactive")
    kind = f"reactive_{base}" if reactive else base
    if tag.startswith("Async"):
        importer.differs(element, "async")
    front = [*takewhile(is_check, element.children[:-1])] if base == "sequence" else []
    del front[MAX_TERMS:]
    tests = [importer.code(each) for each in front]
    nodes = importer.nodes(replace(element, children=element.children[len(front) :]))
    if not reactive:  # in that library, composites do not observe guards
        nodes = (*map(without_interrupts, nodes[:-1]), nodes[-1])
    if not front:
        return Node(kind, (), nodes)
    inner = without_interrupts(nodes[0] if len(nodes) == 1 else Node(kind, (), nodes))
    guard = guarded(combine("and", tests), inner, "self" if reactive else "none")
    return commented(guard, [line for each in front for line in notes_of(each)])


def _plain(importer: Importer, element: Element, tag: str) -> Node:
    """A node without arguments."""
    kind = "sequence" if tag == "SequenceWithMemory" else TARGETS[tag][0]
    if tag == "SequenceWithMemory":
        importer.differs(element, "memory")
    if tag == "RoundRobin" and element.attributes.pop("wrap_around", "") not in TRUE:
        importer.differs(element, "round")
    if kind == "if_else" and element.children[2:3]:
        is_none = element.children[2].attributes.get("name") == NO_ELSE
        element = replace(element, children=element.children[: 2 if is_none else None])
    children = importer.nodes(element, KINDS[kind].children)
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


def _count(importer: Importer, given: dict[str, str], port: str, default: str = "") -> float | str:
    """A whole number, or the key that a port names."""
    given[port] = importer.resolved(given.get(port, default))
    if _BOARD.fullmatch(given[port]):
        return given.pop(port)[1:-1]
    if "." in given[port]:
        raise ValueError(f"expected a whole number as {port}, found {shown(given[port])}")
    return int(_number(given, port, *COUNTS))


def _counted(importer: Importer, element: Element, tag: str) -> Node:
    kind, target = TARGETS[tag]
    port, given = target.ports[0], element.attributes
    endless = {"repeater": "until_failure", "retry": "until_success"}
    if kind == "recovery":
        args = CountArgs(_count(importer, given, port, "1"))
        return Node(kind, args, importer.nodes(element, (2, 2)))
    is_endless = given.get(port) == "-1" and given.pop(port)
    args = CountArgs(1) if is_endless else CountArgs(_count(importer, given, port))
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
    given, key = element.attributes, importer.resolved(element.attributes.get(port, ""))
    if unit == 1 and _BOARD.fullmatch(key) and given.pop(port):
        return Node(kind, SecondsArgs(key[1:-1]), (importer.child(element),))
    if unit != 1:
        importer.differs(element, "clock")
    seconds = _number(given, port, least * unit, most * unit) / unit
    child = ALWAYS["success"] if tag == "Sleep" else importer.child(element)
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
        given.pop(port, default)
        if given.get(port, default) in POLICIES
        else int(_number(given, port, *COUNTS))
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
    text = unquoted(importer.script(element, "condition"))
    expr = read_script(lambda: parse_condition(text, importer.vocabulary), text)
    return guarded(expr, importer.child(element), abort)


def _while_else(importer: Importer, element: Element, tag: str) -> Node:
    test, *nodes = map(without_interrupts, importer.nodes(element, (2, 3)))
    first = element.children[0]
    if is_check(first):
        condition = importer.code(first)
        if len(nodes) == 1:
            return guarded(condition, nodes[0], "self")
        return switch([condition], nodes)
    conditions = (importer.vocabulary.action(n.action).condition for n in walk(test) if n.action)
    inner = {node.kind for node in walk(test)} - {"action", "sequence", "selector", "inverter"}
    if inner or not all(conditions):
        importer.fail(first, f"expected a condition as the first child of {tag}")
    importer.differs(element, "order")
    if len(nodes) == 1:
        return Node("reactive_sequence", (), (test, nodes[0]))
    importer.differs(element, "twice")
    pairs = zip((_inverted(test), test), nodes, strict=True)
    return Node("reactive_sequence", (), tuple(Node("reactive_selector", (), p) for p in pairs))


def _inverted(node: Node) -> Node:
    """A node with success and failure exchanged."""
    return node.children[0] if node.kind == "inverter" else Node("inverter", (), (node,))


def _switch(importer: Importer, element: Element, tag: str) -> Node:
    """Guards of the cases, of which the last child has none."""
    given, tests = element.attributes, []
    variable = importer.resolved(given.pop("variable", "")).strip("{}")
    for i in range(int(tag[-1])):
        given["code"] = f"{variable} == {given.pop(f'case_{i + 1}', '')}"
        tests.append(importer.condition(element, "code"))
    if len(element.children) != len(tests) + 1:
        raise ValueError(f"expected {len(tests) + 1} children in <{tag}>")
    return switch(tests, [*map(without_interrupts, importer.nodes(element))])


def _precondition(importer: Importer, element: Element, tag: str) -> Node:
    """A Precondition, or a BlackboardCheck of version 3, which looks again in each tick."""
    given, watches = element.attributes, tag != "Precondition"
    if watches:
        left, right = (importer.resolved(given.pop(f"value_{side}", "")) for side in "AB")
        right = right.strip("{}") if right[:1] == "{" or tag[-6:] != "String" else f"'{right}'"
        given["code"] = f"{left.strip('{}')} == {right}"
    else:
        given["code"] = given.pop("if", "")
    status = given.pop("return_on_mismatch" if watches else "else", "FAILURE")
    test, child = importer.condition(element, "code"), without_interrupts(importer.child(element))
    if status == "RUNNING" and not watches:
        return Node("sequence", (), (Node("until_success", (), (check(test),)), child))
    if status not in ("SUCCESS", "FAILURE"):
        raise ValueError(f"expected SUCCESS or FAILURE as the other status, found {shown(status)}")
    return unless(opposite(test), child, status.lower(), watches=watches)


def _set(importer: Importer, element: Element, tag: str) -> Node:
    """A Script or a SetBlackboard."""
    given = element.attributes
    if tag == "SetBlackboard":
        name = given.pop("output_key", "").strip("{}")
        value = importer.resolved(given.pop("value", ""))
        key = importer.vocabulary.keys.get(importer.resolved(f"{{{name}}}")[1:-1])
        if value[:1] + value[-1:] == "{}":
            value = value[1:-1]
        elif key is not None and key.words:
            value = f"'{value}'"
        given["code"] = f"{name} := {value}"
    nodes = importer.assignments(element)
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
        text = importer.resolved(given.pop(port))
        if _BOARD.fullmatch(text) and vocabulary.gives(text[1:-1], parameter):
            values[port] = text
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
    kind, child = GATES[tag], importer.child(element)
    if kind == "inverter":
        loop = Node("recovery", CountArgs(COUNTS[1]), (_inverted(leaf), _inverted(child)))
        return _inverted(loop)
    args = CountArgs(COUNTS[1]) if kind == "recovery" else ()
    return Node(kind, args, (leaf if kind == "sequence" else _inverted(leaf), child))


def _reader(kind: str) -> Reader:
    """The reader of the nodes of the libraries for a kind."""
    if kind in COUNTED:
        return _counted
    return _timed if kind in TIMED else _plain


READERS: Final[Mapping[str, Reader]] = {
    **{tag: _reader(kind) for tag, (kind, _) in TARGETS.items()},
    **{
        f"{prefix}{base}": _composite
        for prefix in ("", "Reactive", "Async")
        for base in ("Sequence", "Fallback")
    },
    "SequenceWithMemory": _plain,
    "When": _when,
    "JudgedParallel": _judged,
    "Parallel": _parallel,
    "ParallelAll": _parallel,
    "RateController": _rate,
    "Sleep": _timed,
    "Script": _set,
    "SetBlackboard": _set,
    "ScriptCondition": lambda importer, element, _: check(importer.condition(element, "code")),
    "AlwaysSuccess": lambda *_: ALWAYS["success"],
    "AlwaysFailure": lambda *_: ALWAYS["failure"],
    "WhileDoElse": _while_else,
    "Precondition": _precondition,
    **{f"BlackboardCheck{sort}": _precondition for sort in ("Int", "Double", "String", "Bool")},
    **{f"Switch{n}": _switch for n in range(2, 7)},
    **dict.fromkeys(GATES, _gate),
    "SubTree": Importer.use,
    "Action": _action,
}
"""The readers by tag; the tags of actions are their names."""
