"""Trees as XML for BehaviorTree.CPP, version 4.

The file holds one tree, `Robot`, and the model of its actions for Groot. The
blackboard keys keep their names; numbers and flags must be on the blackboard
before the first tick. What is not the same over there: `losses`.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Final
from xml.sax.saxutils import escape, quoteattr

from islandgp.bt.export.plan import Loss, Part, guard_losses, plan
from islandgp.bt.node import Node, walk
from islandgp.bt.printer import number_text
from islandgp.bt.vocabulary import NOTHING, Vocabulary

TREE_ID: Final = "Robot"
REST: Final = "rest"  # the name of a node that stands for the later branches of the one above it

TAGS: Final[dict[str, str]] = {
    "fallback": "Fallback",
    "sequence": "Sequence",
    "reactive_fallback": "ReactiveFallback",
    "reactive_sequence": "ReactiveSequence",
    "parallel": "Parallel",
    "inverter": "Inverter",
    "repeat": "Repeat",
    "check": "ScriptCondition",
}
"""Our names of `plan` and theirs."""

REPEAT = Loss(
    "repeat",
    "Repeat begins the next repetition in the tick in which one ends; a repeater here begins it in"
    " the next tick",
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


def losses(tree: Node) -> list[Loss]:
    """What does not mean the same in BehaviorTree.CPP, each kind once."""
    found = guard_losses(tree)
    for node in walk(tree):
        if node.kind == "repeater" and node.args[0] != 1:
            found.add(REPEAT)
        if node.kind == "parallel" and len(node.children) > 1:
            found.add(POLICY if node.args == ("all", "all") else JUDGED)
    return sorted(found)


def to_xml(tree: Node, vocabulary: Vocabulary = NOTHING) -> str:
    """The text of an XML file; the vocabulary gives the actions' meanings."""
    used = sorted({str(node.args[0]) for node in walk(tree) if node.kind == "action"})
    lines = [
        f'<root BTCPP_format="4" main_tree_to_execute="{TREE_ID}">',
        f'  <BehaviorTree ID="{TREE_ID}">',
        *_lines(plan(tree), "    "),
        "  </BehaviorTree>",
        "",
        "  <TreeNodesModel>",
    ]
    for name in used:
        words = vocabulary.action(name).meaning
        meaning = f"<!-- {escape(words)} -->" if words else ""
        lines.append(f"    <Action ID={quoteattr(name)}/> {meaning}".rstrip())
    return "\n".join([*lines, "  </TreeNodesModel>", "</root>", ""])


def _lines(part: Part, indent: str) -> Iterator[str]:
    if part.kind == "action":
        yield f"{indent}<{part.args[0]}/>"
        return
    if part.kind == "check":
        yield f"{indent}<ScriptCondition code={quoteattr(_script(part))}/>"
        return
    tag = TAGS[part.kind]
    yield f"{indent}<{tag}{_attributes(part)}>"
    for child in part.children:
        yield from _lines(child, indent + "  ")
    yield f"{indent}</{tag}>"


def _attributes(part: Part) -> str:
    if part.kind == "repeat":
        return f' num_cycles="{int(part.args[0])}"'
    if part.kind == "parallel":
        success, failure = part.args
        fails = 1 if failure == "one" else len(part.children)
        return f' success_count="{1 if success == "one" else -1}" failure_count="{fails}"'
    return f' name="{REST}"' if part.rest else ""


def _script(check: Part) -> str:
    key, operator, number = check.args
    if operator == "is":
        return str(key)
    if operator == "not":
        return f"!{key}"
    return f"{key} {operator} {number_text(float(number))}"
