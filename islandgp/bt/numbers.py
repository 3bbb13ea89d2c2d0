"""The numbers that stand in a tree file, what each is for, and the file with other numbers."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Final, TypeAlias

from islandgp.bt.condition import OPERATORS, terms
from islandgp.bt.language import plain, words
from islandgp.bt.node import condition_of
from islandgp.bt.printer import Named, number_text
from islandgp.bt.syntax import Definition, File, Statement, Written, read
from islandgp.bt.vocabulary import Vocabulary

REPEATS: Final = "repeater"
"""The purpose of a count; other purposes are the keys that are compared with the number."""

Purposes: TypeAlias = frozenset[str]

_NONE: Final[Purposes] = frozenset()


@dataclass(frozen=True, slots=True)
class Number:
    """A number as it stands in a file."""

    label: str  # the words before it: `charge <`, `repeater`, `constant low =`, `use go: times`
    value: float
    purposes: Purposes  # REPEATS, and keys; several where a constant or a parameter has them
    line: int  # from 1
    start: int  # its place in `plain(text)`
    end: int


def numbers_of(
    text: str, vocabulary: Vocabulary, *, name: str = "<tree>", folder: Path | None = None
) -> list[Number]:
    """The numbers of a file in its order; those of included files are not among them.

    `name` and `folder` are those of `parse`. Raises TreeError as `parse` does.
    """
    file = read(text, vocabulary, name=name, folder=folder)
    tokens = [word for word in words(text) if word.type == "NUMBER"]
    return [
        Number(label, float(token), purposes, token.line or 1, start, start + len(token))
        for (label, purposes), token in zip(_slots(file), tokens, strict=True)
        if (start := token.start_pos) is not None
    ]


def with_numbers(text: str, numbers: Sequence[Number], values: Sequence[float]) -> str:
    """The text with a value in place of each of these numbers; all else stays as it is written."""
    text = plain(text)
    parts: list[str] = []
    end = 0
    for number, value in zip(numbers, values, strict=True):
        parts += [text[end : number.start], number_text(value)]
        end = number.end
    return "".join([*parts, text[end:]])


@dataclass(frozen=True, slots=True)
class _Slot:
    """A place where a number is wanted."""

    label: str
    purposes: Purposes
    named: str = ""  # the constant or the parameter that stands there
    constant: str = ""  # the constant whose value it is


def _slots(file: File) -> list[tuple[str, Purposes]]:
    """Label and purposes of each number that is written out, in the file's order."""
    taken: dict[str, dict[str, Purposes]] = {}  # by subtree and parameter
    for definition in file.included.values():
        list(_defined(definition, taken))
    slots: list[_Slot] = []
    for part in file.definitions:
        slots += [_constant(part)] if isinstance(part, Statement) else _defined(part, taken)
    if file.root is not None:
        slots += _inside(file.root, taken)
    of_constants: dict[str, Purposes] = {}
    found: list[tuple[str, Purposes]] = []
    for slot in reversed(slots):  # a constant is defined before it is used
        if slot.constant:
            slot = replace(slot, purposes=of_constants.get(slot.constant, _NONE))
        if slot.named:
            of_constants[slot.named] = of_constants.get(slot.named, _NONE) | slot.purposes
        else:
            found.append((slot.label, slot.purposes))
    return found[::-1]


def _constant(line: Statement) -> _Slot:
    """`constant low = 20`, or with the name of another constant."""
    _, name, _, value = line.text.split()
    named = value if value[0].isalpha() or value[0] == "_" else ""
    return _Slot(f"constant {name} =", _NONE, named, name)


def _defined(definition: Definition, taken: dict[str, dict[str, Purposes]]) -> Iterator[_Slot]:
    """The slots of a subtree but those of its parameters, whose purposes are put into `taken`."""
    own = dict.fromkeys(definition.parameters, _NONE)
    for slot in list(_inside(definition.body, taken)):
        if slot.named in own:
            own[slot.named] |= slot.purposes
        else:
            yield slot
    taken[definition.name] = own


def _inside(written: Written, taken: Mapping[str, Mapping[str, Purposes]]) -> Iterator[_Slot]:
    """The slots of a node and of those below it."""
    node = written.node
    if node.kind == "when":
        for term in terms(condition_of(node)):
            if term.operator in OPERATORS:
                label = f"{term.key} {term.operator}"
                yield _Slot(label, frozenset({term.key}), _name_of(term.number))
    elif node.kind == "repeater":
        yield _Slot("repeater", frozenset({REPEATS}), _name_of(node.args[0]))
    elif node.kind == "use":
        subtree, *given = node.args
        for value, (parameter, purposes) in zip(given, taken[str(subtree)].items(), strict=False):
            yield _Slot(f"use {subtree}: {parameter} =", purposes, _name_of(value))
    for child in written.children:
        yield from _inside(child, taken)


def _name_of(value: object) -> str:
    return value.name if isinstance(value, Named) else ""
