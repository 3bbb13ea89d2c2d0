"""Errors of texts that the grammar does not accept, and the words that can follow a text."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import suppress
from itertools import pairwise
from typing import TYPE_CHECKING, Final, NamedTuple

from islandgp.bt.core.condition import OPERATORS
from islandgp.bt.core.kinds import KINDS
from islandgp.bt.core.language import parser_of
from islandgp.bt.core.source import Source, Word, closest, plain, shown
from islandgp.bt.core.unknown import FOREIGN_WORDS, NODE, NODE_WORDS, unknown_key, unknown_node
from islandgp.bt.core.vocabulary import EMPTY_VOCABULARY, Vocabulary
from islandgp.errors import TreeError

if TYPE_CHECKING:
    from lark import Token
    from lark.exceptions import UnexpectedInput

_COMMENT: Final = "#, which begins a comment"
_BLANK: Final = "a blank, which separates nodes"
_SIGNS: Final = {
    "&&": "and", "&": "and", "||": "or", "|": "or", "!": "not", "//": _COMMENT, "/*": _COMMENT,
    "=>": ">=", "=<": "<=", "<>": "!=", ";": _BLANK, ",": _BLANK,
    "\N{LESS-THAN OR EQUAL TO}": "<=", "\N{GREATER-THAN OR EQUAL TO}": ">=",
    "\N{NOT EQUAL TO}": "!=", "\N{MINUS SIGN}": "-", "\N{EN DASH}": "-",
    "\N{LEFT DOUBLE QUOTATION MARK}": '"', "\N{RIGHT DOUBLE QUOTATION MARK}": '"',
    "[": "{", "]": "}", "'": '"', "%": "a number without a unit",
}  # fmt: skip
"""Signs of other languages, with the correct form; longer ones first."""

_SPELLING: Final = {
    "NUMBER": "a number", "LBRACE": "{", "RBRACE": "}", "EQUAL": "=", "LPAR": "(", "RPAR": ")",
    "LSQB": "[", "RSQB": "]",
    "COMMA": ",", "COLON": ":", "FILE": 'a file such as "lib.bt"', "$END": "the end of the text",
    "OPERATOR": " ".join(OPERATORS),
}  # fmt: skip
"""What the parser's terminals look like in a text, unless it is their name."""

_SELDOM: Final = frozenset({"PLUS", "MINUS", "TIMES", "DIVIDE"})
"""Terminals that are not listed, as they are seldom meant."""


def following(text: str, rule: str = "library") -> frozenset[str]:
    """The terminals of the grammar that can follow a text; none if the text is not valid."""
    from lark.exceptions import UnexpectedInput

    interactive = parser_of().parse_interactive(plain(text), start=rule)
    try:
        interactive.exhaust_lexer()
    except UnexpectedInput:
        return frozenset()
    return frozenset(interactive.accepts())  # type: ignore[no-untyped-call] # lark types it not


def words(text: str, rule: str = "library") -> Iterator[Token]:
    """The words of a text with their places in `plain(text)`. Raises lark's error at a fault."""
    return parser_of().parse_interactive(plain(text), start=rule).iter_parse()


class _Fault(NamedTuple):
    """A place where a text is no longer in the language."""

    source: Source
    token: Token  # the word that is not accepted; $END at the end of the text
    before: Sequence[Token]  # the words before it
    accepted: frozenset[str]  # the terminals that can follow these
    vocabulary: Vocabulary

    @property
    def previous(self) -> str:
        """The last word before it."""
        return str(self.before[-1]) if self.before else ""


def syntax_error(
    source: Source, error: UnexpectedInput, rule: str, vocabulary: Vocabulary | None
) -> TreeError:
    """The error for a text that the grammar doesn't accept.

    Args:
        source: the text.
        error: of the parser.
        rule: of the grammar, for the whole text.
        vocabulary: the domain's words; None: any name could be one.
    """
    from lark.exceptions import UnexpectedToken

    before = _words_before(source, error, rule)
    if vocabulary and (unknown := _unknown_before(source, before, vocabulary)):
        return unknown
    if not isinstance(error, UnexpectedToken):
        return _wrong_character(source, error)
    known = vocabulary or EMPTY_VOCABULARY
    accepted = _accepted(source, before, rule, known)
    fault = _Fault(source, error.token, before, accepted, known)
    if error.token.type == "$END":
        return _early_end(fault)
    message, token = f"unexpected {shown(error.token)}", error.token
    expected, candidates = _expected(fault)
    unclosed = _unclosed(fault)
    if token == "}" and "SELECTOR" in accepted and unclosed is not None:
        message, expected = f"this {_node_of(before[:unclosed])} needs more children", NODE
    elif accepted == {"RBRACE"}:
        message += "; this node takes no more children, so wrap several in a sequence or a selector"
    elif accepted - {"LPAR"} == {"$END"}:
        message += "; a file holds one tree, after its subtrees"
    guess = _instead(fault) or closest(token.strip('"'), candidates)
    return source.error(token, message, expected, guess=guess)


def _words_before(source: Source, error: UnexpectedInput, rule: str) -> list[Token]:
    """The words before the fault; at a wrong character, those that don't touch it."""
    from lark.exceptions import UnexpectedInput, UnexpectedToken

    before: list[Token] = []
    with suppress(UnexpectedInput):  # the fault itself
        before.extend(words(source.text, rule))
    if isinstance(error, UnexpectedToken):
        end = len(source.text) if error.token.type == "$END" else error.token.start_pos or 0
        return [word for word in before if (word.start_pos or 0) < end]
    return [word for word in before if (word.end_pos or 0) < (error.pos_in_stream or 0)]


def _accepted(
    source: Source, before: Sequence[Token], rule: str, vocabulary: Vocabulary
) -> frozenset[str]:
    """The terminals that can follow the words before a fault, without those seldom meant."""
    last = before[-1] if before else ""
    accepted = following(source.text[: getattr(last, "end_pos", 0)], rule) - _SELDOM
    if "NOT" in accepted:
        accepted -= {"NUMBER"}
    if last in vocabulary.keys and "OPERATOR" in accepted:
        return accepted - {"OPERATOR"} if vocabulary.keys[last].flag else frozenset({"OPERATOR"})
    if last in vocabulary.actions and not vocabulary.actions[last].arguments:
        accepted -= {"LPAR"}
    return accepted


def _unknown_before(
    source: Source, before: Sequence[Token], vocabulary: Vocabulary
) -> TreeError | None:
    """The error for an unknown name before the fault, the likelier cause: `slector { ... }`."""
    subtrees = [str(name) for previous, name in pairwise(before) if previous == "subtree"]
    for word in before[-3:]:
        accepted = following(source.text[: word.start_pos]) if word.type == "NAME" else ()
        if "SELECTOR" in accepted and word not in vocabulary.actions:
            return unknown_node(Word(word, source), subtrees, vocabulary, ())
        if "NOT" in accepted and word not in vocabulary.keys:
            return unknown_key(Word(word, source), vocabulary, ())
    return None


def _wrong_character(source: Source, error: UnexpectedInput) -> TreeError:
    rest = source.text[error.pos_in_stream or 0 :]
    guess = next((right for sign, right in _SIGNS.items() if rest.startswith(sign)), "")
    message = f"unexpected character {rest[0]!r} (U+{ord(rest[0]):04X})"
    expected = "" if guess else "letters a to z, digits, _ { } ( ) , : and # for comments"
    return source.error((error.line, error.column), message, expected, guess=guess)


def _early_end(fault: _Fault) -> TreeError:
    """The error after the last word of a text that ends too early."""
    source, before, expected = fault.source, fault.before, _expected(fault)[0]
    tree = "a tree: an action, or a node with its children"
    if not before:
        found = "has comments only" if source.text.strip() else "is empty"
        return source.error((1, 1), f"the text {found}", tree)
    message = "the text ends too early"
    if "SUBTREE" in fault.accepted:
        message, expected = "there is no tree after the definitions", tree
    elif (brace := _unclosed(fault)) is not None:
        node, line = _node_of(before[:brace]), before[brace].line
        message += f": the brace of the {node} in line {line} is not closed"
    return source.error((before[-1].end_line, before[-1].end_column), message, expected)


def _node_of(tokens: Sequence[Token]) -> str:
    """The word of the node whose head ends there."""
    return next(str(word) for word in reversed(tokens) if word in KINDS)


def _unclosed(fault: _Fault) -> int | None:
    """The index of the brace that is probably not closed; None if each one is.

    A closing brace that begins a line belongs to a line that is indented as much. If its
    counterpart is indented more, that one is not closed.
    """
    lines, tokens = fault.source.text.split("\n"), fault.before
    braces: list[int] = []
    for at, token in enumerate(tokens):
        if token == "{":
            braces.append(at)
        elif token == "}" and braces:
            line, column = lines[(tokens[braces[-1]].line or 1) - 1], (token.column or 1) - 1
            begins = not lines[(token.line or 1) - 1][:column].strip()
            if begins and len(line) - len(line.lstrip()) > column:
                break
            braces.pop()
    return braces[-1] if braces else None


def _instead(fault: _Fault) -> str:
    """The likely correction of a word that the grammar does not accept; "" if unknown."""
    token, accepted, text = fault.token, fault.accepted, fault.source.text
    start = token.start_pos or 0
    for signs in (text[start : start + 2], text[max(0, start - 1) : start + 1]):
        if len(signs) == 2 and signs in _SIGNS:
            return _SIGNS[signs]
    if token in ("[", "]") and accepted.isdisjoint(("LSQB", "RSQB")):
        return _SIGNS[str(token)]
    if token == "," and "RBRACE" in accepted:
        return _BLANK
    if token == "{" and "COMMA" in accepted:
        return "a `use` of a subtree that is defined above"
    if accepted == {"COLON"} and len(fault.before) > 2:
        arguments = fault.vocabulary.action(str(fault.before[-3])).arguments
        named = [name for name, each in arguments.items() if fault.previous in each.words]
        return f"{named[0]}: {fault.previous}" if named else ""
    if token.type == "NUMBER" and "SUCCESS" in accepted:
        return f"success {token}"
    if token in ("=", "is", "in") and "OPERATOR" in accepted:
        return "=="
    return FOREIGN_WORDS.get(token.lower(), "") if token.type == "NAME" else ""


def _expected(fault: _Fault) -> tuple[str, Sequence[str]]:
    """The accepted words, as a text and as candidates for a correction."""
    accepted, previous, vocabulary = fault.accepted, fault.previous, fault.vocabulary
    if "SELECTOR" in accepted:
        first = [w for w in ("domain", "include", "constant", "subtree") if w.upper() in accepted]
        words = [*first, *NODE_WORDS, *vocabulary.actions]
        return "} or " * ("RBRACE" in accepted) + NODE, words
    if "USE" in accepted:
        return "a number, a key, a word, a text in quotes, an action or a `use`", ()
    if "NAME" in accepted and "NUMBER" in accepted:
        key = vocabulary.keys.get(str(fault.before[-2])) if previous in OPERATORS else None
        words = [*(key.words if key else ())]
        return " | ".join(words) or "a number, or the name of a constant or parameter", words
    if "NAME" in accepted:
        if "NOT" in accepted or previous == "set":
            keys = [*vocabulary.keys]
            return f"a key: {', '.join(keys)}{', not or (' * ('NOT' in accepted)}", keys
        named = {"use": "subtree"}.get(previous, previous)
        return f"the name of a {named}" if named.isalpha() else "a name", ()
    spelled = [_SPELLING.get(name, name.lower()) for name in sorted(accepted)]
    return ("one of: " if len(spelled) > 1 else "") + " ".join(spelled), spelled
