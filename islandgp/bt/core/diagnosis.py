"""Messages of syntax errors: the unexpected text, the accepted words, and a likely correction."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Sequence
from contextlib import suppress
from itertools import pairwise, takewhile
from typing import TYPE_CHECKING

from islandgp.bt.core.condition import OPERATORS
from islandgp.bt.core.kinds import CALLABLE, COUNTED, GUARDS, KINDS, SETTERS, TIMED
from islandgp.bt.core.parameters import value_range
from islandgp.bt.core.scope import ScopedWord
from islandgp.bt.core.source import Source, closest, shown
from islandgp.bt.core.unknown_names import (
    FOREIGN_WORDS,
    NODE_WORDS,
    node_words,
    unknown_argument,
    unknown_key,
    unknown_node,
)
from islandgp.bt.core.vocabulary import EMPTY_VOCABULARY, Vocabulary
from islandgp.errors import TreeError

if TYPE_CHECKING:
    from lark import Token
    from lark.exceptions import UnexpectedInput

_NAMING = ("subtree", "use", "domain", "constant")  # keywords that are followed by a name
_DEFINITIONS = {
    "subtree": "subtrees", "constant": "constants", "include": "includes", "domain": "domain",
}  # fmt: skip
"""What comes before a tree, as messages call it."""
_BEFORE_NUMBERS = (*COUNTED, *TIMED, "success", "failure")

_ONE_CHILD = [name for name, kind in KINDS.items() if kind.decorates]

_SIGNS = {
    "&&": "and", "&": "and", "||": "or", "|": "or", "!": "not", "//": "#, which begins a comment",
    "/*": "#, which begins a comment", ";": "a blank, which separates nodes",
    "\N{LESS-THAN OR EQUAL TO}": "<=", "\N{GREATER-THAN OR EQUAL TO}": ">=",
    "\N{NOT EQUAL TO}": "!=", "\N{MINUS SIGN}": "-", "\N{EN DASH}": "-",
    "\N{LEFT DOUBLE QUOTATION MARK}": '"', "\N{RIGHT DOUBLE QUOTATION MARK}": '"',
    "[": "{", "]": "}", "'": '"', "%": "a number without a unit",
}  # fmt: skip
"""Operators and signs of other languages, with the correct form; longer ones first."""

_TWO_SIGNS = {"=>": ">=", "=<": "<=", "<>": "!=", "//": _SIGNS["//"], "/*": _SIGNS["/*"]}
"""Operators of other languages that the parser reads as two signs."""

_ARITHMETIC = {"PLUS", "MINUS", "TIMES", "DIVIDE"}

_BLANK = _SIGNS[";"]

_PASSED = "an argument: a number, a key, a word, a text in quotes, an action or a `use`"
"""What can be passed to a subtree."""

# What the parser's terminals look like in a text.
_SPELLING = {
    "NUMBER": "a number",
    "LBRACE": "{",
    "RBRACE": "}",
    "EQUAL": "=",
    "LPAR": "(",
    "RPAR": ")",
    "COMMA": ",",
    "COLON": ":",
    "FILE": 'a file such as "lib.bt"',
    "$END": "the end of the text",
}


def syntax_error(
    source: Source, error: UnexpectedInput, tokens: Iterator[Token], vocabulary: Vocabulary | None
) -> TreeError:
    """The error for a text that the grammar doesn't accept.

    Args:
        source: the text.
        error: of the parser.
        tokens: the words of the text, read up to the fault.
        vocabulary: the domain's words; None: any name could be one.
    """
    from lark.exceptions import UnexpectedToken

    before = _words_before(tokens, error)
    numbers = _names_of_numbers(before)
    subtrees = {str(word) for previous, word in pairwise(before) if previous == "subtree"}
    parameters = _parameters(before)
    for at, (previous, word) in enumerate(zip(["", *before], before, strict=False)):
        # An unknown name is reported first, as it is the likelier cause: the parser of
        # `slector { ... }` only fails at the brace.
        if word.type != "NAME" or previous in _NAMING or vocabulary is None or at in numbers:
            continue
        if word in parameters:
            continue
        is_key = previous in (*GUARDS, *SETTERS, "not", "and", "or", "(")
        if is_key and word not in vocabulary.keys:
            return unknown_key(ScopedWord(word, source), vocabulary)
        if not is_key and word not in vocabulary.actions:
            return unknown_node(ScopedWord(word, source), subtrees, vocabulary)
    known = vocabulary or EMPTY_VOCABULARY
    if not isinstance(error, UnexpectedToken):
        rest = source.text[error.pos_in_stream or 0 :]
        sign = next((sign for sign in _SIGNS if rest.startswith(sign)), rest[0])
        message = f"unexpected character {rest[0]!r} (U+{ord(rest[0]):04X})"
        guess = _SIGNS.get(sign, "")
        expected = "" if guess else "names, numbers, { } ( ) , : and # for comments"
        if rest[0].isalpha():
            expected = "names of the letters a to z, digits and _"
        return source.error(message, error.line, error.column, expected=expected, guess=guess)
    accepted = set(error.accepts) - _ARITHMETIC  # not listed, as they are seldom meant
    if "NOT" in accepted:
        accepted.discard("NUMBER")
    if _takes_nothing(before, known):
        accepted.discard("LPAR")
    if error.token.type == "$END":
        return _unexpected_end(source, before, accepted, known)
    if vocabulary is not None and before and before[-1] in known.keys:
        accepted -= {"OPERATOR"} if known.keys[before[-1]].flag else accepted - {"OPERATOR"}
    if before and before[-1] in CALLABLE and {"COMMA", "LPAR"} <= error.accepts:
        message = f"unexpected {shown(before[-1])}; name this node as a subtree above, and pass"
        return source.error_at(before[-1], f"{message} `use` and its name", expected=_PASSED)
    arguments = known.action(_called(before)).arguments
    if accepted == {"COLON"} and arguments and before[-1] not in arguments:
        return unknown_argument(source, before[-1], _called(before), arguments)
    return _unexpected_word(source, error.token, before, accepted, known)


def _parameters(tokens: Sequence[Token]) -> set[str]:
    """The names of the parameters of all subtrees."""
    names: set[str] = set()
    for at, word in enumerate(tokens):
        if word == "subtree" and [*map(str, tokens[at + 2 : at + 3])] == ["("]:
            names.update(takewhile(lambda each: each != ")", tokens[at + 3 :]))
    return names - {","}


def _called(tokens: Sequence[Token]) -> str:
    """The name before the last open parenthesis; "" if there is none."""
    for at in range(len(tokens) - 1, 0, -1):
        if tokens[at] in (")", "{", "}"):
            return ""
        if tokens[at] == "(":
            return str(tokens[at - 1])
    return ""


def _takes_nothing(before: Sequence[Token], vocabulary: Vocabulary) -> bool:
    """True if the last word is an action without arguments."""
    if (
        not before
        or before[-1].type != "NAME"
        or [*map(str, before[-2:-1])] in (["use"], ["subtree"])
    ):
        return False
    return not vocabulary.action(str(before[-1])).arguments


def _names_of_numbers(tokens: Sequence[Token]) -> set[int]:
    """Indices of words that name numbers, or are in brackets after a name."""
    indices: set[int] = set()
    inside = False  # the brackets behind the name of a subtree or an action
    for at, token in enumerate(tokens):
        before = [str(each) for each in tokens[max(0, at - 3) : at]]
        if token == "(" and at > 0 and tokens[at - 1].type == "NAME":
            inside = True
        inside = inside and token != ")"
        compared = at > 0 and tokens[at - 1].type == "OPERATOR"
        if (
            inside
            or compared
            or (at > 0 and tokens[at - 1] in _BEFORE_NUMBERS)
            or before[:1] == ["constant"]
        ):
            indices.add(at)
    return indices


def _words_before(tokens_read: Iterator[Token], error: UnexpectedInput) -> list[Token]:
    """The words before the fault; at a wrong character, those that don't touch it."""
    from lark.exceptions import UnexpectedCharacters, UnexpectedToken

    if isinstance(error, UnexpectedToken):
        if error.token.type == "$END":  # its position is that of the last word
            return list(tokens_read)
        return list(takewhile(lambda word: word.start_pos != error.pos_in_stream, tokens_read))
    tokens: list[Token] = []
    with suppress(UnexpectedCharacters):  # the fault itself
        tokens.extend(word for word in tokens_read if word.end_pos != error.pos_in_stream)
    return tokens


def _unexpected_end(
    source: Source, before: Sequence[Token], accepted: Collection[str], vocabulary: Vocabulary
) -> TreeError:
    """The error after the last word of a text that ends too early."""
    if not before:
        expected, _ = _expected(accepted, (), vocabulary)
        return source.error("there is no tree in the text", 1, 1, expected=expected)
    last = before[-1]
    expected, _ = _expected(accepted, before, vocabulary)
    line, column = last.end_line or 1, last.end_column or 1
    message = "the text ends too early"
    if "SUBTREE" in accepted:
        definition = next(str(word) for word in reversed(before) if word in _DEFINITIONS)
        message = f"there is no tree after the {_DEFINITIONS[definition]}"
        expected = "a node or an action"
    if (brace := _unclosed(source, before)) is not None:
        node = _parent(source, before)
        message += f": the brace of the {node} in line {before[brace].line} is not closed"
    return source.error(message, line, column, expected=expected)


def _parent(source: Source, tokens: Sequence[Token]) -> str:
    """The word of the node whose brace is open."""
    return next(str(w) for w in reversed(tokens[: _unclosed(source, tokens)]) if w in NODE_WORDS)


def _unclosed(source: Source, tokens: Sequence[Token]) -> int | None:
    """The index of the brace that is probably not closed; None if each one is.

    A closing brace that begins a line belongs to a line that is indented as much. If its
    counterpart is indented more, that one is not closed.
    """
    lines = source.text.split("\n")
    braces: list[int] = []
    for at, token in enumerate(tokens):
        if token == "{":
            braces.append(at)
        elif token == "}" and braces:
            line = lines[(tokens[braces[-1]].line or 1) - 1]
            begins = not lines[(token.line or 1) - 1][: (token.column or 1) - 1].strip()
            if begins and len(line) - len(line.lstrip()) > (token.column or 1) - 1:
                break
            braces.pop()
    return braces[-1] if braces else None


def _unexpected_word(
    source: Source,
    token: Token,
    before: Sequence[Token],
    accepted: Collection[str],
    vocabulary: Vocabulary,
) -> TreeError:
    expected, spelled = _expected(accepted, before, vocabulary)
    message = f"unexpected {shown(token)}"
    only = set(accepted) - {"LPAR"}  # behind an action there may be its arguments
    if token == "}" and "SELECTOR" in accepted and _unclosed(source, before) is not None:
        message = _missing_child(_parent(source, before), has_child=before[-1] != "{")
        expected = "a node or an action"
    elif only == {"RBRACE"}:
        takes = "two children" if _parent(source, before) == "recovery" else "one child"
        message += f"; this node takes {takes}, so wrap several in a sequence or a selector"
    elif only == {"$END"}:
        message += "; a file holds one tree, after its subtrees"
    guess = _instead(source, token, before, accepted, vocabulary) or closest(
        token.strip('"'), spelled
    )
    return source.error_at(token, message, expected=expected, guess=guess)


def _missing_child(node: str, *, has_child: bool) -> str:
    """The message for a brace that closes too early. `has_child`: there is a child before it."""
    article = "an" if node[0] in "aeiou" else "a"
    if node == "recovery":
        return f"a recovery takes two children, found {'one' if has_child else 'none'}"
    count = "one child" if node in _ONE_CHILD else "at least one child"
    return f"{article} {node} needs {count}, found none"


def _instead(
    source: Source,
    token: Token,
    before: Sequence[Token],
    accepted: Collection[str],
    vocabulary: Vocabulary,
) -> str:
    """The likely correction of a word that the grammar does not accept; "" if unknown."""
    previous = str(before[-1]) if before else ""
    start = token.start_pos or 0
    for signs in (source.text[start : start + 2], source.text[max(0, start - 1) : start + 1]):
        if signs in _TWO_SIGNS:
            return _TWO_SIGNS[signs]
    if token == "<" and not before:
        return "islandgp import, which reads XML"
    if token == "," and "RBRACE" in accepted:
        return _BLANK
    if token == ")" and previous == "(" and len(before) > 1:
        return f"{before[-2]}, without parentheses"
    if token in vocabulary.action(previous).arguments:
        return f"{previous}({token}: ...)"
    if token.type == "NUMBER" and "SUCCESS" in accepted:
        return f"success {token}"
    if token in ("=", "is", "in") and "OPERATOR" in accepted:
        return "=="
    return FOREIGN_WORDS.get(token.lower(), "") if token.type == "NAME" else ""


def _expected(
    accepted: Collection[str], before: Sequence[Token], vocabulary: Vocabulary
) -> tuple[str, tuple[str, ...]]:
    """The accepted words, as a text and as candidates for a correction."""
    previous = str(before[-1]) if before else ""
    if "SELECTOR" in accepted:
        first = [
            word
            for word in ("domain", "include", "constant", "subtree")
            if word.upper() in accepted
        ]
        words = (*first, *NODE_WORDS, *vocabulary.actions)
        return ("} or " if "RBRACE" in accepted else "") + node_words(vocabulary), words
    if "NAME" in accepted and "NUMBER" in accepted:
        arguments = vocabulary.action(_called(before)).arguments
        if previous == ":" and (argument := arguments.get(str(before[-2]))):
            return value_range(argument), argument.words
        if "USE" in accepted:
            return _PASSED, ()
        key = vocabulary.keys.get(str(before[-2])) if previous in OPERATORS else None
        if key and key.words:
            return key.kind, key.words
        return "a number, or the name of a constant or parameter", ()
    if "NAME" in accepted:
        if previous == "(" and len(accepted) == 1:
            defines = [*map(str, before[-3:-2])] == ["subtree"]
            return f"the name of {'a parameter' if defines else 'an argument'}", ()
        if previous in SETTERS:
            writable = [name for name, key in vocabulary.keys.items() if key.writable]
            return f"a key that trees write: {', '.join(writable) or 'none'}", (*writable,)
        if previous in _NAMING:
            return f"the name of a {'subtree' if previous == 'use' else previous}", ()
        flags = tuple(name for name, key in vocabulary.keys.items() if key.flag)
        words = tuple(vocabulary.keys) if "NOT" in accepted else flags
        others = ", not or (" if "NOT" in accepted else ""
        return f"a key: {', '.join(words)}{others}" if words else "a key", words
    spelled: list[str] = []
    for name in sorted(accepted, key=lambda name: (name in _SPELLING, name)):
        if name == "OPERATOR":
            spelled += OPERATORS
        else:
            spelled.append(_SPELLING.get(name, name.lower()))
    return ("one of: " if len(spelled) > 1 else "") + " ".join(spelled), tuple(spelled)
