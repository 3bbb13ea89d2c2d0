"""Trees as XML for BehaviorTree.CPP, version 4.

The file holds the tree `Robot`, one for each named subtree, and the model of the
actions for Groot. The blackboard keys keep their names; all of them (numbers, flags, words) must be
on the blackboard before the first tick. Where the library's nodes behave differently, the file uses
nodes of `nodes/islandgp_nodes.hpp`.

One tick here is one call of `Tree::tickExactlyOnce()`.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from typing import Final
from xml.sax.saxutils import quoteattr

from islandgp.bt.core.condition import (
    OPPOSITE,
    Compound,
    Condition,
    ConditionExpr,
    terms,
    with_term,
)
from islandgp.bt.core.kinds import KINDS, NAV2, TARGETS
from islandgp.bt.core.node import (
    ActionArgs,
    AlwaysArgs,
    CountArgs,
    GuardArgs,
    Node,
    ParallelArgs,
    SecondsArgs,
    SetArgs,
    keys_in,
    walk,
)
from islandgp.bt.core.parameters import Parameter
from islandgp.bt.core.printer import Named, condition_text, number_text
from islandgp.bt.core.vocabulary import EMPTY_VOCABULARY, Action, Key, Vocabulary
from islandgp.bt.export.plan import (
    CHECK,
    SUBTREE,
    TargetNode,
    check_kinds,
    own_nodes,
    parts,
    plan,
    separated,
    subtree_of,
)
from islandgp.bt.export.scripts import NOT_A_NUMBER
from islandgp.errors import DomainError

TREE_ID: Final = "Robot"
HEADER: Final = "islandgp_nodes.hpp"


_FLAGS: Final = {"no": "false", "yes": "true"}
_FLAG: Final = Key()

BUILT_IN: Final = frozenset((
    *TARGETS, CHECK.tag, "Action", "Condition", "Control", "Decorator", "SubTree",
    "AlwaysFailure", "AlwaysSuccess", "AsyncFallback", "AsyncSequence", "EntryUpdated",
    "IfThenElse", "LoopBool", "LoopDouble", "LoopInt", "LoopString", "ManualSelector",
    "ParallelAll", "Precondition", "RetryUntilSuccesful", "RunOnce", "Script",
    "SequenceWithMemory", "SetBlackboard", "SkipUnlessUpdated", "Sleep", "SubTreePlus", "Switch2",
    "Switch3", "Switch4", "Switch5", "Switch6", "TestNode", "UnsetBlackboard", "WaitValueUpdate",
    "WasEntryUpdated", "WhileDoElse",
))  # fmt: skip
"""Names of nodes of the library, of our header and of Nav2, which actions cannot have."""


def differs(node: Node) -> bool:
    """True if the library's node for a parallel, a repetition, a time or a `when` differs."""
    if node.kind in NAV2:
        return False
    if isinstance(node.args, CountArgs):
        return node.args.times != 1
    if isinstance(node.args, ParallelArgs):
        # With one child all policies mean the same; the default is read back from the library's.
        return len(node.children) > 1 or node.args != ("all", "one")
    guard = node.guard
    equal = ("==", "!=")  # the library takes close numbers as equal
    compares = guard is not None and any(t.operator in equal for t in terms(guard.condition))
    return isinstance(node.args, SecondsArgs) or compares


def to_xml(tree: Node, vocabulary: Vocabulary = EMPTY_VOCABULARY) -> str:
    """The text of an XML file; the vocabulary gives the actions' meanings.

    Each named subtree becomes a separate tree in the file.

    Raises:
        DomainError: an action has the name of a node of the library, an argument has a name that
            a port cannot have, or the tree has a kind without an equivalent node.
    """
    check_kinds(tree, {"cooldown"}, "Python (--to pytrees)")
    actions = sorted({node.action for node in walk(tree) if node.action})
    if taken := BUILT_IN.intersection(actions):
        raise DomainError(
            f"Expected action names that are not nodes of BehaviorTree.CPP, found {min(taken)!r};"
            " rename the action in the domain."
        )
    _check_ports(actions, vocabulary)
    planned = _with_ports(plan(tree, differs), vocabulary)
    ours = sorted({part.target for part in parts(planned) if part.target.category})
    identity = TREE_ID if TREE_ID not in actions else f"{TREE_ID}Tree"
    # A SubTree does not see entries of the blackboard above whose names begin with _.
    shared = not any(key.startswith("_") for key in keys_in(tree))
    reserved = {*BUILT_IN, *actions, *vocabulary.actions, identity}
    root, subtrees = separated(planned, reserved, keep=shared)
    lines = [f'<root BTCPP_format="4" main_tree_to_execute="{identity}">']
    if ours:
        lines.append(f"  <!-- Needs {HEADER}: islandgp::register_nodes(factory, seconds). -->")
    for name, part in {identity: root, **subtrees}.items():
        lines += [f'  <BehaviorTree ID="{name}">', *_lines(part, "    "), "  </BehaviorTree>", ""]
    lines.append("  <TreeNodesModel>")
    for name in actions:
        action = vocabulary.action(name)
        tag = "Condition" if action.condition else "Action"
        ports = [_port(port, each) for port, each in action.arguments.items()]
        lines += _model(tag, name, ports, _comment(_with_uses(action)))
    for tag, names, _, category in ours:
        lines += _model(category, tag, [f'<input_port name="{name}"/>' for name in names])
    return "\n".join([*lines, "  </TreeNodesModel>", "</root>", ""])


def _check_ports(actions: Iterable[str], vocabulary: Vocabulary) -> None:
    """Raises DomainError for an argument whose name the library does not accept for a port."""
    for action in actions:
        for port in vocabulary.action(action).arguments:
            if port in ("name", "ID") or not port[0].isalpha():
                raise DomainError(
                    "Expected arguments that can be ports of BehaviorTree.CPP, which begin with a"
                    f" letter and are neither name nor ID, found {port!r} of the action {action};"
                    " rename the argument in the domain."
                )


def needs(tree: Node) -> list[str]:
    """What a program needs for the tree's file: our header, Nav2's nodes."""
    targets = {part.target for part in parts(plan(tree, differs))}
    needed = []
    if any(target.category for target in targets):
        needed.append(f"{HEADER}, which `islandgp export --header -o {HEADER}` writes")
    if nav2 := sorted(t.tag for t in targets if TARGETS.get(t.tag, ("",))[0] in NAV2):
        clock = ", which measures by the computer's clock" * ("RateController" in nav2)
        needed.append(f"Nav2's {', '.join(nav2)}{clock}")
    return needed


def header() -> str:
    """The C++ header with our nodes."""
    return own_nodes(HEADER)


def _with_ports(part: TargetNode, vocabulary: Vocabulary) -> TargetNode:
    """The plan with flags of actions and words of keys in the library's form."""
    args = part.args
    if isinstance(args, ActionArgs):
        arguments = vocabulary.action(args.name).arguments
        flags = {key for key, each in arguments.items() if each.sort == "flag"}
        values = ((key, _FLAGS.get(str(v), v) if key in flags else v) for key, v in args.values)
        args = args._replace(values=tuple(values))
    if isinstance(args, GuardArgs):
        args = args._replace(condition=_quoted(args.condition))
    if isinstance(args, SetArgs):
        number = args.assigned.number
        if isinstance(number, Named):
            flag = number.name in _FLAGS and vocabulary.keys.get(args.assigned.key, _FLAG).flag
            text = _FLAGS[number.name] if flag else f"'{number.name}'"
            args = SetArgs(args.assigned._replace(number=Named(text, number)))
        args = SetArgs(args.assigned._replace(operator=":="))
    children = tuple(_with_ports(child, vocabulary) for child in part.children)
    return part._replace(args=args, children=children)


def _quoted(expr: ConditionExpr) -> ConditionExpr:
    """The condition with words of keys in quotes: they are texts of the blackboard."""
    for index, term in enumerate(terms(expr)):
        if isinstance(term.number, Named):
            quoted = Named(f"'{term.number.name}'", term.number)
            expr = with_term(expr, index, term._replace(number=quoted)) or expr
    return expr


def _lines(part: TargetNode, indent: str) -> Iterator[str]:
    """The lines of a part of the plan, each indented by `indent`."""
    for text in part.comments:
        yield f"{indent}<!-- {_comment(text)} -->"
    args, tag = part.args, part.target.tag
    attributes = _attributes(part)
    if isinstance(args, ActionArgs):
        tag, attributes = args.name, {name: _value_text(value) for name, value in args.values}
    elif part.target == SUBTREE:
        attributes = {"ID": subtree_of(part), "_autoremap": "true"}
    elif part.target == CHECK and isinstance(args, GuardArgs):
        attributes = {"code": _script(args.condition)}
    elif isinstance(args, AlwaysArgs):
        tag, attributes = f"Always{args.status.capitalize()}", {}
    opening = "".join(f" {name}={quoteattr(value)}" for name, value in attributes.items())
    if not part.children:
        yield f"{indent}<{tag}{opening}/>"
        return
    yield f"{indent}<{tag}{opening}>"
    for child in part.children:
        yield from _lines(child, indent + "  ")
    yield f"{indent}</{tag}>"


def _with_uses(action: Action) -> str:
    """The meaning of an action, with the resources that it uses."""
    uses = f"uses {', '.join(action.uses)}" if action.uses else ""
    return "; ".join(part for part in (action.meaning, uses) if part)


def _comment(text: str) -> str:
    """The text as a valid XML comment."""
    return "".join(c for c in text if c.isprintable()).replace("--", "- -").replace("--", "- -")


def _attributes(part: TargetNode) -> dict[str, str]:
    """The attributes of a node with children, other than notes."""
    args = part.args
    values: Iterable[object] = args
    if part.target == KINDS["parallel"].stock:
        values = -1, 1
    elif part.target == KINDS["round_robin"].stock:
        values = ("true",)
    elif part.target == KINDS["every"].stock and isinstance(args, SecondsArgs):
        values = (float(f"{1 / args.seconds:.12g}"),)
    return dict(zip(part.target.ports, map(_value_text, values), strict=False))


def _value_text(value: object) -> str:
    if isinstance(value, Condition | Compound):
        return condition_text(value)
    return number_text(value) if isinstance(value, int | float) else str(value)


def _port(name: str, parameter: Parameter) -> str:
    sort = {"number": "double", "integer": "int", "flag": "bool"}.get(parameter.sort, "std::string")
    default = parameter.default
    default_text = quoteattr(_FLAGS[str(default)] if sort == "bool" else _value_text(default))
    return f'<input_port name="{name}" type="{sort}" default={default_text}/>'


def _model(tag: str, name: str, ports: Sequence[str], comment: str = "") -> Iterator[str]:
    """The declaration of a node, for Groot."""
    meaning = f" <!-- {comment} -->" if comment else ""
    yield f"    <{tag} ID={quoteattr(name)}{'' if ports else '/'}>{meaning}"
    if ports:
        yield from (f"      {port}" for port in ports)
        yield f"    </{tag}>"


def _needs_brackets(part: ConditionExpr) -> bool:
    """True for a part of && or || that needs them: the library mixes no sum with `!`."""
    if isinstance(part, Compound):
        return part.word != "not"
    return not part.single and not (part.divides and part.operator in NOT_A_NUMBER)


def _script(expr: ConditionExpr) -> str:
    """A condition in the library's script language, in which && and || have equal precedence."""
    if isinstance(expr, Condition):
        if expr.divides and expr.operator in NOT_A_NUMBER:
            return f"!({condition_text(expr._replace(operator=OPPOSITE[expr.operator]))})"
        flag = {"is": expr.key, "not": f"!{expr.key}"}.get(expr.operator)
        return flag or condition_text(expr)
    inside = [
        f"({_script(part)})" if _needs_brackets(part) else _script(part) for part in expr.parts
    ]
    if expr.word == "not":
        return f"!{inside[0]}" if inside[0].startswith("(") else f"!({inside[0]})"
    return {"and": " && ", "or": " || "}[expr.word].join(inside)
