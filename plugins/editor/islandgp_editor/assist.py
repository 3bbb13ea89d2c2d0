"""Completions and meanings for a tree file in an editor.

Places are offsets into the editor's text, which may have errors anywhere.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Final, Literal, NamedTuple, TypeAlias

from islandgp.bt.core.arithmetic import SIGNS
from islandgp.bt.core.condition import OPERATORS
from islandgp.bt.core.includes import find_includes
from islandgp.bt.core.kinds import KEYWORDS, KINDS
from islandgp.bt.core.node import STATUS_NAMES
from islandgp.bt.core.parameters import STATUSES, Parameter, signature, value_range
from islandgp.bt.core.printer import condition_text
from islandgp.bt.core.syntax_errors import following
from islandgp.bt.core.vocabulary import NAME, Action, Key, Vocabulary
from islandgp_editor.names import Word, code_words, words_of

Sort: TypeAlias = Literal["action", "key", "word", "subtree", "number"]

MEANINGS: Final = {
    **{name: KINDS[name].meaning for name in KEYWORDS},
    "use": "inserts the subtree of that name",
    "domain": "the domain whose actions and keys the tree uses",
    "include": "a file beside this one whose subtrees and constants can be used below",
    "constant": "a name for a number",
    "subtree": "a name for a tree that is used further down",
    **{
        argument.name: f"{argument.meaning}; default: {argument.default}"
        for kind in KINDS.values()
        for argument in kind.arguments
        if argument.default is not None
    },
    **{w: m for kind in KINDS.values() for a in kind.arguments for w, m in a.words.items()},
    "and": "both conditions hold",
    "or": "one of the conditions holds",
    "not": "the condition does not hold",
}
"""Keywords of the language with their meanings."""


@dataclass(frozen=True, slots=True)
class Completion:
    """A completion."""

    text: str
    sort: Sort
    detail: str  # meaning, one line


class _Place(NamedTuple):
    """A position in a text, and what is known there."""

    code: Sequence[str]  # the words before it
    accepted: frozenset[str]  # terminals of the grammar
    vocabulary: Vocabulary
    before: str  # the text before it
    folder: Path

    @property
    def last(self) -> str:
        """The word before it."""
        return self.code[-1] if self.code else ""


def completions(
    text: str, offset: int, vocabulary: Vocabulary, folder: Path, domains: Sequence[str] = ()
) -> list[Completion]:
    """Completions at a position, including the word that is being typed there.

    Args:
        text: of the file; it should be valid up to the position.
        offset: of the position.
        vocabulary: the actions and keys.
        folder: of the file, for included files.
        domains: names of the domains that a file can name.

    Returns:
        The words that the grammar accepts there.
    """
    before = text[: _begin(text, offset)]
    typed_words = words_of(before)
    if typed_words and typed_words[-1].text[0] == "#" and "\n" not in before[typed_words[-1].end :]:
        return []
    accepted = following(before)
    code = [word.text for word in code_words(before)]
    place = _Place(code, accepted, vocabulary, f"{before}\n", folder)
    words = [name.lower() for name in sorted(accepted) if name.lower() in MEANINGS]
    found = [Completion(word, "word", MEANINGS[word]) for word in words]
    if "OPERATOR" in accepted:
        found += [Completion(sign, "word", "compares the key with a number") for sign in OPERATORS]
    if place.last == "domain":
        return [*found, *(Completion(name, "word", "a domain") for name in domains)]
    return [*found, *_names(place)] if "NAME" in accepted else found


def _names(place: _Place) -> list[Completion]:
    """The names that can stand at a place."""
    own = _parameters(place.before, place.folder)
    parameters = [Completion(name, "number", detail) for name, detail in own.items()]
    vocabulary, accepted, last = place.vocabulary, place.accepted, place.last
    if last == "use":
        return _subtree_names(place)
    if arguments := _arguments(place.code, vocabulary):
        if last != ":":
            return [
                Completion(key, "key", f"{each.meaning}: {value_range(each)}")
                for key, each in arguments.items()
            ]
        key = place.code[-2]
        if key in arguments and (words := arguments[key].words):
            return [*(Completion(word, "word", f"a value of {key}") for word in words), *parameters]
    actions = [Completion(n, "action", each.meaning) for n, each in vocabulary.actions.items()]
    keys = [Completion(name, "key", key.meaning) for name, key in vocabulary.keys.items()]
    if "SELECTOR" in accepted:
        return [*actions, *parameters]
    if "NOT" in accepted:
        return [*keys, *parameters]
    if "NUMBER" not in accepted:
        return []  # a new name
    numbers = _numbers(place.before, place.folder).items()
    compared = place.code[-2] if len(place.code) > 1 and last in OPERATORS else ""
    return [
        *_values_of(compared, vocabulary),
        *(Completion(name, "number", detail) for name, detail in numbers),
        *((*keys, *actions) if "USE" in accepted else keys if last in SIGNS else ()),
    ]


def _subtree_names(place: _Place) -> list[Completion]:
    """The subtrees that are defined before a place, but not the one that it is in."""
    unfinished = _unfinished(place.code)
    trees = subtrees(place.before, place.folder).items()
    return [Completion(name, "subtree", lead) for name, lead in trees if name != unfinished]


def _values_of(name: str, vocabulary: Vocabulary) -> list[Completion]:
    """The words and keys that a key can be compared with."""
    if name not in vocabulary.keys:
        return []
    others = ((key, vocabulary.keys[key].meaning) for key in vocabulary.comparable(name))
    return [
        *(Completion(word, "word", f"a value of {name}") for word in vocabulary.keys[name].words),
        *(Completion(key, "key", meaning) for key, meaning in others),
    ]


def _arguments(code: Sequence[str], vocabulary: Vocabulary) -> Mapping[str, Parameter]:
    """The arguments of the action if the last word is in its brackets; else {}."""
    for at in range(len(code) - 1, 0, -1):
        if code[at] in (")", "{", "}"):
            break
        if code[at] == "(":
            return vocabulary.action(code[at - 1]).arguments
    return {}


def meaning(
    text: str, offset: int, vocabulary: Vocabulary, folder: Path
) -> tuple[str, Word] | None:
    """The meaning of the word at a position, as Markdown, with the word; None if there is none."""
    word_at = _at(text, offset)
    if word_at is None:
        return None
    word, previous = word_at
    name = word.text
    if previous in ("use", "subtree"):
        lead = subtrees(text, folder).get(name)
        return (f"```\n{lead}\n```", word) if lead else None
    if name in (own := _parameters(text[: word.end], folder)):
        return f"`{name}`: {own[name]}", word
    if name in vocabulary.actions:
        return _about_action(name, vocabulary.actions[name]), word
    if name in vocabulary.keys:
        return _about_key(name, vocabulary.keys[name]), word
    if name in MEANINGS:
        return f"**{name}**: {MEANINGS[name]}", word
    if name in (numbers := _numbers(text[: word.end], folder)):
        return f"`{numbers[name]}`", word
    return None


def _about_action(name: str, action: Action) -> str:
    lines = [f"**{signature(name, action.arguments)}**: {action.meaning}"]
    for key, each in action.arguments.items():
        lines.append(f"- `{key}`: {each.meaning}; default: {each.default}")
    if action.statuses != STATUSES:
        ends = ", ".join(STATUS_NAMES[status] for status in sorted(action.statuses))
        lines.append(f"It returns {ends}.")
    needs = (("Starts only with", action.to_start), ("Succeeds with", action.to_succeed))
    for phrase, needed in needs:
        if needed:
            lines.append(f"{phrase} `{' and '.join(map(condition_text, needed))}`.")
    return "\n\n".join(lines)


def _about_key(name: str, key: Key) -> str:
    if key.words:
        return f"**{name}**: {key.meaning}\n\n{key.kind}\n\nExample: `when {key.example(name)}`."
    example = f"`when {name}`" if key.flag else f"`when {name} < {key.low + key.step:g}`"
    most = "" if key.most is None else f" to {key.most:g}"
    bounds = "" if key.flag else f"\n\nA {'whole ' * key.whole}number, from {key.low:g}{most}."
    return f"**{name}**: {key.meaning}{bounds}\n\nExample: {example}."


def subtrees(text: str, folder: Path) -> dict[str, str]:
    """The named subtrees of a text and of what it includes, each with its definition's line."""
    return {name: f"subtree {lead}" for name, lead in _defined("subtree", text, folder)}


def _numbers(text: str, folder: Path) -> dict[str, str]:
    """The constants of a text and of what it includes, and parameters of the subtree at its end."""
    numbers = {name: f"constant {lead}" for name, lead in _defined("constant", text, folder)}
    return numbers | _parameters(text, folder)


def _parameters(text: str, folder: Path) -> dict[str, str]:
    """The parameters of the subtree at the end of a text."""
    code = [word.text for word in code_words(text)]
    own = _unfinished(code)
    lead = dict(_defined("subtree", text, folder, own=True)).get(own, "") if own else ""
    inside = re.search(r"\(([^)]*)\)", lead.partition("=")[0])
    names = inside[1].split(",") if inside else []
    return {name.strip(): f"a parameter of {own}" for name in names}


def _unfinished(code: Sequence[str]) -> str:
    """The subtree whose definition is not complete at the end of the words; "" for none."""
    if "subtree" not in code:
        return ""
    name, *rest = [*code[len(code) - code[::-1].index("subtree") :], ""]
    body = rest[rest.index("=") + 1 : -1] if "=" in rest else []
    level = 0
    for word in body:
        level += (word == "{") - (word == "}")
        if word == "}" and level == 0:
            return ""
    leaf = bool(body) and body[0] not in KINDS and body.count("(") <= body.count(")")
    return "" if leaf and len(body) > (2 if body[0] == "use" else 1) and body[-1] != ")" else name


def _defined(kind: str, text: str, folder: Path, *, own: bool = False) -> Iterator[tuple[str, str]]:
    """Names that `subtree` or `constant` define, with the rest of their line without comments."""
    for source in (*(() if own else find_includes(text, folder).values()), text):
        source_words = words_of(source)
        for word, name in pairwise(source_words):
            if word.text == kind and NAME.fullmatch(name.text):
                line = source[name.start :].partition("\n")[0].partition("#")[0]
                yield name.text, line.strip()


def _begin(text: str, offset: int) -> int:
    """The offset at which the word before a position begins."""
    while offset and (text[offset - 1].isalnum() or text[offset - 1] == "_"):
        offset -= 1
    return offset


def _at(text: str, offset: int) -> tuple[Word, str] | None:
    """The word at a place outside comments, and the word before it."""
    previous = ""
    for word in code_words(text):
        if word.start <= offset <= word.end and NAME.fullmatch(word.text):
            return word, previous
        if word.start > offset:
            return None
        previous = word.text
    return None
