"""`fmt`: a tree file in canonical form, with its comments and named subtrees.

A file without comments, subtrees and blank lines comes out as `to_text` prints
its tree. Otherwise each comment keeps its place: lines of their own stay above
the node they stood above, a comment at the end of a line stays at its end, and
one in the middle of a node moves above it. At most one blank line stays where
some were.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from pathlib import Path

from islandgp.bt.language import MAX_CHARACTERS, parse
from islandgp.bt.printer import INDENT, INLINE_LEVELS, WIDTH, head
from islandgp.bt.syntax import Comment, Definition, File, Statement, Written, read
from islandgp.errors import LimitError


def format_text(text: str, *, name: str = "<tree>", folder: Path | None = None) -> str:
    """The canonical form of a file; formatting it again changes nothing.

    It need not hold a tree; `folder`: that of the file, for what it includes.

    Raises:
        TreeError: the text is not a tree of the language.
        LimitError: its canonical form would be too long to be read again.
    """
    if not text.strip("\ufeff \t\r\n"):
        parse(text, name=name)  # says what is missing
    lines = list(_file(read(text, name=name, folder=folder, library=True)))
    formatted = "\n".join(lines).lstrip("\n") + "\n"
    if len(formatted) > MAX_CHARACTERS:
        raise LimitError(
            f"{name}: expected a canonical form of at most {MAX_CHARACTERS} characters, found"
            f" {len(formatted)}; shorten the tree or its comments."
        )
    return formatted


def _file(file: File) -> Iterator[str]:
    for index, line in enumerate(file.head):
        yield from _line(line)
        following = file.head[index + 1 : index + 2] or file.definitions[:1]
        rest = following[0] if following else file.root
        if isinstance(rest, Statement) and rest.text.startswith("include") == line.text.startswith(
            "include"
        ):
            continue
        first = rest.body if isinstance(rest, Definition) else rest
        if first is not None and not (
            first.blank_before or any(c.blank_before for c in first.before[:1])
        ):
            yield ""
    for definition in file.definitions:
        if isinstance(definition, Statement):
            yield from _line(definition)
            continue
        lead = f"subtree {definition.name}"
        if definition.parameters:
            lead += f"({', '.join(definition.parameters)})"
        yield from _node(definition.body, "", f"{lead} = ")
    if file.root is not None:
        root = list(_node(file.root, ""))
        if file.definitions and root[0]:
            yield ""
        yield from root
    yield from _comments(file.at_end, "")


def _line(line: Statement) -> Iterator[str]:
    yield from _comments(line.before, "")
    if line.blank_before:
        yield ""
    yield line.text + (f"  {line.behind}" if line.behind else "")


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
    yield f"{start}{head(written.node)} {{" + (f"  {written.inside}" if written.inside else "")
    inside = [line for child in written.children for line in _node(child, indent + INDENT)]
    inside += _comments(written.at_end, indent + INDENT)
    yield from inside[1:] if not inside[0] else inside  # no blank line behind the brace
    yield f"{indent}}}{behind}"


def _comments(comments: Iterable[Comment], indent: str) -> Iterator[str]:
    for comment in comments:
        if comment.blank_before:
            yield ""
        yield f"{indent}{comment.text}"


def _inline(written: Written, levels: int) -> str | None:
    """The node on one line, as the printer would; None if it does not fit or has comments."""
    children = written.children
    if not children:
        return head(written.node)
    if written.inside or written.at_end or any(c.before or c.behind for c in children):
        return None
    if levels == 1 or (len(children) > 1 and any(c.children for c in children)):
        return None
    inside = [_inline(child, levels - 1) for child in children]
    if None in inside:
        return None
    return f"{head(written.node)} {{ {' '.join(map(str, inside))} }}"
