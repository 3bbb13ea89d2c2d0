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
    UseArgs,
    Value,
    commented,
    comments_of,
    names_of,
    walk,
)

WIDTH = 80  # columns of a line
INDENT = "  "
INLINE_LEVELS = 3  # most levels in one line


class Quoted(str):
    """A text that needs its double quotes: without them it would be a constant or a parameter."""

    __slots__ = ()


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
    return "\n".join(_lines(node, "")) + "\n"


def with_subtrees(tree: Node, *, comments: bool = True) -> str:
    """The text of a tree with its named subtrees defined above it, and with its comments.

    A name defines the first tree with this name; a different one is printed at its use.
    """
    bodies: dict[str, Node] = {}
    texts: list[str] = []

    def text(node: Node, lead: str = "") -> str:
        return "\n".join(_lines(node, "", lead, comments=comments)) + "\n"

    def define(node: Node) -> Node:
        *above, own = comments_of(node)
        plain = Node(node.kind, node.args, tuple(map(define, node.children)))
        inner = commented(plain, own)
        for name, lines in zip(reversed(names_of(node)), reversed(above), strict=True):
            if name not in bodies:
                bodies[name] = inner
                texts.append(text(inner, f"subtree {name} = "))
            if bodies[name] == inner:
                inner = Node("use", UseArgs(name))
            inner = commented(inner, lines)
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
    if isinstance(args, UseArgs):
        return f"use {use_text(*args)}"
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
    """A number or a word; other texts are in double quotes."""
    if not isinstance(value, str):
        return number_text(value)
    bare = NAME.fullmatch(value) and value not in RESERVED and not isinstance(value, Quoted)
    return value if bare else f'"{value}"'


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


def _lines(node: Node, indent: str, lead: str = "", *, comments: bool = False) -> list[str]:
    """The lines of a node; `lead` is the text before its head, `comments`: with those above it."""
    above = comments_of(node) if comments else ()
    lines = [f"{indent}# {text}" for texts in above for text in texts]
    line = None if comments and _has_comments_below(node) else inline(node, INLINE_LEVELS)
    if line is not None and (len(indent) + len(line) <= WIDTH or not node.children):
        lines.append(f"{indent}{lead}{line}")
        return lines
    lines.append(f"{indent}{lead}{head(node)} {{")
    for child in node.children:
        lines += _lines(child, indent + INDENT, comments=comments)
    lines.append(f"{indent}}}")
    return lines


def _has_comments_below(node: Node) -> bool:
    return any(comments_of(each) != ((),) for child in node.children for each in walk(child))


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
