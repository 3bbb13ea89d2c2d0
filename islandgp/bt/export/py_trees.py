"""Trees as a Python module that builds a py_trees tree.

The module needs py_trees alone. Its `create_tree(action)` calls `action(name, **arguments)`,
a function of the robot's program, for the behaviour of each leaf, and reads the
blackboard by the tree's keys. Where the library's own behaviours differ in meaning,
the module has a copy of ours from `nodes/islandgp_nodes.py`; a plain module has none
of them, and `losses` lists its differences.
"""

from __future__ import annotations

import builtins
import keyword
import re
from collections.abc import Iterator
from inspect import getsource
from typing import Final

from islandgp.bt.core.arithmetic import Formula, divide, python
from islandgp.bt.core.condition import Compound, Condition, ConditionExpr, terms
from islandgp.bt.core.kind import Target
from islandgp.bt.core.kinds import KINDS, NAV2
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
    asked_in,
    keys_in,
    names_in,
    walk,
    written_in,
)
from islandgp.bt.core.parameters import bound, referenced
from islandgp.bt.core.printer import Named, condition_text, head, number_text
from islandgp.bt.core.vocabulary import EMPTY_VOCABULARY, Vocabulary
from islandgp.bt.export.plan import (
    CHECK,
    CLOCK,
    SUBTREE,
    SemanticDifference,
    TargetNode,
    check_kinds,
    guard_losses,
    own_nodes,
    parts,
    plan,
    separated,
    subtree_of,
)
from islandgp.errors import DomainError

POLICY = SemanticDifference(
    "policy", "any failing child fails a Parallel of py_trees, which has no counts"
)

_SUBTREE: Final = '''def {name}(action):
    """A subtree of the tree."""
    return {tree}


'''
_SET_KEY: Final = '''class SetKey(Behaviour):
    """Writes a key and succeeds."""

    def __init__(self, name, key, keys, value):
        super().__init__(name)
        self.key, self.value = key, value
        self.client = self.attach_blackboard_client()
        self.client.register_key(key, access=Access.WRITE)
        for each in keys:
            self.client.register_key(each, access=Access.READ)

    def update(self):
        self.client.set(self.key, self.value(self.client))
        return Status.SUCCESS


'''
_DIVIDE: Final = f"import math\n\n\n{getsource(divide)}\n\n"
_COMPARE: Final = {"<": "lt", "<=": "le", ">": "gt", ">=": "ge", "==": "eq", "!=": "ne"}


def losses(tree: Node) -> list[SemanticDifference]:
    """The differences in behaviour of a plain module, each kind once."""
    differences = guard_losses(tree)
    nodes = list(walk(tree))
    if any(differs(node) and isinstance(node.args, ParallelArgs) for node in nodes):
        differences.add(POLICY)
    if any(isinstance(node.args, SecondsArgs) for node in nodes):
        differences.add(CLOCK)
    return sorted(differences)


def differs(node: Node) -> bool:
    """True if the library's node for a parallel, a repeater or a `when` behaves differently."""
    if isinstance(node.args, SecondsArgs):
        return True
    if not isinstance(node.args, ParallelArgs):
        return False
    success, failure = node.args.needed(len(node.children))
    return failure > 1 or success not in (1, len(node.children))


def to_python(
    tree: Node,
    vocabulary: Vocabulary = EMPTY_VOCABULARY,
    *,
    plain: bool = False,
    step_s: float | None = None,
) -> str:
    """The text of a Python module. Arguments and errors as in `behaviortree_cpp.to_xml`.

    Each named subtree becomes a separate function.
    """
    rejected_kinds = {"cooldown", *NAV2} if plain else NAV2
    check_kinds(tree, plain=plain, step_s=step_s, rejected_kinds=rejected_kinds)
    leaves = (node.args for node in walk(tree) if isinstance(node.args, ActionArgs))
    values = (value for args in leaves for _, value in args.values)
    if given := {key for value in values if (key := referenced(value)) in vocabulary.keys}:
        raise DomainError(
            f"Expected arguments without keys, as py_trees builds an action once, found"
            f' "{{{min(given)}}}"; export it as XML (--to btcpp), or read the key in the action.'
        )
    planned = _bound(plan(tree, None if plain else differs), vocabulary)
    if any(part.target == KINDS["cooldown"].ours for part in parts(planned)):
        planned = TargetNode(_COUNTER, (), (planned,))
    assigned = (node.args.assigned for node in walk(tree) if isinstance(node.args, SetArgs))
    divides = any(term.divides for term in (*asked_in(tree), *assigned))
    has_own_nodes = any(part.target.category for part in parts(planned))
    text = "".join(f"    {line}\n" for line in to_text(tree).splitlines())
    descriptions = {
        name: f"{key.meaning}; {key.kind}" if key.words else key.meaning
        for name, key in vocabulary.keys.items()
    } or dict.fromkeys(keys_in(tree), "")
    keys = "".join(
        f"    {name}: {meaning}".rstrip(": ") + "\n" for name, meaning in descriptions.items()
    )
    for name in sorted(names_in(tree)[0]):
        if uses := vocabulary.action(name).uses:
            text += f"\n    {name} uses {', '.join(uses)}, which no other action may use at once.\n"
    module = own_nodes("tree_module.txt")
    reserved = {*re.findall(r"\w+", module + _node_source()), *keyword.kwlist, *dir(builtins)}
    root, subtrees = separated(planned, reserved)
    functions = [_SUBTREE.format(name=n, tree=_body(part, step_s)) for n, part in subtrees.items()]
    return module.format(
        text=_in_docstring(text),
        keys=_in_docstring(keys).rstrip("\n"),
        own=(_node_source() if has_own_nodes else "")
        + (_SET_KEY if written_in(tree) else "")
        + (_DIVIDE if divides else ""),
        subtrees="".join(functions),
        tree=_body(root, step_s),
    )


def _bound(part: TargetNode, vocabulary: Vocabulary) -> TargetNode:
    """The plan with all arguments of actions as `Tree.bind` passes them to a leaf's function."""
    args = part.args
    if isinstance(args, ActionArgs) and (parameters := vocabulary.action(args.name).arguments):
        args = args._replace(values=tuple(bound(args, parameters).items()))
    children = tuple(_bound(child, vocabulary) for child in part.children)
    return part._replace(args=args, children=children)


def _in_docstring(text: str) -> str:
    return text.replace("\\", "\\\\").replace('"""', "'''")


def _body(part: TargetNode, step_s: float | None) -> str:
    return "\n".join(_lines(part, "    ", step_s)).strip().removesuffix(",")


def _node_source() -> str:
    """The source of the package's node classes, without docstring and imports."""
    text = own_nodes("islandgp_nodes.py")
    return text[text.index("class When(") :].rstrip() + "\n\n\n"


def _lines(part: TargetNode, indent: str, step_s: float | None) -> Iterator[str]:
    if part.target == CHECK:
        yield f"{indent}{_check(_guard(part).condition)},"
        return
    opening = _opening(part, step_s)
    if not part.children:
        yield f"{indent}{opening}),"
        return
    yield f"{indent}{opening}"
    for child in part.children[1:] if _is_guard(part) else part.children:
        yield from _lines(child, indent + "    ", step_s)
    yield f"{indent})," if opening.endswith("child=") else f"{indent}]),"


def _is_guard(part: TargetNode) -> bool:
    return part.target.tag == "ReactiveSequence" and part.children[0].target == CHECK


_COUNTER: Final = Target("TickCounter", (), "TickCounter('ticks', child=")


def _opening(part: TargetNode, step_s: float | None) -> str:
    """The Python text before a node's children."""
    args = part.args
    if part.target == SUBTREE:
        return f"{subtree_of(part)}(action"
    if isinstance(args, ActionArgs):
        reserved = any(keyword.iskeyword(name) for name, _ in args.values)
        keywords = "".join(f", {name}={value!r}" for name, value in args.values)
        keywords = f", **{dict(args.values)!r}" if reserved else keywords
        return f"action({args.name!r}{keywords}"
    if isinstance(args, AlwaysArgs):
        return f"{args.status.capitalize()}('always {args.status}'"
    if _is_guard(part):
        return f"EternalGuard({_condition(part)}, child="
    values: dict[str, object] = {}
    if isinstance(args, GuardArgs):
        values = {"condition": _condition(part), "abort": args.abort}
    if isinstance(args, ParallelArgs):
        policy = (
            "SuccessOnOne()" if args.success in ("one", 1) else "SuccessOnAll(synchronise=True)"
        )
        values = {**args._asdict(), "name": head(Node("parallel", args)), "policy": policy}
    if isinstance(args, SecondsArgs):
        ours = next(n for n, k in KINDS.items() if part.target in (k.stock, k.ours))
        ticks = None if step_s is None else args.ticks(step_s)
        seconds = number_text(args.seconds)
        values = {"name": head(Node(ours, args)), "seconds": seconds, "ticks": ticks}
    if isinstance(args, SetArgs):
        values = {"assignment": _assignment(args.assigned)}
    if isinstance(args, CountArgs):
        values = {"count": f"{args.times:.0f}"}
    return part.target.python.format(**values)


def _assignment(assigned: Condition) -> str:
    """A name, the key, the keys that its value reads, and the value, as arguments of SetKey."""
    number, other = assigned.number, assigned.other
    value = _value(other) if other else number_text(number)
    if isinstance(number, Named):
        value = {"no": "False", "yes": "True"}.get(number.name, repr(number.name))
    keys = other.keys if isinstance(other, Formula) else (other,) * bool(other)
    name = f"set {condition_text(assigned)}"
    return f"{name!r}, {assigned.key!r}, {[*keys]!r}, lambda blackboard: {value}"


def _guard(part: TargetNode) -> GuardArgs:
    assert isinstance(part.args, GuardArgs)
    return part.args


def _check(expr: ConditionExpr) -> str:
    """Behaviours of the library that succeed when a condition holds; they end in their tick."""
    if isinstance(expr, Condition):
        if not expr.single:
            name, keys = condition_text(expr), [*expr.keys]
            return f"Holds({name!r}, {keys!r}, lambda blackboard: {_expression(expr)})"
        compare, value = _comparison(expr)
        return f"check({expr.key!r}, operator.{compare}, {value})"
    inside = ", ".join(map(_check, expr.parts))
    if expr.word == "not":
        return f"Inverter('not', child={inside})"
    kind = "Sequence" if expr.word == "and" else "Selector"
    return f"{kind}({expr.word!r}, memory=False, children=[{inside}])"


def _condition(part: TargetNode) -> str:
    """A guard's name, keys and condition, as arguments of When and EternalGuard."""
    condition = _guard(part).condition
    keys = ", ".join(dict.fromkeys(repr(key) for term in terms(condition) for key in term.keys))
    return (
        f"{condition_text(condition)!r}, blackboard_keys=[{keys}],"
        f" condition=lambda blackboard: {_expression(condition)}"
    )


def _expression(expr: ConditionExpr) -> str:
    if isinstance(expr, Condition):
        compare, value = _comparison(expr)
        value = _value(expr.other) if expr.other else value
        return f"operator.{compare}({_value(expr.key)}, {value})"
    inside = [
        f"({_expression(part)})" if isinstance(part, Compound) else _expression(part)
        for part in expr.parts
    ]
    return f"not {inside[0]}" if expr.word == "not" else f" {expr.word} ".join(inside)


def _value(side: str) -> str:
    """The value of a key or a formula."""
    term = side.term if isinstance(side, Formula) else side
    return python(term, lambda key: f"blackboard.get({key!r})")


def _comparison(expr: Condition) -> tuple[str, str]:
    """The name of a function of `operator`, and its second argument."""
    if expr.operator in ("is", "not"):
        return "ne" if expr.operator == "is" else "eq", "0"
    value = number_text(expr.number)
    return _COMPARE[expr.operator], repr(value) if isinstance(expr.number, Named) else value
