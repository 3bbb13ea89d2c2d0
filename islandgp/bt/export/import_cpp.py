"""Reads BehaviorTree.CPP XML, version 4, with nodes that have an equivalent in the language.

The nodes of `nodes/islandgp_nodes.hpp` are those of the language. Of the library's
own, a condition at the front of a ReactiveSequence checks itself. Differences in
meaning are listed with their place; a node without an equivalent is an error.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import replace
from itertools import takewhile
from operator import itemgetter
from pathlib import Path
from typing import Any, Final, NamedTuple

from islandgp.bt.analysis.context import without_interrupts
from islandgp.bt.core.condition import combine, opposite
from islandgp.bt.core.kind import Argument, Sort
from islandgp.bt.core.kinds import KINDS, TARGETS
from islandgp.bt.core.language import parse
from islandgp.bt.core.node import (
    SECONDS,
    AlwaysArgs,
    Args,
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
    Importer,
    Reader,
    check,
    filled,
    is_check,
    literal,
    notes_of,
    unless,
)
from islandgp.bt.export.scripts import read_when
from islandgp.bt.export.xml_reader import Element, read_xml
from islandgp.errors import TreeError

_BOARD: Final = re.compile(r"\{[A-Za-z_][A-Za-z0-9_]*\}")  # a port that names a blackboard entry
_NUMBER: Final = re.compile(r"[0-9]{1,9}(\.[0-9]{1,20})?")
CLOCKED: Final = {"Sleep": "msec", "Delay": "delay_msec", "Timeout": "msec", "RateController": "hz"}
"""The ports of nodes that measure time by the computer's clock."""
_BOTH: Final = (
    "reactive_sequence {"
    " reactive_selector { inverter { TEST } THEN } reactive_selector { TEST ELSE } }"
)
"""A WhileDoElse whose first child is a leaf."""
NO_ELSE: Final = "no else"  # name of an AlwaysFailure in place of a third child
_DEFAULTS: Final = {"number_of_retries": "1"}  # of a RecoveryNode
_FLAGS: Final = {"true": "yes", "1": "yes", "false": "no", "0": "no"}


class Imported(NamedTuple):
    """A tree with the differences in meaning from the file, each kind once."""

    tree: Node
    differences: Mapping[str, tuple[int, int]]
    """Those of DIFFERENCES, in the order of the file, with their first line and column."""
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
    importer = Importer(READERS, read_xml(text, name=name), vocabulary, folder)
    root = importer.tree(tree)
    # The text of the tree is parsed, as only the parser checks a whole tree.
    tree_text = with_subtrees(commented(root, notes_of(importer.root)))
    checked = parse(tree_text, vocabulary, name=f"{name}, as text")
    places = sorted(importer.differences.items(), key=itemgetter(1))
    return Imported(checked, dict(places), tree_text)


def args_of(root: Element, leaves: Vocabulary, folder: Path | None = None) -> list[Args]:
    """What the trees of a file ask of keys whose types are not known, and set them to.

    A tree that cannot be read counts up to its error. Arguments as in `read_tree`.
    """
    trees = [each.attributes.get("ID", "") for each in root.children if each.tag == "BehaviorTree"]
    if not trees:
        return []
    importer = Importer(READERS, root, leaves, folder, any_key=True)
    for identity in trees:
        with suppress(TreeError):
            importer.tree(identity)
    return importer.used


# The readers of nodes, by tag. Each takes the attributes that it knows from the element.


def _composite(importer: Importer, element: Element, tag: str) -> Node:
    """A composite; conditions in front of a sequence are a guard of what follows them."""
    base = "selector" if tag.endswith("Fallback") else "sequence"
    reactive = tag.startswith("Reactive")
    kind = f"reactive_{base}" if reactive else base
    front = [*takewhile(is_check, element.children[:-1])] if base == "sequence" else []
    del front[MAX_TERMS:]
    tests = [importer.condition(each, each.attributes.get("code", "")) for each in front]
    nodes = importer.nodes(replace(element, children=element.children[len(front) :]))
    if not reactive:  # in that library, composites do not observe guards
        nodes = (*map(without_interrupts, nodes[:-1]), nodes[-1])
    if not front:
        return Node(kind, (), nodes)
    inner = without_interrupts(nodes[0] if len(nodes) == 1 else Node(kind, (), nodes))
    guard = guarded(combine("and", tests), inner, "self" if reactive else "none")
    return commented(guard, [line for each in front for line in notes_of(each)])


def _by_ports(importer: Importer, element: Element, tag: str) -> Node:
    """A node whose ports are the arguments of its kind."""
    name, target = TARGETS[tag]
    kind = KINDS[name]
    pairs = zip(target.ports, kind.arguments, strict=False)
    args = kind.args(*(_value(importer, element, port, each) for port, each in pairs))
    importer.used.append(args)
    return Node(name, args, importer.nodes(element, kind.children))


def _value(importer: Importer, element: Element, port: str, argument: Argument) -> Any:
    """The value of an argument: a condition, a word, a number or a key."""
    default = argument.default or _DEFAULTS.get(port, "")
    text = importer.resolved(element.attributes.pop(port, default))
    if argument.sort is Sort.CONDITION:
        return importer.read(element, read_when, text)
    if text in argument.words:
        return text
    if argument.sort is Sort.WORD:
        words = ", ".join(argument.words)
        raise ValueError(f"expected {port} {words}, found {shown(text)}; choose one")
    if _BOARD.fullmatch(text) and argument.sort is not Sort.POLICY:
        return text[1:-1]
    if "." in text and argument.sort is not Sort.SECONDS:
        raise ValueError(f"expected a whole number as {port}, found {shown(text)}")
    number = _number(text, port, *argument.range)
    return number if argument.sort is Sort.SECONDS else int(number)


def _number(text: str, port: str, low: float, high: float) -> float:
    number = float(text) if _NUMBER.fullmatch(text) else -1.0
    if not low <= number <= high:
        raise ValueError(f"expected {port} from {low:.6g} to {high:,}, found {shown(text)}")
    return number


def _round_robin(importer: Importer, element: Element, _: str) -> Node:
    if element.attributes.pop("wrap_around", "") not in TRUE:
        importer.differs(element, "round")
    return Node("round_robin", (), importer.nodes(element))


def _if_else(importer: Importer, element: Element, tag: str) -> Node:
    last = element.children[2:3]
    is_none = last and last[0].attributes.get("name") == NO_ELSE
    children = element.children[: 2 if is_none else None]
    return _by_ports(importer, replace(element, children=children), tag)


def _loop(importer: Importer, element: Element, tag: str) -> Node:
    """An Inverter or a KeepRunningUntilFailure; exports write two kinds by several of these."""
    match node := _by_ports(importer, element, tag):
        case Node("until_failure", _, (Node("always", AlwaysArgs("success")),)):
            return Node("always", AlwaysArgs("running"))
        case Node("inverter", _, (Node("until_failure", _, (Node("inverter", _, inside),)),)):
            return Node("until_success", (), inside)
    return node


def _repeat(importer: Importer, element: Element, tag: str) -> Node:
    """A Repeat or RetryUntilSuccessful."""
    (port,) = TARGETS[tag][1].ports
    if importer.resolved(element.attributes.get(port, "")) != "1":
        importer.differs(element, "repeat")
    if element.attributes.get(port) != "-1":
        return _by_ports(importer, element, tag)
    del element.attributes[port]
    kind = {"Repeat": "until_failure"}.get(tag, "until_success")
    return Node(kind, (), (importer.child(element),))


def _clocked(importer: Importer, element: Element, tag: str) -> Node:
    """A node that measures time by the computer's clock."""
    port, given, (least, most) = CLOCKED[tag], element.attributes, SECONDS
    if tag == "RateController":
        if importer.above[-2:-1] != ["PipelineSequence"]:
            importer.differs(element, "rate")
        seconds = round(1 / _number(given.pop(port, "10"), port, 1 / most, 1 / least), 6)
    else:
        seconds = _number(given.pop(port, ""), port, least * 1000, most * 1000) / 1000
    child = ALWAYS["success"] if tag == "Sleep" else importer.child(element)
    kind = "wait" if tag == "Sleep" else TARGETS[tag][0]
    return Node(kind, SecondsArgs(seconds), (child,))


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


def _while_else(importer: Importer, element: Element, tag: str) -> Node:
    test, *nodes = map(without_interrupts, importer.nodes(element, (2, 3)))
    first = element.children[0]
    if is_check(first):
        condition = importer.condition(first, first.attributes.get("code", ""))
        if len(nodes) == 1:
            return guarded(condition, nodes[0], "self")
        return switch([condition], nodes)
    conditions = (importer.vocabulary.action(n.action).condition for n in walk(test) if n.action)
    inner = {node.kind for node in walk(test)} - {"action", "sequence", "selector", "inverter"}
    if inner or not all(conditions):
        raise first.error(f"expected a condition as the first child of {tag}")
    importer.differs(element, "order")
    if len(nodes) == 1:
        return Node("reactive_sequence", (), (test, nodes[0]))
    importer.differs(element, "twice")
    return filled(_BOTH, TEST=test, THEN=nodes[0], ELSE=nodes[1])


def _switch(importer: Importer, element: Element, tag: str) -> Node:
    """Guards of the cases, of which the last child has none."""
    given, tests = element.attributes, []
    variable = given.pop("variable", "").strip("{}")
    for i in range(int(tag[-1])):
        case = literal(given.pop(f"case_{i + 1}", ""))
        tests.append(importer.condition(element, f"{variable} == {case}"))
    if len(element.children) != len(tests) + 1:
        raise ValueError(f"expected {len(tests) + 1} children in <{tag}>")
    return switch(tests, [*map(without_interrupts, importer.nodes(element))])


def _precondition(importer: Importer, element: Element, tag: str) -> Node:
    """A Precondition, or a BlackboardCheck of version 3, which looks again in each tick."""
    given, watches = element.attributes, tag != "Precondition"
    if watches:
        left, right = (given.pop(f"value_{side}", "") for side in "AB")
        code = f"{left.strip('{}')} == {literal(right)}"
    else:
        code = given.pop("if", "")
    status = given.pop("return_on_mismatch" if watches else "else", "FAILURE")
    test, child = importer.condition(element, code), without_interrupts(importer.child(element))
    if status == "RUNNING" and not watches:
        return filled("sequence { until_success { CHECK } CHILD }", CHECK=check(test), CHILD=child)
    if status not in ("SUCCESS", "FAILURE"):
        raise ValueError(f"expected SUCCESS or FAILURE as the other status, found {shown(status)}")
    return unless(opposite(test), child, status.lower(), watches=watches)


def _set(importer: Importer, element: Element, tag: str) -> Node:
    """A Script or a SetBlackboard."""
    given = element.attributes
    if tag == "SetBlackboard":
        name = given.pop("output_key", "").strip("{}")
        given["code"] = f"{name} := {literal(given.pop('value', ''))}"
    return importer.assignments(element, given.pop("code", ""))


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
    leaf = _action(importer, replace(element, children=[]), tag)
    return filled(GATES[tag], LEAF=leaf, CHILD=importer.child(element))


def _check(importer: Importer, element: Element, _: str) -> Node:
    return check(importer.condition(element, element.attributes.pop("code", "")))


READERS: Final[Mapping[str, Reader]] = {
    **dict.fromkeys(TARGETS, _by_ports),
    **{
        f"{prefix}{base}": _composite
        for prefix in ("", "Reactive", "Async")
        for base in ("Sequence", "Fallback")
    },
    **dict.fromkeys(CLOCKED, _clocked),
    "Inverter": _loop,
    "KeepRunningUntilFailure": _loop,
    "Repeat": _repeat,
    "RetryUntilSuccessful": _repeat,
    "RoundRobin": _round_robin,
    "IfThenElse": _if_else,
    "SequenceWithMemory": _composite,
    "Parallel": _parallel,
    "ParallelAll": _parallel,
    "Script": _set,
    "SetBlackboard": _set,
    "ScriptCondition": _check,
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
