"""`fmt`: formats a tree file, and keeps its comments and named subtrees.

A file without comments, subtrees, blank lines and long conditions comes out as
`to_text` prints its tree. Otherwise each comment keeps its place: a comment on its own line
stays above the node below it, a comment at the end of a line stays at its end, and
one in the middle of a node moves above it. Consecutive blank lines become one.
"""

from __future__ import annotations

from pathlib import Path

from islandgp.bt.core.builder import Builder
from islandgp.bt.core.kinds import NODES
from islandgp.bt.core.language import MAX_CHARACTERS, files_of, parse
from islandgp.bt.core.printer import beside, number_text, use_text, written_lines
from islandgp.errors import LimitError


def format_text(text: str, *, name: str = "<tree>", folder: Path | None = None) -> str:
    """The canonical form of a file; formatting it again changes nothing.

    The file need not have a tree; `folder` is that of the file, for included files.

    Raises:
        TreeError: the text is not a tree of the language.
        LimitError: its canonical form would be too long to be read again.
    """
    if not text.strip("\ufeff \t\r\n"):
        parse(text, name=name)  # raises the error
    parts = files_of(text, name=name, folder=folder, start="library")
    builder = Builder(None, marks=True, named=True, written=True)
    root = builder.build(parts)
    bodies = iter(builder.bodies)
    lines: list[str] = []
    last = ""
    for tree in parts[-1].tree.children:
        comments = builder.comments_at(tree)
        match str(tree.data), tree.children:
            case "subtree", [defined, *parameters, _]:
                names = [builder.parameter_text(p) for each in parameters for p in each.children]
                part = written_lines(next(bodies), f"subtree {use_text(defined, names)} = ")
            case "constant", [defined, value]:
                number = value if value.type == "NAME" else number_text(float(value) + 0.0)
                part = [*comments.above, beside(f"constant {defined} = {number}", comments.aside)]
            case "domain" | "include" as statement, [word]:
                part = [*comments.above, beside(f"{statement} {word}", comments.aside)]
            case _:
                part = written_lines(root)
        is_apart = last in ("domain", "include") or tree.data in NODES
        if lines and is_apart and last != tree.data and part[0]:
            lines.append("")
        lines += part
        last = str(tree.data)
    end = builder.comments_at(None).above
    formatted = "\n".join([*lines, *end]).strip("\n") + "\n"
    if len(formatted) > MAX_CHARACTERS:
        raise LimitError(
            f"{name}: expected a canonical form of at most {MAX_CHARACTERS} characters, found"
            f" {len(formatted)}; shorten the tree or its comments."
        )
    return formatted
