"""From text to tree and back: `parse` and `to_text`.

The grammar is `grammar/bt.lark`. Time and memory of parsing are bounded: any invalid
text raises a `TreeError` quickly.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

from islandgp.bt.core.builder import MAX_LEVELS as MAX_LEVELS
from islandgp.bt.core.builder import MAX_NODES as MAX_NODES
from islandgp.bt.core.builder import Builder
from islandgp.bt.core.condition import ConditionExpr
from islandgp.bt.core.includes import ParsedFile, load_includes
from islandgp.bt.core.kind import Sort
from islandgp.bt.core.kinds import CALLABLE, KINDS, RESERVED
from islandgp.bt.core.node import Node
from islandgp.bt.core.printer import to_text as to_text
from islandgp.bt.core.scope import MAX_NUMBER as MAX_NUMBER
from islandgp.bt.core.source import Source, shown
from islandgp.bt.core.source import plain as plain
from islandgp.bt.core.vocabulary import Vocabulary
from islandgp.errors import ConfigError, LimitError, OtherDomainError
from islandgp.resources import resource

if TYPE_CHECKING:
    from lark import Lark, Token

MAX_CHARACTERS: Final = 100_000  # most characters of a text
_GAP: Final = r"(?:[ \t\n]|#[^\n]*+)"  # between two words; possessive, so that it cannot backtrack
_CALL: Final = re.compile(rf"{_GAP}*+\({_GAP}*+(\)|[A-Za-z_][A-Za-z0-9_]*+{_GAP}*+:)")
_NODE_OR_KEY: Final = {"SELECTOR", "NOT"}  # terminals where a node or a key is expected
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
    return built(Builder(parts[-1].source, vocabulary, marked=marked), parts)


def files_of(
    text: str,
    vocabulary: Vocabulary | None = None,
    *,
    name: str,
    folder: Path | None,
    start: str = "start",
    placed: bool = False,
) -> list[ParsedFile]:
    """The parsed files that a text includes, and the text itself, last. Raises as `parse`.

    `placed`: each tree of the grammar knows where it begins and ends.
    """
    if len(text) > MAX_CHARACTERS:
        raise Source(text[:MAX_CHARACTERS], name).error(
            f"the text has {len(text)} characters",
            line=1,
            column=1,
            expected=f"at most {MAX_CHARACTERS}",
            kind=LimitError,
        )

    def grammar(source: Source, rule: str) -> Any:
        return _parsed(source, rule, vocabulary, placed)

    parts = load_includes(Source(plain(text), name), folder, grammar, MAX_CHARACTERS, start=start)
    for source, tree in parts:
        if tree.children and getattr(tree.children[0], "data", "") == "domain":
            _check_domain(source, tree.children[0].children[0], vocabulary)
    return parts


def built(builder: Builder, parts: Sequence[ParsedFile]) -> Node:
    """The tree of `files_of`. Raises as `parse`."""
    node = builder.build(parts)
    size = builder.nodes * builder.levels
    alone = len(parts) == 1 and len(parts[0].tree.children) == 1
    _check_length(parts[-1].source, node, expanded=not alone, indents=size)
    return node


def _parsed(source: Source, rule: str, vocabulary: Vocabulary | None, placed: bool) -> Any:
    """The lark.Tree of a text by a rule of the grammar. Raises TreeError."""
    from lark.exceptions import UnexpectedInput

    parser = _parser(placed)
    try:
        return parser.parse(source.text, start=rule)
    except UnexpectedInput as error:
        from islandgp.bt.core.diagnosis import syntax_error  # only for trees with errors

        raise syntax_error(source, error, words(source.text, rule), vocabulary) from None


def following(text: str) -> frozenset[str]:
    """The terminals of the grammar that can follow a text; none if the text is not valid."""
    from lark.exceptions import UnexpectedInput

    interactive = _parser().parse_interactive(plain(text), start="library")
    try:
        interactive.exhaust_lexer()
    except UnexpectedInput:
        return frozenset()
    return frozenset(interactive.accepts())  # type: ignore[no-untyped-call] # lark types it not


def parse_condition(text: str, vocabulary: Vocabulary) -> ConditionExpr:
    """Parses a condition, as after `when`. Raises TreeError as `parse`."""
    from lark.exceptions import UnexpectedInput

    source = Source(plain(text[:MAX_CHARACTERS]), "<condition>")
    try:
        parsed = _parser().parse(source.text, start="disjunction")
    except UnexpectedInput as error:
        ends = not isinstance(error.column, int) or error.column < 1  # the text ends too early
        raise source.error(
            "unexpected end of the condition" if ends else "unexpected text in the condition",
            line=1 if ends else error.line,
            column=len(source.text) + 1 if ends else error.column,
            expected="comparisons and flags, joined by and, or, not",
        ) from None
    return Builder(source, vocabulary).condition(parsed)


def _check_length(source: Source, tree: Node, *, expanded: bool, indents: int) -> None:
    """Raises LimitError if the canonical text of a tree would be too long for `parse`."""
    # Two lines a node, indented by two blanks a level; the words are those of the text.
    if not expanded and 2 * len(source.text) + 4 * indents <= MAX_CHARACTERS:
        return
    length = len(to_text(tree))
    if length > MAX_CHARACTERS:
        raise source.error(
            f"the tree's canonical text, each use expanded, has {length} characters",
            line=1,
            column=1,
            expected=f"at most {MAX_CHARACTERS}; shorten the tree",
            kind=LimitError,
        )


def domain_of(text: str) -> str:
    """The domain that a text names; "" if it names none or is not a tree."""
    match = _DOMAIN.match(plain(text))
    return match[1] if match else ""


def domain_place(text: str) -> tuple[int, int]:
    """Line and column of the domain's name in a text; (1, 1) for none."""
    match = _DOMAIN.match(plain(text))
    before = plain(text)[: match.start(1) if match else 0]
    return before.count("\n") + 1, len(before) - before.rfind("\n")


def _check_domain(source: Source, name: Token, vocabulary: Vocabulary | None) -> None:
    if vocabulary is not None and name != vocabulary.domain:
        raise source.error_at(
            name,
            f"the tree is for the domain {shown(name)}, not for {vocabulary.domain!r}",
            expected=f"domain {vocabulary.domain}, or a command with domain={name}",
            kind=OtherDomainError,
        )


def words(text: str, rule: str = "library") -> Iterator[Token]:
    """The words of a text with their places in `plain(text)`. Raises lark's error at a fault."""
    return _parser().parse_interactive(plain(text), start=rule).iter_parse()


@cache
def _parser(placed: bool = False) -> Lark:  # to know all places takes a tenth longer
    from lark import Lark, Token, __version__
    from lark.lexer import BasicLexer

    if __version__.startswith("0."):
        raise ConfigError(
            f"Expected lark 1.3 or later, found {__version__}: the package lark-parser, which ROS 2"
            " installs, has overwritten it; pip uninstall -y lark-parser, then"
            " pip install --force-reinstall --no-deps 'lark<2'."
        )

    class ContextLexer(BasicLexer):
        """Reads whole words; one is a keyword only where the grammar can have it.

        A word of RESERVED is one also where a node or a key is expected. An action that is named
        like a node kind has parentheses.
        """

        __future_interface__ = 2  # lark passes the state of the parser

        def lex(self, state: Any, parser_state: Any) -> Iterator[Token]:
            for token in super().lex(state, parser_state):
                if token.type == "NUMBER" and token[0] == "-":
                    accepted = parser_state.parse_conf.states[parser_state.position]
                    if "NUMBER" not in accepted and "MINUS" in accepted:  # of `a -3`
                        yield Token.new_borrow_pos("MINUS", "-", token)
                        token = token.update(value=token[1:])
                        token.start_pos = (token.start_pos or 0) + 1
                        token.column = (token.column or 0) + 1
                if token.type != "NAME" and token[0].isalpha():
                    accepted = parser_state.parse_conf.states[parser_state.position]
                    if token.type in accepted:
                        called = _CALL.match(state.text.text, token.end_pos or 0)
                        is_name = token in CALLABLE and called is not None
                    else:
                        is_name = token not in RESERVED or not accepted.keys() & _NODE_OR_KEY
                    if "NAME" in accepted and is_name:
                        token.type = "NAME"
                yield token

    options: dict[str, Any] = {
        "parser": "lalr",
        "lexer": ContextLexer,
        "maybe_placeholders": False,
        "propagate_positions": placed,
        "start": ["start", "library", "disjunction"],
    }
    grammar = (resource("grammar") / "bt.lark").read_text(encoding="utf-8")
    return Lark("\n".join([grammar, *_kind_rules()]), **options)


def _kind_rules() -> Iterator[str]:
    """The rules of the kinds that are not in the file: keyword, arguments and children."""
    children = {(0, 0): "", (1, 1): "_child", (2, 2): '"{" _node _node "}"'}
    for name, kind in KINDS.items():
        if not kind.paper:
            arguments = [
                "assignment"
                if a.sort is Sort.ASSIGNMENT
                else " | ".join(map(str.upper, a.words)) or "_number"
                for a in kind.arguments
            ]
            parts = [name.upper(), *map("({})".format, arguments)]
            parts.append(children.get(kind.children, "_children"))
            yield f"%extend _node: {name}"
            yield f"{name}: {' '.join(parts)}"
            words = {word for argument in kind.arguments for word in argument.words}
            yield from (f'{word.upper()}: "{word}"' for word in sorted({name, *words}))
    yield 'assignment: NAME "=" sum'
