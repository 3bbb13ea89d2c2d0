"""Trees as XML for BehaviorTree.CPP, version 4.

The file holds the tree `Robot`, one for each named subtree, and the model of the
actions for Groot. The blackboard keys keep their names; all of them (numbers, flags, words) must be
on the blackboard before the first tick. Where the library's nodes behave differently, the file uses
nodes of `nodes/islandgp_nodes.hpp`.

One tick here is one call of `Tree::tickExactlyOnce()`.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
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
from islandgp.bt.core.kind import Target
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
from islandgp.bt.core.parameters import Parameter, argument_values
from islandgp.bt.core.printer import Named, condition_text, number_text
from islandgp.bt.core.vocabulary import EMPTY_VOCABULARY, Action, Key, Vocabulary
from islandgp.bt.export.import_cpp import NO_ELSE, READERS
from islandgp.bt.export.scripts import NOT_A_NUMBER
from islandgp.bt.export.tree_writer import HEADER, TreeWriter, own_nodes
from islandgp.errors import DomainError

TREE_ID: Final = "Robot"


_FLAGS: Final = {"no": "false", "yes": "true"}
_FLAG: Final = Key()

BUILT_IN: Final = frozenset((
    *READERS, "AsyncFallback", "AsyncSequence", "Condition", "Control", "Decorator", "EntryUpdated",
    "LoopBool", "LoopDouble", "LoopInt", "LoopString", "ManualSelector", "Precondition", "RunOnce",
    "SkipUnlessUpdated", "TestNode", "UnsetBlackboard", "WaitValueUpdate", "WasEntryUpdated",
))  # fmt: skip
"""Names of nodes of the library, of our header and of Nav2, which actions cannot have."""


def to_xml(tree: Node, vocabulary: Vocabulary = EMPTY_VOCABULARY) -> str:
    """The text of an XML file; the vocabulary gives the actions' meanings.

    Each named subtree becomes a separate tree in the file.

    Raises:
        DomainError: an action has the name of a node of the library, an argument has a name that
            a port cannot have, or the tree has a kind without an equivalent node.
    """
    actions = sorted({node.action for node in walk(tree) if node.action})
    if taken := BUILT_IN.intersection(actions):
        raise DomainError(
            f"Expected action names that are not nodes of BehaviorTree.CPP, found {min(taken)!r};"
            " rename the action in the domain."
        )
    _check_ports(actions, vocabulary)
    identity = TREE_ID if TREE_ID not in actions else f"{TREE_ID}Tree"
    writer = _XmlWriter(vocabulary, {*BUILT_IN, *actions, *vocabulary.actions, identity})
    # A SubTree does not see entries of the blackboard above whose names begin with _.
    writer.shared = not any(key.startswith("_") for key in keys_in(tree))
    root = writer.node(tree)
    subtrees = writer.subtrees if writer.shared else {}
    lines = [f'<root BTCPP_format="4" main_tree_to_execute="{identity}">']
    if writer.ours:
        lines.append(f"  <!-- Needs {HEADER}: islandgp::register_nodes(factory, seconds). -->")
    for name, body in {identity: root, **subtrees}.items():
        indented = (f"    {line}" for line in body)
        lines += [f'  <BehaviorTree ID="{name}">', *indented, "  </BehaviorTree>", ""]
    lines.append("  <TreeNodesModel>")
    for name in actions:
        action = vocabulary.action(name)
        tag = "Condition" if action.condition else "Action"
        ports = [_port(port, each) for port, each in action.arguments.items()]
        lines += _model(tag, name, ports, _comment(_with_uses(action)))
    for tag, names, _, category in sorted(writer.ours):
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


def needs(xml: str) -> list[str]:
    """What a program needs for the text of a file: our header, Nav2's nodes."""
    needed = []
    if f"<!-- Needs {HEADER}" in xml:
        needed.append(f"{HEADER}, which `islandgp export --header -o {HEADER}` writes")
    tags = sorted({*re.findall(r"^ *<(\w+)", xml, re.MULTILINE)} & {*TARGETS})
    if nav2 := [tag for tag in tags if TARGETS[tag][0] in NAV2]:
        clock = ", which measures by the computer's clock" * ("RateController" in nav2)
        needed.append(f"Nav2's {', '.join(nav2)}{clock}")
    return needed


def header() -> str:
    """The C++ header with our nodes."""
    return own_nodes(HEADER)


class _XmlWriter(TreeWriter):
    """Writes elements."""

    shared = True  # False: subtrees are written in place

    def __init__(self, vocabulary: Vocabulary, reserved: Iterable[str]) -> None:
        super().__init__(vocabulary, reserved)
        self.ours: set[Target] = set()  # nodes of our header

    def has(self, target: Target) -> bool:
        return bool(target.tag)

    def differs(self, node: Node) -> bool:
        match node.args:
            case _ if node.kind in NAV2:
                return False
            case CountArgs(times):
                return times != 1
            case ParallelArgs():
                # With one child all policies mean the same; the default is read back as it was.
                return len(node.children) > 1 or node.args != ("all", "one")
            case GuardArgs(condition):  # the library takes close numbers as equal
                return any(term.operator in ("==", "!=") for term in terms(condition))
        return isinstance(node.args, SecondsArgs)

    def comments(self, texts: Sequence[str]) -> list[str]:
        return [f"<!-- {_comment(text)} -->" for text in texts]

    def use(self, name: str, lines: list[str]) -> list[str]:
        return [f'<SubTree ID="{name}" _autoremap="true"/>'] if self.shared else lines

    def element(self, node: Node, observed: bool) -> list[str]:
        match node.args:
            case ActionArgs(name):
                arguments = self.vocabulary.action(name).arguments
                flags = {key for key, each in arguments.items() if each.sort == "flag"}
                values = argument_values(node.args, arguments).items()
                ports = {k: _FLAGS.get(str(v), v) if k in flags else v for k, v in values}
                return _element(name, ports)
            case AlwaysArgs(status):
                return _element(f"Always{status.capitalize()}", {})
            case SetArgs(assigned):
                return _element("Script", {"code": self._assignment(assigned)})
        inside = [line for lines in self.children(node, observed) for line in lines]
        if node.kind == "if_else" and len(node.children) == 2:
            # Without a third child the library does not reset the first one after its failure.
            inside += _element("AlwaysFailure", {"name": NO_ELSE})
        target = self.target(node, observed)
        if isinstance(node.args, GuardArgs) and target is None:
            check = _element("ScriptCondition", {"code": _script(_quoted(node.args.condition))})
            tag = "ReactiveSequence" if node.args.checks_itself else "Sequence"
            return _element(tag, {}, [*check, *inside])
        assert target is not None  # as only a `when` has none
        self.ours |= {target} if target.category else set()
        return _element(target.tag, _attributes(node, target), inside)

    def _assignment(self, assigned: Condition) -> str:
        number = assigned.number
        if isinstance(number, Named):
            flag = number.name in _FLAGS and self.vocabulary.keys.get(assigned.key, _FLAG).flag
            number = Named(_FLAGS[number.name] if flag else f"'{number.name}'", number)
        return condition_text(assigned._replace(number=number, operator=":="))


def _element(tag: str, attributes: Mapping[str, object], inside: Sequence[str] = ()) -> list[str]:
    """The lines of an element."""
    pairs = (f" {name}={quoteattr(_value_text(value))}" for name, value in attributes.items())
    opening = f"<{tag}{''.join(pairs)}"
    if not inside:
        return [f"{opening}/>"]
    return [f"{opening}>", *(f"  {line}" for line in inside), f"</{tag}>"]


def _attributes(node: Node, target: Target) -> dict[str, object]:
    """The attributes of a node with children."""
    values: Sequence[object] = node.args
    if target == KINDS["parallel"].stock:
        values = -1, 1
    elif isinstance(node.args, GuardArgs):
        values = condition_text(_quoted(node.args.condition)), node.args.abort
    elif target == KINDS["round_robin"].stock:
        values = ("true",)
    elif isinstance(node.args, CountArgs | SecondsArgs) and isinstance(node.args[0], str):
        if node.kind in NAV2:
            raise DomainError(
                f"Expected a number as the argument of {node.kind}, which Nav2 reads once, found"
                f" the key {node.args[0]!r}; write a number or a constant."
            )
        values = (f"{{{node.args[0]}}}",)
    elif target == KINDS["every"].stock and isinstance(node.args, SecondsArgs):
        values = (float(f"{1 / float(node.args.seconds):.12g}"),)
    return dict(zip(target.ports, values, strict=False))


def _quoted(expr: ConditionExpr) -> ConditionExpr:
    """The condition with words of keys in quotes: they are texts of the blackboard."""
    for index, term in enumerate(terms(expr)):
        if isinstance(term.number, Named):
            quoted = Named(f"'{term.number.name}'", term.number)
            expr = with_term(expr, index, term._replace(number=quoted)) or expr
    return expr


def _with_uses(action: Action) -> str:
    """The meaning of an action, with the resources that it uses."""
    uses = f"uses {', '.join(action.uses)}" if action.uses else ""
    return "; ".join(part for part in (action.meaning, uses) if part)


def _comment(text: str) -> str:
    """The text as a valid XML comment."""
    return "".join(c for c in text if c.isprintable()).replace("--", "- -").replace("--", "- -")


def _value_text(value: object) -> str:
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
