"""Prints trees as canonical text, the genome in records, caches and messages.

Equal trees have equal texts, and parsing a text returns an equal tree.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache
from typing import Any

from islandgp.bt.core.arithmetic import Named as Named
from islandgp.bt.core.arithmetic import number_text as number_text
from islandgp.bt.core.condition import Compound, ConditionExpr
from islandgp.bt.core.kind import Argument, Sort
from islandgp.bt.core.kinds import CALLABLE, KINDS, NAME, RESERVED
from islandgp.bt.core.node import (
    ActionArgs,
    Node,
    Value,
    WrittenArgs,
    commented,
    marked,
    marks_of,
    walk,
)

WIDTH = 80  # columns of a line
INDENT = "  "
INLINE_LEVELS = 3  # most levels in one line


@lru_cache(maxsize=256)  # a run asks for each tree of a generation several times
def to_text(node: Node) -> str:
    """Prints a tree as its canonical text.

    A node is printed on one line if it fits, is at most three levels deep and
    its composites have leaves only. Defaults are not printed.

    Args:
        node: the root of the tree.

    Returns:
        The text, with a line end after the last line; `parse` of it returns an equal tree.
    """
    return "\n".join(lines_of(node)) + "\n"


def with_subtrees(tree: Node) -> str:
    """The text of a tree with its named subtrees defined above it, and with its comments.

    A name defines the first tree with this name; a different one is printed at its use.
    """
    bodies: dict[str, Node] = {}
    texts: list[str] = []

    def text(node: Node, lead: str = "") -> str:
        return "\n".join(written_lines(node, lead)) + "\n"

    def define(node: Node) -> Node:
        *uses, own = marks_of(node)
        inner: Node = marked(node._replace(children=tuple(map(define, node.children))), own)
        for use in reversed(uses):
            if use.name not in bodies:
                bodies[use.name] = inner
                texts.append(text(inner, f"subtree {use.name} = "))
            if bodies[use.name] == inner:
                inner = marked(Node("use", WrittenArgs(f"use {use.name}")), use)
            else:
                inner = commented(inner, use.comments.lines)
        return inner

    root = define(tree)
    return "\n".join([*texts, text(root)])


def use_text(name: str, arguments: Sequence[str]) -> str:
    """The text after `use`: `recharge`, `recharge(20, 3)`."""
    return f"{name}({', '.join(arguments)})" if arguments else name


def head(node: Node) -> str:
    """The text of a node before its brace, e.g. `when charge < 25`; of a leaf, all of it."""
    args = node.args
    if isinstance(args, ActionArgs):
        return call_text(*args)
    if isinstance(args, WrittenArgs):
        return args.head
    arguments = KINDS[node.kind].arguments
    if not arguments and not args:
        return node.kind
    pairs = zip(arguments, args, strict=True)
    return " ".join([node.kind, *filter(None, [_argument(arg, value) for arg, value in pairs])])


def call_text(action: str, values: Sequence[tuple[str, Value]]) -> str:
    """An action with the values of its arguments: `MoveTo(goal: dock, speed: 0.5)`."""
    if not values:
        return f"{action}()" if action in CALLABLE else action
    arguments = [f"{name}: {_value_text(value)}" for name, value in values]
    return f"{action}({', '.join(arguments)})"


def _value_text(value: Value) -> str:
    """A number or a word; other texts are in double quotes, which `fmt` keeps where they matter."""
    if not isinstance(value, str):
        return number_text(value)
    bare = NAME.fullmatch(value) and value not in RESERVED
    return value if bare or value[:1] == '"' else f'"{value}"'


def _argument(argument: Argument, value: Any) -> str:
    """The text of an argument after its node's keyword; "" for its default."""
    if argument.sort in (Sort.CONDITION, Sort.ASSIGNMENT):
        return condition_text(value)
    text = value if isinstance(value, str) else number_text(value)
    if argument.default is None:
        return text
    return "" if value == argument.default else f"{argument.name} {text}"


def condition_text(expr: ConditionExpr, *, brackets: bool = False) -> str:
    """A condition as text; with `brackets`, a joined condition is in brackets."""
    if isinstance(expr, Compound):
        if expr.word == "not":
            return f"not {condition_text(expr.parts[0], brackets=True)}"
        # `and` binds more tightly than `or`, so only an `or` in an `and` needs them.
        inside = [condition_text(part, brackets=expr.word == "and") for part in expr.parts]
        text = f" {expr.word} ".join(inside)
        return f"({text})" if brackets else text
    if expr.operator == "is":
        return expr.key
    if expr.operator == "not":
        return f"not {expr.key}"
    return f"{expr.key} {expr.operator} {expr.other or number_text(expr.number)}"


def lines_of(node: Node, indent: str = "") -> list[str]:
    """The lines of a node, without comments."""
    line = inline(node, INLINE_LEVELS)
    if line is not None and (len(indent) + len(line) <= WIDTH or not node.children):
        return [f"{indent}{line}"]
    inside = [line for child in node.children for line in lines_of(child, indent + INDENT)]
    return [f"{indent}{head(node)} {{", *inside, f"{indent}}}"]


def written_lines(node: Node, lead: str = "", indent: str = "") -> list[str]:
    """The lines of a node with its comments; `lead` is the text before its head.

    A long condition is broken before its `and`s or `or`s.
    """
    comments = marks_of(node)[-1].comments
    above, closing = (
        [line and f"{place}{line}" for line in each]
        for place, each in ((indent, comments.above), (indent + INDENT, comments.inside))
    )
    line = None if _has_comments_inside(node) else inline(node, INLINE_LEVELS)
    if line is not None and (len(indent + lead + line) <= WIDTH or not node.children):
        return [*above, beside(f"{indent}{lead}{line}", comments.aside or comments.end)]
    *first, last = _head_lines(node, f"{indent}{lead}{head(node)} {{")
    inside = [line for child in node.children for line in written_lines(child, "", indent + INDENT)]
    inside = [*inside[inside[0] == "" :], *closing]
    if inside[-1] == "":
        inside.pop()
    end = beside(f"{indent}}}", comments.end)
    return [*above, *first, beside(last, comments.aside), *inside, end]


def _has_comments_inside(node: Node) -> bool:
    """True if there are comments between its braces, or behind the first one."""
    own = marks_of(node)[-1].comments
    below = (mark.comments.lines for c in node.children for n in walk(c) for mark in marks_of(n))
    return bool(node.children) and any((*own.aside, *own.inside, *below))


def beside(line: str, comments: Sequence[str]) -> str:
    """A line with comments at its end."""
    return "  ".join([line, *comments])


def _head_lines(node: Node, line: str) -> list[str]:
    """The line of a node's head, or the lines of a long condition."""
    expr = node.guard.condition if node.guard else None
    if len(line) <= WIDTH or not isinstance(expr, Compound) or expr.word == "not":
        return [line]
    indent = " " * (len(line) - len(line.lstrip())) + 2 * INDENT
    first, *parts = (condition_text(part, brackets=expr.word == "and") for part in expr.parts)
    before, _, behind = line.partition(condition_text(expr))
    lines = [before + first, *(f"{indent}{expr.word} {part}" for part in parts)]
    return [*lines[:-1], lines[-1] + behind]


def inline(node: Node, levels: int) -> str | None:
    """The node as one line of any length; None if it is nested too deeply for one line."""
    if not node.children:
        return head(node)
    if levels == 1:
        return None
    if len(node.children) == 1:
        inside = inline(node.children[0], levels - 1)
    elif any(child.children for child in node.children):
        inside = None
    else:
        inside = " ".join([head(child) for child in node.children])
    return None if inside is None else f"{head(node)} {{ {inside} }}"
