"""Finds the comments and blank lines of a file, and the nodes to which they belong.

A comment on its own line belongs to the node below it, a comment at the end of a line to the node
before it, and one in the middle of a node is moved above it.
"""

from __future__ import annotations

import re
from bisect import bisect
from collections import defaultdict
from collections.abc import Iterator
from typing import Any, Final, NamedTuple

from islandgp.bt.core.kinds import NODES
from islandgp.bt.core.node import Comments

_ITEM: Final = re.compile(r'"[^"\n]*"|#[^\n]*|^[ \t]*$', re.MULTILINE)


class _Edge(NamedTuple):
    """A place where a part of a file begins or ends."""

    position: int
    start: int  # of the part
    before: str  # the field of its Comments for what is on own lines before the place
    behind: str  # and for what follows on the same line


def comments_in(text: str, file: Any, *, blank_lines: bool = False) -> dict[int, Comments]:
    """The comments of the nodes and statements of a lark.Tree, by the positions of their starts.

    Those behind the last one are at the end of the text, as `above`. `blank_lines`: with the blank
    lines, of which several in a row count as one.
    """
    edges = sorted([*_edges(text, file), _Edge(len(text) + 1, len(text), "above", "")])
    positions = [edge.position for edge in edges]
    found: dict[int, dict[str, list[str]]] = defaultdict(lambda: defaultdict(list))
    for match in _ITEM.finditer(text):
        position, item = match.start(), match[0].rstrip()
        if item[:1] == '"' or not (item or blank_lines):
            continue
        at = bisect(positions, position)
        start, field = edges[at].start, edges[at].before
        if at and text[text.rfind("\n", 0, position) + 1 : position].strip():
            start, field = edges[at - 1].start, edges[at - 1].behind
        lines = found[start][field]
        if item or (lines[-1:] != [""] and (field == "inside" or position < start)):
            lines.append(item)
    return {
        start: Comments(**{field: tuple(lines) for field, lines in fields.items()})
        for start, fields in found.items()
    }


def _edges(text: str, file: Any) -> Iterator[_Edge]:
    code = _ITEM.sub(lambda match: " " * len(match[0]), text)
    waiting = [*file.children]
    while waiting:
        tree = waiting.pop()
        start, end = tree.meta.start_pos, tree.meta.end_pos
        below = [each for each in tree.children if getattr(each, "data", "") in NODES]
        waiting += below
        if tree.data == "subtree":  # what is above it belongs to its tree
            yield _Edge(start, below[0].meta.start_pos, "above", "above")
            continue
        yield _Edge(start, start, "above", "above")
        if below:
            yield _Edge(code.index("{", start) + 1, start, "above", "aside")
        yield _Edge(end, start, *(("inside", "end") if below else ("above", "aside")))
