"""Trees as a Python module that builds a py_trees tree.

The module needs py_trees alone. Its `create_tree(action)` calls `action(name, **arguments)`,
a function of the robot's program, for the behaviour of each leaf, and reads the
blackboard by the tree's keys. Where the library's own behaviours differ in meaning,
the module uses ours, of which it has a copy from `nodes/islandgp_nodes.py`.
"""

from __future__ import annotations

import builtins
import keyword
import re
from collections.abc import Sequence
from inspect import getsource
from typing import Final

from islandgp.bt.core.arithmetic import Formula, divide
from islandgp.bt.core.condition import Condition, ConditionExpr, side_source, source, terms
from islandgp.bt.core.kind import Target
from islandgp.bt.core.kinds import kind_of
from islandgp.bt.core.language import to_text
from islandgp.bt.core.node import (
    ActionArgs,
    AlwaysArgs,
    CountArgs,
    GuardArgs,
    Node,
    ParallelArgs,
    SecondsArgs,
    SetArgs,
    actions_in,
    asked_in,
    keys_in,
    keys_of,
    walk,
)
from islandgp.bt.core.parameters import bound, referenced
from islandgp.bt.core.printer import Named, condition_text, head, number_text
from islandgp.bt.core.vocabulary import EMPTY_VOCABULARY, Vocabulary
from islandgp.bt.export.tree_writer import TreeWriter, own_nodes
from islandgp.errors import DomainError

_SUBTREE: Final = '''def {name}(action, step_s):
    """A subtree of the tree."""
    return {tree}


'''


def to_python(tree: Node, vocabulary: Vocabulary = EMPTY_VOCABULARY) -> str:
    """The text of a Python module. Arguments and errors as in `behaviortree_cpp.to_xml`.

    Each named subtree becomes a separate function.
    """
    all_args = [node.args for node in walk(tree)]
    values = (v for args in all_args if isinstance(args, ActionArgs) for _, v in args.values)
    given = {key for value in values if (key := referenced(value)) in vocabulary.keys}
    amounts = (args for args in all_args if isinstance(args, CountArgs | SecondsArgs))
    if given := given.union(*map(keys_of, amounts)):
        raise DomainError(
            f"Expected arguments, counts and seconds without keys, as py_trees builds a node once,"
            f" found {min(given)!r}; export it as XML (--to btcpp), or read the key in the action."
        )
    assigned = (node.args.assigned for node in walk(tree) if isinstance(node.args, SetArgs))
    divides = any(term.divides for term in (*asked_in(tree), *assigned))
    nodes = _node_source() + f"import math\n\n\n{getsource(divide)}\n\n" * divides
    text = "".join(f"    {line}\n" for line in to_text(tree).splitlines())
    descriptions = {
        name: f"{key.meaning}; {key.kind}" if key.words else key.meaning
        for name, key in vocabulary.keys.items()
    } or dict.fromkeys(keys_in(tree), "")
    keys = "".join(
        f"    {name}: {meaning}".rstrip(": ") + "\n" for name, meaning in descriptions.items()
    )
    for name in sorted(actions_in(tree)):
        if uses := vocabulary.action(name).uses:
            text += f"\n    {name} uses {', '.join(uses)}, which no other action may use at once.\n"
    module = own_nodes("tree_module.txt")
    reserved = {*re.findall(r"\w+", module + nodes), *keyword.kwlist, *dir(builtins)}
    writer = _PythonWriter(vocabulary, reserved)
    root = writer.node(tree)
    subtrees = writer.subtrees.items()
    functions = [_SUBTREE.format(name=name, tree=_body(lines)) for name, lines in subtrees]
    return module.format(
        text=_in_docstring(text),
        keys=_in_docstring(keys).rstrip("\n"),
        nodes=nodes,
        subtrees="".join(functions),
        tree=_body(root),
    )


def _in_docstring(text: str) -> str:
    return text.replace("\\", "\\\\").replace('"""', "'''")


def _body(lines: list[str]) -> str:
    return "\n".join(f"    {line}" for line in lines).strip().removesuffix(",")


def _node_source() -> str:
    """The source of the package's node classes, without docstring and imports."""
    text = own_nodes("islandgp_nodes.py")
    return text[text.index("class SetKey(") :].rstrip() + "\n\n\n"


class _PythonWriter(TreeWriter):
    """Writes calls of classes, each with a comma behind it."""

    def has(self, target: Target) -> bool:
        return bool(target.python)

    def differs(self, node: Node) -> bool:
        match node.args:
            case GuardArgs():
                return not node.args.checks_itself
            case ParallelArgs():
                success, failure = node.args.needed(len(node.children))
                return failure > 1 or success not in (1, len(node.children))
        return isinstance(node.args, SecondsArgs)

    def use(self, name: str, lines: list[str]) -> list[str]:  # noqa: ARG002
        return [f"{name}(action, step_s),"]

    def element(self, node: Node, observed: bool) -> list[str]:
        match node.args:
            case ActionArgs(name, values):
                parameters = self.vocabulary.action(name).arguments
                arguments = bound(node.args, parameters) if parameters else dict(values)
                if any(map(keyword.iskeyword, arguments)):
                    return [f"action({name!r}, **{arguments!r}),"]
                given = "".join(f", {key}={value!r}" for key, value in arguments.items())
                return [f"action({name!r}{given}),"]
            case AlwaysArgs(status):
                return [f"{status.capitalize()}('always {status}'),"]
        children = self.children(node, observed)
        target = self.target(node, observed)
        python = target.python if target else "EternalGuard({condition}, child="
        if "(" not in python:
            python += f"({node.kind!r}, {'child=' if kind_of(node).decorates else 'children=['}"
        return _call(python.format(**_values(node)), children)


def _call(opening: str, children: Sequence[list[str]]) -> list[str]:
    """The lines of a call; the opening ends before the child or the list of children."""
    end = ")," if opening.endswith("child=") or not children else "]),"
    if not children:
        return [f"{opening}{end}"]
    return [opening, *(f"    {line}" for lines in children for line in lines), end]


def _values(node: Node) -> dict[str, object]:
    """What the text of a `Target` has in braces."""
    match node.args:
        case GuardArgs(condition, abort):
            return {"condition": _condition(condition), "abort": abort}
        case ParallelArgs(success, failure):
            one = success in ("one", 1)
            policy = "SuccessOnOne()" if one else "SuccessOnAll(synchronise=True)"
            return {"success": success, "failure": failure, "name": head(node), "policy": policy}
        case SecondsArgs(seconds):
            return {"seconds": number_text(float(seconds))}
        case SetArgs(assigned):
            return {"assignment": _assignment(assigned)}
        case CountArgs(times):
            return {"count": f"{times:.0f}"}
    return {}


def _assignment(assigned: Condition) -> str:
    """A name, the key, the keys that its value reads, and the value, as arguments of SetKey."""
    number, other = assigned.number, assigned.other
    value = side_source(other, _of_key) if other else number_text(number)
    if isinstance(number, Named):
        value = {"no": "False", "yes": "True"}.get(number.name, repr(number.name))
    keys = other.keys if isinstance(other, Formula) else (other,) * bool(other)
    name = f"set {condition_text(assigned)}"
    return f"{name!r}, {assigned.key!r}, {[*keys]!r}, lambda blackboard: {value}"


def _condition(condition: ConditionExpr) -> str:
    """A guard's name, keys and condition, as arguments of When and EternalGuard."""
    keys = [*dict.fromkeys(key for term in terms(condition) for key in term.keys)]
    holds = source(
        condition, _of_key, lambda n: repr(n.name) if isinstance(n, Named) else number_text(n)
    )
    name = condition_text(condition)
    return f"{name!r}, blackboard_keys={keys!r}, condition=lambda blackboard: {holds}"


def _of_key(key: str) -> str:
    return f"blackboard.get({key!r})"
