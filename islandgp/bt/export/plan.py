"""Converts a tree to nodes that BehaviorTree.CPP and py_trees have in common.

Neither has abort rules. Both have composites with memory and composites that start
with their first child in each tick ("reactive"). A guard that checks itself becomes a
reactive sequence of a check and its child; any other guard a sequence with memory. A
selector with an interrupting guard becomes reactive from that branch on; the later
branches are nested as one child, which has its own memory:

    selector { A  when p { B }  C }    ->    fallback(A, reactive_fallback(guard(p, B), C))

With `differs` the plan has no loss: it uses our nodes (`nodes/`) if the library's nodes differ.
A selector or sequence that observes guards becomes an interruptible one, its guards become
`When` nodes, and `differs` returns True for the other nodes that need one of ours.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path
from typing import Final, NamedTuple, TypeAlias

from islandgp.bt.analysis.context import guard_chain, has_interrupting_guard
from islandgp.bt.core.kind import Target
from islandgp.bt.core.kinds import KINDS, NAV2, TIMED, kind_of
from islandgp.bt.core.node import (
    FAILURE,
    AlwaysArgs,
    Args,
    Node,
    UseArgs,
    comments_of,
    count_of,
    names_of,
    walk,
)
from islandgp.errors import DomainError


class TargetNode(NamedTuple):
    """A node of the other libraries."""

    target: Target
    args: Args = ()  # of the node of ours that it comes from
    children: tuple[TargetNode, ...] = ()
    rest: bool = False  # holds the branches behind reactive ones; no node of ours
    comments: tuple[str, ...] = ()  # lines above the node of ours


class SemanticDifference(NamedTuple):
    """A difference in behaviour after an export or an import."""

    about: str  # level, order, resumed, inner, ...: the rows of docs/exports.md
    message: str


LEVEL = SemanticDifference(
    "level",
    "an interrupting guard interrupts whenever it holds, not only when it becomes true:"
    " a branch that failed is tried again in the next tick",
)
ORDER = SemanticDifference(
    "order",
    "an interrupting branch starts before the interrupted one is halted, so that two branches"
    " are active at once for a moment; islandgp halts the interrupted one first",
)
RESUMED = SemanticDifference(
    "resumed",
    "if an interrupting branch fails at once, the other branch continues without an interruption;"
    " in islandgp it was halted and starts again",
)
DROPPED = SemanticDifference(
    "dropped",
    "an abort rule lower or both does not interrupt: the library has no equivalent in this place",
)
INNER = SemanticDifference(
    "inner",
    "below an interrupting guard, a guard that does not interrupt does so as well, as both are"
    " evaluated in each tick",
)


CLOCK = SemanticDifference(
    "clock",
    "the library measures a wait or a timeout by the computer's clock; islandgp counts ticks, so"
    " that each run is the same",
)


PLUGINS = SemanticDifference(
    "nav2",
    "PipelineSequence, RoundRobin, RecoveryNode and RateController are nodes of Nav2, which the"
    " program has to register; an action below a PipelineSequence has to start again after its end,"
    " as Nav2's actions do and a StatefulActionNode does not",
)

Differs: TypeAlias = Callable[[Node], bool]
"""True if a library's node for a parallel, a repetition, a time or a `when` differs in meaning."""

CHECK: Final = Target("ScriptCondition", ("code",))
"""A condition alone."""
SUBTREE: Final = Target("SubTree")
"""Around the root of a named subtree, or its use."""
LEAF: Final = Target("Action")
"""An action; the tag in a file is its name."""
ALWAYS: Final = Target("Always")
"""An `always`; the tag in a file ends with its status."""


def plan(node: Node, differs: Differs | None = None, *, observed: bool = False) -> TargetNode:
    """Converts a tree.

    Args:
        node: the tree.
        differs: True for nodes that need one of ours; None: use the library's nodes only.
        observed: a composite above observes guards here, through decorators.
    """
    *above, node_comments = comments_of(node)
    part = _part(node, differs, observed)._replace(comments=node_comments)
    for name, comments in zip(reversed(names_of(node)), reversed(above), strict=True):
        part = TargetNode(SUBTREE, UseArgs(name), (part,), comments=comments)
    return part


def _part(node: Node, differs: Differs | None, observed: bool) -> TargetNode:
    """`plan` of a node without the names of subtrees."""
    kind, args = kind_of(node), node.args
    if node.action:
        return TargetNode(LEAF, args)
    if isinstance(args, AlwaysArgs):
        if args.status != "running":
            return TargetNode(ALWAYS, args)
        return TargetNode(_stock("until_failure"), (), (TargetNode(ALWAYS, AlwaysArgs("success")),))
    if kind.remembers_branch:
        return _composite(node) if differs is None else _observing(node, differs)
    observed = observed and kind.decorates
    children = tuple(plan(child, differs, observed=observed) for child in node.children)
    if node.guard:
        exact = differs is not None and (observed or has_interrupting_guard(node) or differs(node))
        if exact and kind.ours:
            return TargetNode(kind.ours, args, children)
        stock = _stock("reactive_sequence" if node.guard.checks_itself else "sequence")
        return TargetNode(stock, args, (TargetNode(CHECK, args), *children))
    if node.kind == "until_success":
        inverted = (TargetNode(_stock("inverter"), (), children),)
        inside = TargetNode(_stock("until_failure"), (), inverted)
        return TargetNode(_stock("inverter"), (), (inside,))
    exact = kind.ours is not None and differs is not None and differs(node)
    target = kind.ours if exact else kind.stock
    assert target is not None  # as check_kinds says
    return TargetNode(target, args, children)


def _stock(kind: str) -> Target:
    """The libraries' node of a kind that has one."""
    target = KINDS[kind].stock
    assert target is not None
    return target


def _composite(node: Node) -> TargetNode:
    """Groups of reactive and of plain branches, each nested in the previous group."""
    branches = [(plan(b), _reacts(b, node.kind)) for b in node.children[:-1]]
    run: list[TargetNode] = [plan(node.children[-1])]
    reactive = False  # whether `run` is a run of reactive branches and its last child
    for part, reacts in reversed(branches):
        if reacts != reactive and len(run) > 1:
            run = [TargetNode(_ordered(node.kind, reactive), (), tuple(run), rest=True)]
        reactive = reacts
        run.insert(0, part)
    return TargetNode(_ordered(node.kind, reactive), (), tuple(run))


def _observing(node: Node, differs: Differs) -> TargetNode:
    """A selector or sequence: ours where it observes guards of a branch."""
    *earlier, last = node.children
    observes = [has_interrupting_guard(branch) for branch in earlier]
    children = [
        plan(branch, differs, observed=o) for branch, o in zip(earlier, observes, strict=True)
    ]
    target = kind_of(node).ours if any(observes) else kind_of(node).stock
    assert target is not None  # every selector and sequence has both
    return TargetNode(target, (), (*children, plan(last, differs)))


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
        use = UseArgs(names[name, children[0]])
        return TargetNode(SUBTREE, use, comments=part.comments)

    root = visit(plan_root)
    return root, {name: body for (_, body), name in names.items()}


def check_kinds(
    tree: Node, *, plain: bool, step_s: float | None, rejected_kinds: Iterable[str]
) -> None:
    """Raises DomainError for a tree with a kind, or with seconds, that cannot be exported.

    Args:
        tree: to be exported.
        plain: True: only nodes of the library, which measure seconds.
        step_s: seconds between two ticks; our nodes count ticks.
        rejected_kinds: kinds without a node in the library.
    """
    kinds = {node.kind for node in walk(tree)}
    timed = kinds & {*TIMED}
    if missing := kinds.intersection(rejected_kinds):
        other = "run it in Python (load_tree) or by a plug-in such as that of ROS"
        if not kinds & NAV2:
            other = "export it as Python (--to pytrees, without --plain)"
        elif "cooldown" not in kinds:
            other = "export it as plain XML (--to btcpp --plain)"
        raise DomainError(
            f"Expected a tree without {min(missing)}, for which the library has no node; {other}."
        )
    if timed and not plain and step_s is None:
        raise DomainError(
            f"Expected the seconds between two ticks, as the tree has a {min(timed)}; give --step."
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


def guard_losses(tree: Node) -> set[SemanticDifference]:
    """The changes that `plan` makes to the meaning of guards."""
    differences: set[SemanticDifference] = set()
    for node in walk(tree):
        earlier = node.children[:-1] if node.kind in ("selector", "sequence") else ()
        for branch in filter(has_interrupting_guard, earlier):
            reacts = _reacts(branch, node.kind)
            differences |= {LEVEL, ORDER, RESUMED} if reacts else {DROPPED}
            if reacts and not all(guard.interrupts for guard in guard_chain(branch)):
                differences.add(INNER)
    return differences


def _ordered(kind: str, reactive: bool) -> Target:
    return _stock(f"reactive_{kind}" if reactive else kind)


def _reacts(branch: Node, composite: str) -> bool:
    """True if a reactive composite has the effect of this branch's interrupting guard."""
    outermost = next(iter(guard_chain(branch)), None)
    # The outermost guard decides: no guard inside one that does not interrupt can interrupt.
    return outermost is not None and outermost.interrupts and advances(branch, composite)


def advances(branch: Node, composite: str) -> bool:
    """True if the next branch starts in the same tick when this branch's guard is false.

    That is so for a guard in a selector and an inverted guard in a sequence, but not if a repeater
    or a retry counts the failures: then the next branch starts several ticks later.
    """
    decorators = []
    while kind_of(branch).decorates and not branch.guard:
        decorators.append(branch)
        branch = branch.children[0]
    if not branch.guard:
        return False
    status = FAILURE  # of the guard while its condition is false
    for each in reversed(decorators):
        kind = kind_of(each)
        # A counted status passes up in the last repetition, another one at once.
        if status == kind.counts and count_of(each) != 1:
            return False
        status = kind.ends[status]
    return status == KINDS[composite].advance_status


def parts(part: TargetNode) -> Iterator[TargetNode]:
    """The parts of a plan in document order."""
    yield part
    for child in part.children:
        yield from parts(child)


def own_nodes(name: str) -> str:
    """The text of a file in `nodes`."""
    return (Path(__file__).parent / "nodes" / name).read_text(encoding="utf-8")
