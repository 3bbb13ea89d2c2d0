"""Names in a tree file: their definitions and uses, and renaming."""

from __future__ import annotations

import re
from bisect import bisect
from collections.abc import Iterator, Mapping, Sequence
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


class _Definition(NamedTuple):
    """A definition of a subtree or a constant; first and last are indices of words."""

    symbol: Symbol
    name: Word
    parameters: Mapping[str, Word]
    first: int
    last: int


def occurrences(text: str) -> list[Occurrence]:
    """All names of subtrees, constants and parameters in a text, which may have errors."""
    words = code_words(text)
    defined = list(_definitions(words))
    found: list[Occurrence] = []
    for each in defined:
        whole = Word("", words[each.first].start, words[each.last].end)
        found.append(Occurrence(each.symbol, each.name, whole))
        owner = each.symbol.name
        found += [Occurrence(Symbol("parameter", n, owner), w) for n, w in each.parameters.items()]
    heads = {each.word.start for each in found}
    passed, firsts = _passed(words), [each.first for each in defined]
    for at, word in enumerate(words):
        if word.start in heads or not NAME.fullmatch(word.text):
            continue
        before = defined[max(0, bisect(firsts, at) - 1) :][:1]
        owners = [each for each in before if each.first <= at <= each.last]
        if symbol := _symbol(words, at, owners, is_passed=passed[at]):
            found.append(Occurrence(symbol, word))
    return sorted(found, key=lambda each: each.word.start)


def _definitions(words: Sequence[Word]) -> Iterator[_Definition]:
    at = 0
    while at < len(words) - 1:
        kind, name = words[at].text, words[at + 1]
        last, parameters = at, dict[str, Word]()
        if kind == "subtree" and NAME.fullmatch(name.text):
            heading = _closing_index(words, at + 2)
            parameters = {w.text: w for w in words[at + 2 : heading] if NAME.fullmatch(w.text)}
            last = _body_end(words, heading + 1)
        elif kind == "constant" and NAME.fullmatch(name.text):
            last = at + 3
        if last > at:
            last = min(last, len(words) - 1)
            yield _Definition(Symbol(kind, name.text), name, parameters, at, last)
        at = last + 1


def _passed(words: Sequence[Word]) -> list[bool]:
    """For each word: True if it is in the brackets behind a `use` and its name."""
    of_uses: list[bool] = []  # for each open bracket
    passed: list[bool] = []
    for at, word in enumerate(words):
        if word.text == "(":
            of_uses.append(at > 1 and words[at - 2].text == "use")
        elif word.text == ")":
            of_uses = of_uses[:-1]
        elif word.text == "{":
            of_uses = []
        passed.append(of_uses[-1:] == [True])
    return passed


def _symbol(
    words: Sequence[Word], at: int, owners: Sequence[_Definition], *, is_passed: bool
) -> Symbol | None:
    """What a name refers to; `owners`: the definition around it, if any."""
    name, previous = words[at].text, words[at - 1].text if at else ""
    if previous == "use":
        return Symbol("subtree", name)
    if at + 1 < len(words) and words[at + 1].text == ":":
        return None
    for owner in owners:
        if name in owner.parameters:
            return Symbol("parameter", name, owner.symbol.name)
    is_value = at > 2 and previous == "=" and words[at - 3].text == "constant"
    if name not in RESERVED and (is_passed or is_value or previous in {":", *BEFORE_NUMBERS}):
        return Symbol("constant", name)
    return None


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
