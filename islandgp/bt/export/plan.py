"""Converts a tree to the nodes of BehaviorTree.CPP or py_trees.

A node becomes the library's own where that means the same, and otherwise one of `nodes/`. A
selector or sequence that observes guards becomes an interruptible one, and its guards `When` nodes.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path
from typing import Final, NamedTuple, TypeAlias

from islandgp.bt.analysis.context import has_interrupting_guard
from islandgp.bt.core.kind import Target
from islandgp.bt.core.kinds import KINDS, kind_of
from islandgp.bt.core.node import (
    AlwaysArgs,
    Args,
    Node,
    UseArgs,
    marks_of,
    walk,
)
from islandgp.errors import DomainError


class TargetNode(NamedTuple):
    """A node of another library."""

    target: Target
    args: Args = ()  # of the node of ours that it comes from
    children: tuple[TargetNode, ...] = ()
    comments: tuple[str, ...] = ()  # lines above the node of ours


Differs: TypeAlias = Callable[[Node], bool]
"""True if the library's node for a parallel, a repetition, a time or a `when` differs."""

CHECK: Final = Target("ScriptCondition", ("code",))
"""A condition alone."""
SUBTREE: Final = Target("SubTree")
"""Around the root of a named subtree, or its use."""
LEAF: Final = Target("Action")
"""An action; the tag in a file is its name."""
ALWAYS: Final = Target("Always")
"""An `always`; the tag in a file ends with its status."""


def plan(node: Node, differs: Differs, *, observed: bool = False) -> TargetNode:
    """Converts a tree.

    Args:
        node: the tree.
        differs: True for nodes that need one of ours.
        observed: a composite above observes guards here, through decorators.
    """
    *uses, own = marks_of(node)
    part = _part(node, differs, observed)._replace(comments=own.comments.lines)
    for use in reversed(uses):
        part = TargetNode(SUBTREE, UseArgs(use.name), (part,), use.comments.lines)
    return part


def _part(node: Node, differs: Differs, observed: bool) -> TargetNode:
    """`plan` of a node without the names of subtrees."""
    kind, args = kind_of(node), node.args
    if node.action:
        return TargetNode(LEAF, args)
    if isinstance(args, AlwaysArgs):
        if args.status != "running":
            return TargetNode(ALWAYS, args)
        return TargetNode(_stock("until_failure"), (), (TargetNode(ALWAYS, AlwaysArgs("success")),))
    if kind.remembers_branch:
        return _observing(node, differs)
    observed = observed and kind.decorates
    children = tuple(plan(child, differs, observed=observed) for child in node.children)
    if node.guard:
        if observed or has_interrupting_guard(node) or differs(node):
            return TargetNode(_ours(node.kind), args, children)
        stock = _stock("reactive_sequence" if node.guard.checks_itself else "sequence")
        return TargetNode(stock, args, (TargetNode(CHECK, args), *children))
    if node.kind == "until_success":
        inside = TargetNode(_stock("inverter"), (), children)
        inside = TargetNode(_stock("until_failure"), (), (inside,))
        return TargetNode(_stock("inverter"), (), (inside,))
    target = _ours(node.kind) if kind.stock is None or differs(node) else kind.stock
    return TargetNode(target, args, children)


def _stock(kind: str) -> Target:
    """The libraries' node of a kind that has one."""
    target = KINDS[kind].stock
    assert target is not None
    return target


def _ours(kind: str) -> Target:
    """Our node of a kind that has one."""
    target = KINDS[kind].ours
    assert target is not None  # as check_kinds says
    return target


def _observing(node: Node, differs: Differs) -> TargetNode:
    """A selector or sequence: ours where it observes guards of a branch."""
    observes = [*map(has_interrupting_guard, node.children[:-1]), False]
    children = [
        plan(branch, differs, observed=o) for branch, o in zip(node.children, observes, strict=True)
    ]
    return TargetNode((_ours if any(observes) else _stock)(node.kind), (), tuple(children))


def separated(
    plan_root: TargetNode, reserved: Iterable[str], *, keep: bool = True
) -> tuple[TargetNode, dict[str, TargetNode]]:
    """A plan that refers to subtrees by name, and the subtrees, each before its users.

    A subtree that differs between its uses, by its numbers or because its guards are observed in
    one of them, becomes several: `recharge_20`, `recharge_30`.

    Args:
        plan_root: the plan with its subtrees in place.
        reserved: names that no subtree can have.
        keep: False: insert the subtrees in their places, without names.
    """
    taken = set(reserved)
    names: dict[tuple[str, TargetNode], str] = {}

    def visit(part: TargetNode) -> TargetNode:
        if not part.children:
            return part
        children = tuple(map(visit, part.children))
        if part.target != SUBTREE:
            return part._replace(children=children)
        if not keep:
            return children[0]
        name = subtree_of(part)
        if (name, children[0]) not in names:
            names[name, children[0]] = fresh_name(name, taken)
            taken.add(names[name, children[0]])
        return TargetNode(SUBTREE, UseArgs(names[name, children[0]]), comments=part.comments)

    root = visit(plan_root)
    return root, {name: body for (_, body), name in names.items()}


def check_kinds(tree: Node, rejected_kinds: Iterable[str], other: str) -> None:
    """Raises DomainError for a tree with one of these kinds; `other`: the format for them."""
    if missing := {node.kind for node in walk(tree)}.intersection(rejected_kinds):
        raise DomainError(
            f"Expected a tree without {min(missing)}, for which the library has no node; export it"
            f" as {other}, or run it in Python (load_tree) or by a plug-in such as that of ROS."
        )


def subtree_of(part: TargetNode) -> str:
    """The name of a part of the kind subtree."""
    assert isinstance(part.args, UseArgs)
    return part.args.name


def fresh_name(name: str, taken: set[str]) -> str:
    """A valid name like `name` that is not in `taken`: recharge_20_3 for `recharge(20, 3)`."""
    prefix = re.sub(r"[^A-Za-z0-9_]+", "_", name.replace("-", "minus_").removesuffix(")"))
    prefix = prefix if prefix[:1].isalpha() or prefix[:1] == "_" else f"tree_{prefix}"
    candidate, number = prefix, 1
    while candidate in taken:
        number += 1
        candidate = f"{prefix}_{number}"
    return candidate


def parts(part: TargetNode) -> Iterator[TargetNode]:
    """The parts of a plan in document order."""
    yield part
    for child in part.children:
        yield from parts(child)


def own_nodes(name: str) -> str:
    """The text of a file in `nodes`."""
    return (Path(__file__).parent / "nodes" / name).read_text(encoding="utf-8")
