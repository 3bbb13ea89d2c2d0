"""Forms that are short for several nodes: `for` and `switch`."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Final

from islandgp.bt.core.builder import Builder
from islandgp.bt.core.node import Node, WrittenArgs, sequence, switch
from islandgp.bt.core.node_builder import KEY, Tree
from islandgp.bt.core.source import Word


def _for(builder: Builder, tree: Tree, level: int) -> Node:
    """A sequence of the child, with each argument of the list in place of the name."""
    _, name, *arguments, body = tree.children
    builder.count(name, level)

    def child(word: Word) -> Node:
        values = {**builder.values, str(name): word}
        return builder.inside(body, builder.source, values, level + 1, name)

    if builder.written:
        texts = ", ".join(map(builder.argument_text, arguments))
        child_node = child(Word(name, builder.source, open=True))
        return Node("for", WrittenArgs(f"for {name} in [{texts}]"), (child_node,))
    words = [builder.passed(each, f"{name} of the `for`") for each in arguments]
    return sequence(*map(child, words))


def _switch(builder: Builder, tree: Tree, level: int) -> Node:
    """A selector of guards, one for each value of a key, and one for all others."""
    _, name, *cases = tree.children
    builder.count(name, level)
    key = builder.word(name, KEY)
    tests = [builder.compare(key, "==", case.children[0]) for case in cases if case.data == "case"]
    branches = [builder.node(case, level + 1) for case in cases]
    if builder.written:
        return Node("switch", WrittenArgs(f"switch {name}"), tuple(branches))
    return switch(tests, branches)


def _case(builder: Builder, tree: Tree, level: int) -> Node:
    value, body = tree.children
    builder.count(value, level)
    child = builder.node(body, level + 1)
    return Node("case", WrittenArgs(str(value)), (child,)) if builder.written else child


BUILDERS: Final[Mapping[str, Callable[[Builder, Tree, int], Node]]] = {
    "for": _for,
    "switch": _switch,
    "case": _case,
    "otherwise": _case,
}
"""By the rule of the grammar."""
