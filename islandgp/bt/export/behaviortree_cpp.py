"""Trees as XML for BehaviorTree.CPP, version 4.

The file holds the tree `Robot`, one for each named subtree, and the model of the
actions for Groot. The blackboard keys keep their names; numbers and flags must be on the blackboard
before the first tick. Where the library's own nodes do something else, the file
names nodes of ours, which `nodes/islandgp_nodes.hpp` brings; a plain file does
without them, and what is not the same then is told by `losses`.

One tick of ours is one call of `Tree::tickExactlyOnce()`.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Final, NamedTuple
from xml.sax.saxutils import escape, quoteattr

from islandgp.bt.core.condition import Asked, Compound, Condition, terms
from islandgp.bt.core.node import (
    ActionArgs,
    CountArgs,
    GuardArgs,
    Node,
    ParallelArgs,
    asked_in,
    walk,
)
from islandgp.bt.core.parameters import Parameter
from islandgp.bt.core.printer import condition_text, number_text
from islandgp.bt.core.vocabulary import NOTHING, Vocabulary
from islandgp.bt.export.plan import (
    OWN,
    Loss,
    TargetNode,
    guard_losses,
    own_nodes,
    parts,
    plan,
    separated,
    subtree_of,
)
from islandgp.errors import DomainError

TREE_ID: Final = "Robot"
REST: Final = "rest"  # the name of a node that holds the later branches of the one above it
HEADER: Final = "islandgp_nodes.hpp"


class NodeType(NamedTuple):
    """A node over there."""

    tag: str
    attributes: tuple[str, ...] = ()  # of ours: what stands for our arguments, in their order
    ours: str = ""  # Control, Decorator: what Groot must know of a node of ours; "": the library's


NODES: Final[dict[str, NodeType]] = {
    "fallback": NodeType("Fallback"),
    "sequence": NodeType("Sequence"),
    "reactive_fallback": NodeType("ReactiveFallback"),
    "reactive_sequence": NodeType("ReactiveSequence"),
    "parallel": NodeType("Parallel", ("success_count", "failure_count")),
    "inverter": NodeType("Inverter"),
    "repeat": NodeType("Repeat", ("num_cycles",)),
    "retry": NodeType("RetryUntilSuccessful", ("num_attempts",)),
    "force_success": NodeType("ForceSuccess"),
    "force_failure": NodeType("ForceFailure"),
    "check": NodeType("ScriptCondition", ("code",)),
    "when": NodeType("When", ("condition", "abort"), "Decorator"),
    "interruptible_fallback": NodeType("InterruptibleFallback", (), "Control"),
    "interruptible_sequence": NodeType("InterruptibleSequence", (), "Control"),
    "judged_parallel": NodeType("JudgedParallel", ("success", "failure"), "Control"),
    "repeat_per_tick": NodeType("RepeatPerTick", ("num_cycles",), "Decorator"),
    "retry_per_tick": NodeType("RetryPerTick", ("num_attempts",), "Decorator"),
}
"""By our names of `plan`."""

TAGS: Final = {node.tag: kind for kind, node in NODES.items()}

BUILT_IN: Final = frozenset((
    *TAGS, "Action", "Condition", "Control", "Decorator", "SubTree",
    "AlwaysFailure", "AlwaysSuccess", "AsyncFallback", "AsyncSequence", "Delay", "EntryUpdated",
    "ForceFailure", "ForceSuccess", "IfThenElse", "KeepRunningUntilFailure", "LoopBool",
    "LoopDouble", "LoopInt", "LoopString", "ManualSelector", "ParallelAll", "Precondition",
    "RetryUntilSuccessful", "RetryUntilSuccesful", "RunOnce", "Script", "SequenceWithMemory",
    "SetBlackboard", "SkipUnlessUpdated", "Sleep", "SubTreePlus", "Switch2", "Switch3", "Switch4",
    "Switch5", "Switch6", "TestNode", "Timeout", "UnsetBlackboard", "WaitValueUpdate",
    "WasEntryUpdated", "WhileDoElse",
))  # fmt: skip
"""Names of nodes that no action can have over there."""

REPEAT = Loss(
    "repeat",
    "Repeat and RetryUntilSuccessful begin the next repetition in the tick in which one ends;"
    " where a repetition ended in its first tick, tickExactlyOnce leaves the next one to its next"
    " call, tickOnce does not. A repeater or a retry here always takes the next tick",
)
JUDGED = Loss(
    "judged",
    "Parallel ends at the child that decides, and does not tick those behind it in that tick;"
    " of a failure and a success in one tick, the first in the text decides",
)
POLICY = Loss(
    "policy",
    "a parallel with success all and failure all fails at the first failure, as it can't succeed"
    " any more",
)
EQUAL = Loss("equal", "== and != take two numbers that differ by no more than 0.00000012 as equal")


def losses(tree: Node) -> list[Loss]:
    """What does not mean the same in a plain file, each kind once."""
    found = guard_losses(tree)
    for node in walk(tree):
        if isinstance(node.args, CountArgs) and differs(node):
            found.add(REPEAT)
        if isinstance(node.args, ParallelArgs) and len(node.children) > 1:
            found.add(POLICY if node.args == ("all", "all") else JUDGED)
        if node.guard and differs(node):
            found.add(EQUAL)
    return sorted(found)


def differs(node: Node) -> bool:
    """Whether the library's own node for a parallel, a repeater or a `when` does something else."""
    if isinstance(node.args, CountArgs):
        return node.args.times != 1
    if isinstance(node.args, ParallelArgs):
        # With one child only the words differ; they come back when the file is read.
        return len(node.children) > 1 or node.args != ("all", "one")
    guard = node.guard
    return guard is not None and any(t.operator in ("==", "!=") for t in terms(guard.condition))


def to_xml(tree: Node, vocabulary: Vocabulary = NOTHING, *, plain: bool = False) -> str:
    """The text of an XML file; the vocabulary gives the actions' meanings.

    Args:
        tree: what to write; each `Used` in it becomes a tree of its own in the file.
        vocabulary: its actions and keys.
        plain: only nodes of the library; what is not the same then is told by `losses`.

    Raises:
        DomainError: an action has the name of a node of the library.
    """
    used = sorted({node.action for node in walk(tree) if node.action})
    if taken := BUILT_IN.intersection(used):
        raise DomainError(
            f"Expected action names that are no nodes of BehaviorTree.CPP, found {min(taken)!r};"
            " rename the action in the domain."
        )
    whole = plan(tree, None if plain else differs)
    own = {part.kind for part in parts(whole)} & OWN
    identity = TREE_ID if TREE_ID not in used else f"{TREE_ID}Tree"
    # A SubTree does not see entries of the blackboard above whose names begin with _.
    shared = not any(term.key.startswith("_") for term in asked_in(tree))
    unfit = {*BUILT_IN, *used, *vocabulary.actions, identity}
    root, subtrees = separated(whole, unfit, keep=shared)
    lines = [f'<root BTCPP_format="4" main_tree_to_execute="{identity}">']
    if own:
        lines.append(f"  <!-- Needs {HEADER}: islandgp::register_nodes(factory). -->")
    for name, part in {identity: root, **subtrees}.items():
        lines += [f'  <BehaviorTree ID="{name}">', *_lines(part, "    "), "  </BehaviorTree>", ""]
    lines.append("  <TreeNodesModel>")
    for name in used:
        words = vocabulary.action(name).meaning.replace("--", "-")
        meaning = f"<!-- {escape(words)} -->" if words else ""
        ports = vocabulary.action(name).arguments
        lines.append(f"    <Action ID={quoteattr(name)}{'' if ports else '/'}> {meaning}".rstrip())
        lines += (f"      {_port(port, each)}" for port, each in ports.items())
        lines += ["    </Action>"] if ports else []
    lines += (line for kind in sorted(own) for line in _model(kind))
    return "\n".join([*lines, "  </TreeNodesModel>", "</root>", ""])


def needs_header(tree: Node) -> bool:
    """Whether the file of a tree, unless it is plain, names nodes of ours."""
    return any(part.kind in OWN for part in parts(plan(tree, differs)))


def header() -> str:
    """The C++ header with our nodes."""
    return own_nodes(HEADER)


def _lines(part: TargetNode, indent: str) -> Iterator[str]:
    if isinstance(part.args, ActionArgs):
        ports = (f" {name}={quoteattr(_word(value))}" for name, value in part.args.values)
        yield f"{indent}<{part.args.name}{''.join(ports)}/>"
        return
    if part.kind == "subtree":
        yield f'{indent}<SubTree ID="{subtree_of(part)}" _autoremap="true"/>'
        return
    if part.kind == "check" and isinstance(part.args, GuardArgs):
        yield f"{indent}<ScriptCondition code={quoteattr(_script(part.args.condition))}/>"
        return
    tag = NODES[part.kind].tag
    yield f"{indent}<{tag}{_attributes(part)}>"
    for child in part.children:
        yield from _lines(child, indent + "  ")
    yield f"{indent}</{tag}>"


def _attributes(part: TargetNode) -> str:
    if part.kind == "parallel" and isinstance(part.args, ParallelArgs):
        success, failure = part.args
        # With success all, the first failure fails it, whatever stands here.
        fails = 1 if failure == "one" or success == "all" else len(part.children)
        return f' success_count="{1 if success == "one" else -1}" failure_count="{fails}"'
    if part.rest:
        return f' name="{REST}"'
    values = zip(NODES[part.kind].attributes, part.args, strict=False)
    return "".join(f" {name}={quoteattr(_word(value))}" for name, value in values)


def _word(value: object) -> str:
    if isinstance(value, Condition | Compound):
        return condition_text(value)
    return number_text(value) if isinstance(value, int | float) else str(value)


def _port(name: str, parameter: Parameter) -> str:
    sort = {"number": "double", "integer": "int", "flag": "bool"}.get(parameter.sort, "std::string")
    given = quoteattr(_word(parameter.default))
    return f'<input_port name="{name}" type="{sort}" default={given}/>'


def _model(kind: str) -> Iterator[str]:
    """What Groot must know of a node of ours."""
    tag, attributes, sort = NODES[kind]
    if not attributes:
        yield f'    <{sort} ID="{tag}"/>'
        return
    yield f'    <{sort} ID="{tag}">'
    for name in attributes:
        yield f'      <input_port name="{name}"/>'
    yield f"    </{sort}>"


def _script(asked: Asked) -> str:
    """A condition in the library's script language, in which && and || bind equally."""
    if isinstance(asked, Condition):
        flag = {"is": asked.key, "not": f"!{asked.key}"}.get(asked.operator)
        return flag or f"{asked.key} {asked.operator} {number_text(asked.number)}"
    inside = [
        f"({_script(part)})" if isinstance(part, Compound) and part.word != "not" else _script(part)
        for part in asked.parts
    ]
    if asked.word == "not":
        return f"!{inside[0]}" if inside[0].startswith("(") else f"!({inside[0]})"
    return {"and": " && ", "or": " || "}[asked.word].join(inside)
