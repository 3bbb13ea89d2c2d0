"""`fmt`: a tree file in canonical form, with its comments and named subtrees.

A file without comments, subtrees and blank lines comes out as `to_text` prints
its tree. Otherwise each comment keeps its place: lines of their own stay above
the node they stood above, a comment at the end of a line stays at its end, and
one in the middle of a node moves above it. At most one blank line stays where
some were.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator

from islandgp.bt.comments import Comment
from islandgp.bt.language import MAX_CHARACTERS
from islandgp.bt.node import Node
from islandgp.bt.printer import INDENT, INLINE_LEVELS, WIDTH, head
from islandgp.bt.syntax import File, Written, read
from islandgp.errors import LimitError


def format_text(text: str, *, name: str = "<tree>") -> str:
    """The canonical form of a file; formatting it again changes nothing.

    Raises:
        TreeError: the text is not a tree of the language.
        LimitError: its canonical form would be too long to be read again.
    """
    lines = list(_file(read(text, name=name)))
    formatted = "\n".join(lines).lstrip("\n") + "\n"
    if len(formatted) > MAX_CHARACTERS:
        raise LimitError(
            f"{name}: expected a canonical form of at most {MAX_CHARACTERS} characters, found"
            f" {len(formatted)}; shorten the tree or its comments."
        )
    return formatted


def _file(file: File) -> Iterator[str]:
    if file.domain is not None:
        yield from _comments(file.domain.before, "")
        if file.domain.blank_before:
            yield ""
        behind = f"  {file.domain.behind}" if file.domain.behind else ""
        yield f"domain {file.domain.name}{behind}"
        first = file.definitions[0].body if file.definitions else file.root
        if not (first.blank_before or any(c.blank_before for c in first.before[:1])):
            yield ""
    for definition in file.definitions:
        yield from _node(definition.body, "", f"subtree {definition.name} = ")
    root = list(_node(file.root, ""))
    if file.definitions and root[0]:
        yield ""
    yield from root
    yield from _comments(file.at_end, "")


def _node(written: Written, indent: str, lead: str = "") -> Iterator[str]:
    """The lines of a node with what stands above it; `lead` stands before its head."""
    yield from _comments(written.before, indent)
    if written.blank_before:
        yield ""
    behind = f"  {written.behind}" if written.behind else ""
    start = indent + lead
    inline = _inline(written, INLINE_LEVELS)
    if inline is not None and (len(start) + len(inline) <= WIDTH or not written.children):
        yield f"{start}{inline}{behind}"
        return
    yield f"{start}{_head(written.node)} {{" + (f"  {written.inside}" if written.inside else "")
    inside = [line for child in written.children for line in _node(child, indent + INDENT)]
    inside += _comments(written.at_end, indent + INDENT)
    yield from inside[1:] if not inside[0] else inside  # no blank line behind the brace
    yield f"{indent}}}{behind}"


def _comments(comments: Iterable[Comment], indent: str) -> Iterator[str]:
    for comment in comments:
        if comment.blank_before:
            yield ""
        yield f"{indent}{comment.text}"


def _head(node: Node) -> str:
    return f"use {node.args[0]}" if node.kind == "use" else head(node)


def _inline(written: Written, levels: int) -> str | None:
    """The node on one line, as the printer would; None if it does not fit or has comments."""
    children = written.children
    if not children:
        return _head(written.node)
    if written.inside or written.at_end or any(c.before or c.behind for c in children):
        return None
    if levels == 1 or (len(children) > 1 and any(c.children for c in children)):
        return None
    inside = [_inline(child, levels - 1) for child in children]
    if None in inside:
        return None
    return f"{_head(written.node)} {{ {' '.join(map(str, inside))} }}"
