"""From text to tree and back: `parse` and `to_text`.

The grammar is `grammar/bt.lark`. Time and memory of parsing are bounded: any invalid
text raises a `TreeError` quickly.
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterator, Sequence
from functools import cache
from itertools import pairwise
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final, NamedTuple

from islandgp.bt.core.builder import Builder
from islandgp.bt.core.condition import ConditionExpr
from islandgp.bt.core.includes import MAX_CHARACTERS as MAX_CHARACTERS
from islandgp.bt.core.includes import ParsedFile, load_includes
from islandgp.bt.core.kind import Sort
from islandgp.bt.core.kinds import CALLABLE, KEYWORDS, KINDS, SHORT, UNLIMITED
from islandgp.bt.core.node import Node, Place, guard_of, marks_of
from islandgp.bt.core.printer import to_text as to_text
from islandgp.bt.core.source import Source, plain, shown
from islandgp.bt.core.vocabulary import Vocabulary
from islandgp.errors import ConfigError, LimitError, OtherDomainError, TreeError
from islandgp.resources import resource

if TYPE_CHECKING:
    from lark import Lark

_GAP: Final = r"(?:[ \t\n]|#[^\n]*+)"  # between two words; possessive, so that it cannot backtrack
_CALL: Final = rf"{_GAP}*+\({_GAP}*+(?:\)|[A-Za-z_][A-Za-z0-9_]*+{_GAP}*+:)"
"""The parentheses behind an action that is named like a node kind."""
_DOMAIN: Final = re.compile(rf"{_GAP}*+domain{_GAP}++([A-Za-z_][A-Za-z0-9_]*)")


def parse(
    text: str,
    vocabulary: Vocabulary | None = None,
    *,
    name: str = "<tree>",
    folder: Path | None = None,
    marked: bool = False,
) -> Node:
    """Parses the text of one tree.

    Args:
        text: one tree in the language, optionally after named subtrees. Line ends
            of any system and a leading byte order mark are accepted.
        vocabulary: the permitted actions and keys. None: only grammar and sizes are
            checked, as for records that were checked when written.
        name: of the text in error messages, e.g. its file name.
        folder: of the file with the text; included files are there or below. None: the
            text is not from a file and cannot include files.
        marked: mark nodes with their comments and the names of subtrees: `MarkedNode`.

    Returns:
        The root node, with every `use` expanded.

    Raises:
        TreeError: the text is not a tree of the language; the message shows the
            place and the accepted words.
        UnknownNameError: an action, a key, a constant or a subtree does not exist.
        OtherDomainError: the text names another domain.
        LimitError: the text is too long, or the tree too deep or too large for any
            limit on trees.
    """
    parts = files_of(text, vocabulary, name=name, folder=folder)
    return _built(Builder(vocabulary, marks=marked), parts)


def tree_errors(
    text: str, vocabulary: Vocabulary | None, *, name: str, folder: Path | None
) -> list[TreeError]:
    """The distinct errors in a text, in its order. Arguments as in `parse`.

    All errors of names and numbers, or else the first syntax error.
    """
    errors: list[TreeError] = []
    try:
        parts = files_of(text, vocabulary, name=name, folder=folder)
        _built(Builder(vocabulary, errors=errors), parts)
    except TreeError as error:
        errors.append(error)
    return list({str(error): error for error in errors}.values())


class SourceSpan(NamedTuple):
    """The place of a node in its file; a node of an included subtree has that of its use."""

    line: int  # from 1
    column: int
    origin: Place  # the same for all uses of a node of a subtree
    uses: tuple[tuple[int, int], ...] = ()  # places of the uses around it, the outermost first


class PlacedTree(NamedTuple):
    """The tree that a text means, with the places of its nodes."""

    node: Node
    places: list[SourceSpan]  # of each node, in document order
    unused: list[tuple[str, int, int, str]]  # definitions: (kind, line, column, name)


def parse_placed(
    text: str,
    vocabulary: Vocabulary | None = None,
    *,
    name: str = "<tree>",
    folder: Path | None = None,
    named: bool = True,
) -> PlacedTree:
    """The tree of a text with the places of its nodes. Arguments and errors as in `parse`.

    `named`: numbers of constants and parameters are printed by their names.
    """
    parts = files_of(text, vocabulary, name=name, folder=folder)
    node = _built(Builder(vocabulary, marks=True, named=named), parts)
    return PlacedTree(node, list(_places(node, name)), list(_unused(parts[-1].tree)))


def _unused(file: Any) -> Iterator[tuple[str, int, int, str]]:
    """The definitions of a lark.Tree whose names do not occur again: (kind, line, column, name)."""
    for part in (file, *file.find_data("subtree")):
        names = Counter(part.scan_values(lambda word: word.type == "NAME"))
        kinds = ("constant", "subtree") if part is file else ("parameter",)
        for defined in (each for kind in kinds for each in part.find_data(kind)):
            name = defined.children[0]
            if names[name] == 1:
                yield str(defined.data), name.line, name.column, str(name)


def _places(
    node: Node, file: str, at: tuple[int, int] | None = None, uses: tuple[tuple[int, int], ...] = ()
) -> Iterator[SourceSpan]:
    """The places of a node and those below it; `at`: of the use of an included file, if any."""
    marks = marks_of(node)
    for use, inner in pairwise(marks):
        if at is None:
            uses = (*uses, use.place[1:])
            at = None if inner.place[0] == file else use.place[1:]
    yield SourceSpan(*(at or marks[-1].place[1:]), marks[-1].place, uses)
    for child in node.children:
        yield from _places(child, file, at, uses)


def files_of(
    text: str,
    vocabulary: Vocabulary | None = None,
    *,
    name: str,
    folder: Path | None,
    start: str = "start",
) -> list[ParsedFile]:
    """The parsed files that a text includes, and the text itself, last. Raises as `parse`."""
    if len(text) > MAX_CHARACTERS:
        message, limit = f"the text has {len(text)} characters", f"at most {MAX_CHARACTERS}"
        raise Source(text[:MAX_CHARACTERS], name).error((1, 1), message, limit, kind=LimitError)

    def grammar(source: Source, rule: str) -> Any:
        from lark.exceptions import UnexpectedInput

        try:
            return parser_of().parse(source.text, start=rule)
        except UnexpectedInput as error:
            from islandgp.bt.core.syntax_errors import syntax_error  # only for trees with errors

            raise syntax_error(source, error, rule, vocabulary) from None

    parts = load_includes(Source(plain(text), name), folder, grammar, start)
    for source, tree in parts:
        for token in (each.children[0] for each in tree.children[:1] if each.data == "domain"):
            if vocabulary is not None and token != vocabulary.domain:
                domain = vocabulary.domain
                raise source.error(
                    token,
                    f"the tree is for the domain {shown(token)}, not for {domain!r}",
                    f"domain {domain}, or a command with domain={token}",
                    kind=OtherDomainError,
                )
    return parts


def _built(builder: Builder, parts: Sequence[ParsedFile]) -> Node:
    """The tree of a text. Raises LimitError if its canonical text is too long for `parse`."""
    node = builder.build(parts)
    # Not cached: an equal tree, without the names of its numbers, has another text.
    if (length := len(to_text.__wrapped__(node))) > MAX_CHARACTERS:
        raise parts[-1].source.error(
            (1, 1),
            f"the tree's canonical text, each use expanded, has {length} characters",
            f"at most {MAX_CHARACTERS}; shorten the tree",
            kind=LimitError,
        )
    return node


def parse_condition(text: str, vocabulary: Vocabulary | None) -> ConditionExpr:
    """Parses a condition, as after `when`. Raises TreeError as `parse`."""
    name = "<condition>"
    if not {"{", "}", "#"}.isdisjoint(text):
        message = "unexpected text in the condition"
        raise Source(plain(text), name).error((1, 1), message, "comparisons and flags")
    node = parse(f"when {text}\n{{ always success }}", vocabulary, name=name)
    return guard_of(node).condition


def domain_of(text: str) -> str:
    """The domain that a text names; "" if it names none or is not a tree."""
    match = _DOMAIN.match(plain(text))
    return match[1] if match else ""


def domain_place(text: str) -> tuple[int, int]:
    """Line and column of the domain's name in a text; (1, 1) for none."""
    match = _DOMAIN.match(plain(text))
    before = plain(text)[: match.start(1) if match else 0]
    return before.count("\n") + 1, len(before) - before.rfind("\n")


@cache
def parser_of() -> Lark:
    from lark import Lark, __version__

    if __version__.startswith("0."):
        raise ConfigError(
            f"Expected lark 1.3 or later, found {__version__}: the package lark-parser, which ROS 2"
            " installs, has overwritten it; pip uninstall -y lark-parser, then"
            " pip install --force-reinstall --no-deps 'lark<2'."
        )
    grammar = (resource("grammar") / "bt.lark").read_text(encoding="utf-8")
    return Lark(
        "\n".join([grammar, *_kind_rules()]),
        parser="lalr",
        lexer="contextual",  # a word is a keyword only where the grammar can have it
        maybe_placeholders=False,
        propagate_positions=True,
        start=["start", "library"],
    )


def _kind_rules() -> Iterator[str]:
    """The keywords of all kinds, and the rules of those that are not in the file."""
    for name in SHORT:
        yield f"%override {name.upper()}.1: /{name}\\b(?!{_CALL})/"
    for name in KEYWORDS:
        kind = KINDS[name]
        behind = f"(?!{_CALL})" if name in CALLABLE else ""
        yield f"{'%override ' * kind.paper}{name.upper()}.1: /{name}\\b{behind}/"
        if kind.paper:
            continue
        arguments = [
            "assignment"
            if a.sort is Sort.ASSIGNMENT
            else " | ".join(map(str.upper, a.words)) or "_number"
            for a in kind.arguments
        ]
        parts = [name.upper(), *map("({})".format, arguments)]
        fewest, most = kind.children
        if most == UNLIMITED:
            parts.append("_children")
        elif most:
            parts.append(f'"{{" {"_node " * fewest}{"_node? " * (most - fewest)}"}}"')
        yield f"%extend _node: {name}"
        yield f"{name}: {' '.join(parts)}"
        words = {word for argument in kind.arguments for word in argument.words}
        yield from (f'{word.upper()}: "{word}"' for word in sorted(words))
    yield 'assignment: NAME "=" (sum | FILE)'
