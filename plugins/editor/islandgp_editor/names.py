"""Names in a tree file: their definitions and uses, and renaming."""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Final, NamedTuple

from islandgp.bt.core.condition import OPERATORS
from islandgp.bt.core.includes import find_includes
from islandgp.bt.core.kinds import COUNTED, INNER, TIMED
from islandgp.bt.core.vocabulary import NAME, RESERVED
from islandgp.errors import TreeError

_WORD: Final = re.compile(r'#[^\n]*|"[^"\n]*"?|[A-Za-z_]\w*|-?\.?[0-9][0-9A-Za-z_.]*|[<>=!]=?|\S')


class Word(NamedTuple):
    """A word of a text, comments and names of files included."""

    text: str
    start: int  # offsets into the text
    end: int


def words_of(text: str) -> list[Word]:
    """The words of a text."""
    return [Word(m[0], m.start(), m.end()) for m in _WORD.finditer(text)]


def code_words(text: str) -> list[Word]:
    """The words of a text without its comments."""
    return [word for word in words_of(text) if word.text[0] != "#"]


BEFORE_NUMBERS: Final = {*OPERATORS, *COUNTED, *TIMED, "success", "failure"}


class Symbol(NamedTuple):
    """A name with its namespace."""

    kind: str  # subtree, constant or parameter
    name: str
    owner: str = ""  # of a parameter: its subtree


class Occurrence(NamedTuple):
    """A word that defines a symbol or refers to it."""

    symbol: Symbol
    word: Word
    whole: Word | None = None  # of a definition of a subtree or a constant: all of it


def occurrences(text: str) -> Iterator[Occurrence]:
    """All names of subtrees, constants and parameters in a text, which may have errors."""
    tokens = code_words(text)
    owner, parameters, body_end = "", set[str](), -1
    of_uses: list[bool] = []  # for each open bracket: True if it follows a `use` and its name
    at = 0
    while at < len(tokens):
        token, previous = tokens[at], tokens[at - 1].text if at else ""
        following = tokens[at + 1].text if at + 1 < len(tokens) else ""
        is_name = NAME.fullmatch(token.text) is not None
        if token.text == "(":
            of_uses.append(at > 1 and tokens[at - 2].text == "use")
        elif token.text in (")", "{"):
            of_uses = of_uses[:-1] if token.text == ")" else []
        if at > body_end:
            owner, parameters = "", set()
        if is_name and previous == "subtree":
            heading = _closing_index(tokens, at + 1)
            body_end = _body_end(tokens, heading + 1)
            inside = [each for each in tokens[at + 1 : heading] if NAME.fullmatch(each.text)]
            owner, parameters = token.text, {each.text for each in inside}
            whole = _between(tokens, at - 1, body_end)
            yield Occurrence(Symbol("subtree", owner), token, whole)
            yield from (Occurrence(Symbol("parameter", w.text, owner), w) for w in inside)
            at = heading
            continue
        if is_name and previous == "constant":
            whole = _between(tokens, at - 1, at + 2)
            yield Occurrence(Symbol("constant", token.text), token, whole)
        elif is_name and previous == "use":
            yield Occurrence(Symbol("subtree", token.text), token)
        elif is_name and following != ":":
            if token.text in parameters:
                yield Occurrence(Symbol("parameter", token.text, owner), token)
            elif previous == ":" or of_uses[-1:] == [True] or _is_number(tokens, at):
                yield Occurrence(Symbol("constant", token.text), token)
        at += 1


def _between(tokens: Sequence[Word], first: int, last: int) -> Word:
    """The part of the text from one word to another, or to its last word."""
    return Word("", tokens[first].start, tokens[min(last, len(tokens) - 1)].end)


def _is_number(tokens: Sequence[Word], at: int) -> bool:
    """True behind an operator, a count or a time, and as the value of a constant."""
    if not at or tokens[at].text in RESERVED:
        return False
    named = at > 2 and tokens[at - 1].text == "=" and tokens[at - 3].text == "constant"
    return named or tokens[at - 1].text in BEFORE_NUMBERS


def _closing_index(tokens: Sequence[Word], at: int) -> int:
    """The index behind the brackets that open there; `at` if none do."""
    if at >= len(tokens) or tokens[at].text != "(":
        return at
    return _closing_bracket(tokens, at, "(", ")") + 1


def _body_end(tokens: Sequence[Word], at: int) -> int:
    """The index of the last word of the node that begins there."""
    if at >= len(tokens):
        return len(tokens) - 1
    if tokens[at].text not in INNER:  # a leaf or a use
        return _closing_index(tokens, at + 1 + (tokens[at].text in ("use", "always"))) - 1
    return _closing_bracket(tokens, at, "{", "}")


def _closing_bracket(tokens: Sequence[Word], at: int, opening: str, closing: str) -> int:
    """The index of the word that closes the first bracket; of the last word if none does."""
    level = 0
    for i in range(at, len(tokens)):
        level += (tokens[i].text == opening) - (tokens[i].text == closing)
        if tokens[i].text == closing and level <= 0:
            return i
    return len(tokens) - 1


def symbol_at(text: str, offset: int) -> Occurrence | None:
    """The name at an offset."""
    names = occurrences(text)
    return next((each for each in names if each.word.start <= offset <= each.word.end), None)


def definitions(text: str) -> list[Occurrence]:
    """Subtrees and constants that a text defines."""
    return [each for each in occurrences(text) if each.whole]


def defines(text: str, symbol: Symbol) -> Word | None:
    """The word that defines a symbol in a text."""
    matching = (each.word for each in occurrences(text) if each.symbol == symbol)
    if symbol.kind == "parameter":
        return next(matching, None)  # parameters precede their uses
    return next((each.word for each in definitions(text) if each.symbol == symbol), None)


def references(text: str, symbol: Symbol) -> list[Word]:
    """The words of a text that name a symbol, including its definition."""
    return [each.word for each in occurrences(text) if each.symbol == symbol]


def renamed(text: str, offset: int, new: str, folder: Path) -> list[Word]:
    """The words that name the symbol at an offset, all of which `new` can replace.

    Args:
        text: the file.
        offset: into the text.
        new: name of a subtree, a constant or a parameter.
        folder: of the file, for what it includes.

    Raises:
        TreeError: there is no such name, another file defines it, or `new` is not possible.
    """
    occurrence = symbol_at(text, offset)
    if occurrence is None:
        raise TreeError("Expected the name of a subtree, a constant or a parameter, found none.")
    symbol = occurrence.symbol
    if defines(text, symbol) is None:
        raise TreeError(
            f"Expected a {symbol.kind} that this file defines, found {symbol.name}, which is not"
            " defined here."
        )
    if not NAME.fullmatch(new) or new in RESERVED:
        raise TreeError(
            f"Expected letters, digits and _ that are not a keyword of the language, found {new!r}."
        )
    if new != symbol.name and (conflict := _name_conflict(symbol, new, text, folder)):
        raise TreeError(f"Expected a new name, found {new}, which already names a {conflict}.")
    return references(text, symbol)


def _name_conflict(symbol: Symbol, new: str, text: str, folder: Path) -> str:
    """The kind of the symbol that already has the name; "" if there is none."""
    kinds = ("subtree",) if symbol.kind == "subtree" else ("constant", "parameter")
    for source in (text, *find_includes(text, folder).values()):
        for each in occurrences(source):
            if each.symbol.name == new and each.symbol.kind in kinds:
                return each.symbol.kind
    return ""
