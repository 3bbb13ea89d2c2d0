"""`fmt`: formats a tree file, and keeps its comments and named subtrees.

A file without comments, subtrees, blank lines and long conditions comes out as
`to_text` prints its tree. Otherwise each comment keeps its place: a comment on its own line
stays above the node below it, a comment at the end of a line stays at its end, and
one in the middle of a node moves above it. Consecutive blank lines become one.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator
from itertools import pairwise, zip_longest
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final, NamedTuple

from islandgp.bt.core.builder import Builder
from islandgp.bt.core.condition import Compound
from islandgp.bt.core.includes import ParsedFile
from islandgp.bt.core.kinds import KINDS
from islandgp.bt.core.language import MAX_CHARACTERS, built, files_of, parse, words
from islandgp.bt.core.node import Node
from islandgp.bt.core.printer import (
    INDENT,
    INLINE_LEVELS,
    WIDTH,
    condition_text,
    head,
    inline,
    number_text,
)
from islandgp.errors import LimitError

if TYPE_CHECKING:
    from lark import Token

_BETWEEN: Final = re.compile(r"\n|#[^\n]*")  # what matters between two words
_STATEMENTS: Final = ("domain", "include", "constant")
_NODES: Final = (*KINDS, "use")


def format_text(text: str, *, name: str = "<tree>", folder: Path | None = None) -> str:
    """The canonical form of a file; formatting it again changes nothing.

    The file need not have a tree; `folder` is that of the file, for included files.

    Raises:
        TreeError: the text is not a tree of the language.
        LimitError: its canonical form would be too long to be read again.
    """
    if not text.strip("\ufeff \t\r\n"):
        parse(text, name=name)  # raises the error
    parts = files_of(text, name=name, folder=folder, start="library", placed=True)
    builder = Builder(parts[-1].source, None)
    built(builder, parts)
    formatted = "\n".join(_Formatter(parts[-1], builder).lines()).lstrip("\n") + "\n"
    if len(formatted) > MAX_CHARACTERS:
        raise LimitError(
            f"{name}: expected a canonical form of at most {MAX_CHARACTERS} characters, found"
            f" {len(formatted)}; shorten the tree or its comments."
        )
    return formatted


class _Comment(NamedTuple):
    """A comment on a separate line."""

    text: str  # with its #
    blank_before: bool  # after a blank line


class _Word(NamedTuple):
    """A word with the comments around it."""

    token: Token
    before: tuple[_Comment, ...]  # own lines above it
    blank_before: bool
    behind: str  # comment on its line, before the next word


class _Formatter:
    """Adds the comments and blank lines of a file to its parsed parts."""

    def __init__(self, part: ParsedFile, builder: Builder) -> None:
        """`builder` has built the file."""
        self._file, self._builder = part.tree, builder
        self._words = list(_words_of(part.source.text))
        self._first = {word.token.start_pos: i for i, word in enumerate(self._words)}
        self._behind = {word.token.end_pos: i for i, word in enumerate(self._words, 1)}

    def lines(self) -> Iterator[str]:
        """The lines of the whole file."""
        trees, defined = self._file.children, False
        for tree, following in zip_longest(trees, trees[1:]):
            lines = list(self._part(tree))
            if defined and tree.data in _NODES and lines[0]:
                yield ""
            yield from lines
            defined |= tree.data in ("constant", "subtree")
            if following is not None and self._apart(tree, following):
                yield ""
        yield from _own_lines(self._words[-1].before, False, "")

    def _apart(self, tree: Any, following: Any) -> bool:
        """True if a blank line follows the domain or an include."""
        if tree.data not in ("domain", "include"):
            return False
        same = (tree.data == "include") == (following.data == "include")
        before, blank = self._above(following)
        has_blank = blank or any(comment.blank_before for comment in before[:1])
        return not has_blank and not (same and following.data in _STATEMENTS)

    def _part(self, tree: Any) -> Iterator[str]:
        """The lines of a statement, a definition or the tree."""
        if tree.data == "subtree":
            name, *parameter_lists, body = tree.children
            parameters = [token for each in parameter_lists for token in each.children]
            parameter_list = f"({', '.join(parameters)})" if parameters else ""
            node = self._builder.written_tree(body, parameters)
            yield from self._node(tree, node, "", f"subtree {name}{parameter_list} = ")
            return
        if tree.data not in _STATEMENTS:
            yield from self._node(tree, self._builder.written_tree(tree, ()), "")
            return
        first, behind = self._span(tree)
        part_words = self._words[first:behind]
        texts = [str(word.token) for word in part_words]
        if part_words[-1].token.type == "NUMBER":
            texts[-1] = number_text(float(texts[-1]) + 0.0)  # no -0
        yield from _own_lines(*self._above(tree), "")
        yield " ".join(texts) + _aside(part_words[-1].behind)

    def _node(self, tree: Any, node: Node, indent: str, lead: str = "") -> Iterator[str]:
        """The lines of a node with the comments above it; `lead` is the text before its head."""
        yield from _own_lines(*self._above(tree), indent)
        brace, behind = self._head_end(tree) - 1, self._span(tree)[1]
        last = self._words[behind - 1]
        start, line = indent + lead, inline(node, INLINE_LEVELS)
        fits = line is not None and len(start) + len(line) <= WIDTH
        if not node.children or (fits and not self._commented(brace, behind)):
            yield f"{start}{line}{_aside(last.behind)}"
            return
        *lines, last_line = _lines_of(f"{start}{head(node)} {{", node)
        yield from lines
        yield f"{last_line}{_aside(self._words[brace].behind)}"
        inside: list[str] = []
        for below, child in zip(_below(_body(tree)), node.children, strict=True):
            inside += self._node(below, child, indent + INDENT)
        inside += _own_lines(last.before, False, indent + INDENT)
        yield from inside[1:] if not inside[0] else inside  # no blank line behind the brace
        yield f"{indent}}}{_aside(last.behind)}"

    def _span(self, tree: Any) -> tuple[int, int]:
        """The index of a tree's first word, and the index behind its last."""
        return self._first[tree.meta.start_pos], self._behind[tree.meta.end_pos]

    def _head_end(self, tree: Any) -> int:
        """The index after the first line of a node: after its brace, or after all of it."""
        below = _below(_body(tree))
        return self._span(below[0])[0] if below else self._span(tree)[1]

    def _commented(self, brace: int, behind: int) -> bool:
        """True if there are comments between the braces or after the first one."""
        inside = pairwise(self._words[brace:behind])
        return any(word.behind or following.before for word, following in inside)

    def _above(self, tree: Any) -> tuple[tuple[_Comment, ...], bool]:
        """The comments above a head, those inside it too, and whether a blank line precedes it."""
        head_words = self._words[self._span(tree)[0] : self._head_end(tree)]
        loose: list[str] = []
        for before, word in pairwise(head_words):
            loose += [before.behind] if before.behind else []
            loose += [comment.text for comment in word.before]
        blank = head_words[0].blank_before
        if not loose:
            return head_words[0].before, blank
        first, *others = loose
        moved = (_Comment(first, blank), *(_Comment(text, False) for text in others))
        return (*head_words[0].before, *moved), False


def _lines_of(line: str, node: Node) -> Iterator[str]:
    """The line of a node's head; a long condition is broken before its `and`s or `or`s."""
    expr = node.guard.condition if node.guard else None
    if len(line) <= WIDTH or not isinstance(expr, Compound) or expr.word == "not":
        yield line
        return
    indent = " " * (len(line) - len(line.lstrip())) + 2 * INDENT
    first, *parts = (condition_text(part, brackets=expr.word == "and") for part in expr.parts)
    before, _, behind = line.partition(condition_text(expr))
    rows = [before + first, *(f"{indent}{expr.word} {part}" for part in parts)]
    rows[-1] += behind
    yield from rows


def _body(tree: Any) -> Any:
    """The node of a definition; a node itself."""
    return tree.children[-1] if tree.data == "subtree" else tree


def _below(tree: Any) -> list[Any]:
    """The children of a node; of anything else none."""
    return [each for each in tree.children if getattr(each, "data", "") in _NODES]


def _own_lines(comments: Iterable[_Comment], blank_behind: bool, indent: str) -> Iterator[str]:
    """Comments on separate lines, with the blank line after them."""
    for comment in comments:
        if comment.blank_before:
            yield ""
        yield f"{indent}{comment.text}"
    if blank_behind:
        yield ""


def _aside(comment: str) -> str:
    """A comment at the end of a line."""
    return f"  {comment}" if comment else ""


def _words_of(text: str) -> Iterator[_Word]:
    """The words of a text that `parse` accepts; last an empty word for the end of the text."""
    from lark import Token

    tokens = [*words(text), Token("END", "", start_pos=len(text), end_pos=len(text))]
    ends = [0, *(token.end_pos for token in tokens)]
    gaps = [
        _between(text[end : token.start_pos], first=end == 0)
        for end, token in zip(ends, tokens, strict=False)
    ]
    asides = [*(gap[0] for gap in gaps[1:]), ""]
    for token, (_, before, blank), behind in zip(tokens, gaps, asides, strict=True):
        yield _Word(token, before, blank, behind)


def _between(gap: str, *, first: bool) -> tuple[str, tuple[_Comment, ...], bool]:
    """Between two words: the comment on the line of the first one, those on own lines, and
    whether a blank line precedes the second word."""
    trailing = ""
    comment_lines: list[_Comment] = []
    ends = 1 if first else 0  # line ends since the last word or comment; a text begins a line
    blank = False
    for match in _BETWEEN.finditer(gap):
        if match[0] == "\n":
            ends += 1
            blank = ends > 1 and not (first and not comment_lines)
        elif ends == 0:
            trailing = match[0].rstrip()
        else:
            comment_lines.append(_Comment(match[0].rstrip(), blank))
            ends, blank = 0, False
    return trailing, tuple(comment_lines), blank
