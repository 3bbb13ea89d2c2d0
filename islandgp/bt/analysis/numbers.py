"""The numbers in a tree file with their purposes, and the file with other numbers."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final, NamedTuple, TypeAlias

from islandgp.bt.core.builder import Builder
from islandgp.bt.core.kinds import COUNTED, TIMED
from islandgp.bt.core.language import built, files_of, plain
from islandgp.bt.core.printer import number_text
from islandgp.bt.core.vocabulary import Vocabulary

SECONDS: Final = "seconds"
"""The purpose of a number of seconds of a wait, a timeout or a cooldown."""

COUNT: Final = "count"
"""The purpose of a count. A number in a comparison has the compared key as its purpose."""

EQUAL: Final = "=="
"""The purpose of a number in a comparison by `==` or `!=`, besides that of the key."""

WEIGHT: Final = "*"
"""The purpose of a number in a sum, and of one that is compared with a sum."""

Purposes: TypeAlias = frozenset[str]

_NONE: Final[Purposes] = frozenset()


@dataclass(frozen=True, slots=True)
class Number:
    """A number in a file."""

    label: str  # the words before it: `charge <`, `repeater`, `constant low =`, `use go: times`
    value: float
    purposes: Purposes  # COUNT, EQUAL, keys; several for a constant or a parameter
    line: int  # from 1
    start: int  # offset in `plain(text)`
    end: int


def numbers_of(
    text: str, vocabulary: Vocabulary, *, name: str = "<tree>", folder: Path | None = None
) -> list[Number]:
    """The numbers of a file in its order, without those of included files.

    `name` and `folder` are those of `parse`. Raises TreeError as `parse` does.
    """
    parts = files_of(text, vocabulary, name=name, folder=folder)
    built(Builder(parts[-1].source, vocabulary), parts)
    reader = _SlotReader(vocabulary)
    slots: list[_Slot] = []
    for part in parts:  # the text itself is the last
        slots = [slot for tree in part.tree.children for slot in reader.slots(tree)]
    of_constants: dict[str, Purposes] = {}
    numbers: list[Number] = []
    for label, purposes, word, constant in reversed(slots):  # defined before it is used
        purposes = reader.resolved(purposes)
        if constant:
            purposes = of_constants.get(constant, _NONE)
        if word.type == "NAME":
            of_constants[str(word)] = of_constants.get(str(word), _NONE) | purposes
        else:
            place = word.line, word.start_pos, word.end_pos
            numbers.append(Number(label, float(word), purposes, *place))
    return numbers[::-1]


def with_numbers(text: str, numbers: Sequence[Number], values: Sequence[float]) -> str:
    """The text with each of these numbers replaced by a value, and otherwise unchanged."""
    text = plain(text)
    parts: list[str] = []
    end = 0
    for number, value in zip(numbers, values, strict=True):
        parts += [text[end : number.start], number_text(value)]
        end = number.end
    return "".join([*parts, text[end:]])


def argument_purpose(action: str, argument: str) -> str:
    """The purpose of a number that is an argument of an action."""
    return f"{action}.{argument}"


class _Slot(NamedTuple):
    """A place of a number in the grammar."""

    label: str
    purposes: Purposes
    word: Any  # lark.Token: a number, or the name of a constant or a parameter
    constant: str = ""  # the constant whose value it is


class _SlotReader:
    """Finds the slots of definitions and of the tree, in the order of the text.

    A purpose can be a key parameter, `subtree(parameter`, whose keys are known after all uses.
    """

    def __init__(self, vocabulary: Vocabulary) -> None:
        self._words = vocabulary
        self._taken: dict[str, dict[str, Purposes]] = {}  # by subtree and parameter
        self._keys: dict[str, set[str]] = {}  # by key parameter, what is passed for it
        self._subtree = ""  # that is being read
        self._parameters: set[str] = set()  # of it

    def resolved(self, purposes: Purposes) -> Purposes:
        """The purposes, with the keys that are passed in place of key parameters."""
        names: set[str] = set()
        waiting = [*purposes]
        while waiting:
            purpose = waiting.pop()
            if purpose not in names:
                names.add(purpose)
                waiting += self._keys.get(purpose, ())
        return frozenset(purpose for purpose in names if "(" not in purpose)

    def slots(self, tree: Any) -> Iterator[_Slot]:
        """The slots in a lark.Tree, in order, except for those of a subtree's parameters."""
        match str(tree.data), tree.children:
            case "subtree", [name, *parameters, body]:
                yield from self._definition(str(name), parameters, body)
            case "constant", [name, word]:
                yield _Slot(f"constant {name} =", _NONE, word, str(name))
            case "comparison", [key, operator, word] if not (_is_sum(key) or _is_sum(word)):
                yield from self._comparison(str(key), operator, word)
            case "comparison" | "sum" | "product" | "negative", parts:
                for part in parts:
                    if _is_sum(part):
                        yield from self.slots(part)
                    elif part.type in ("NAME", "NUMBER"):  # or a key, which has no number
                        label = " ".join(str(each) for each in parts if hasattr(each, "type"))
                        yield _Slot(f"in {label}", frozenset({WEIGHT}), part)
            case "assignment", _:
                return  # a tree may rely on its values elsewhere
            case "use", [name, passed]:
                yield from self._use(str(name), passed.children)
            case "action", [name, values]:
                arguments = self._words.action(str(name)).arguments
                for key, word in (each.children for each in values.children):
                    if arguments[str(key)].numeric:
                        purpose = argument_purpose(str(name), str(key))
                        yield _Slot(f"{name}: {key}", frozenset({purpose}), word)
            case kind, [_, word, *children] if kind in COUNTED or kind in TIMED:
                yield _Slot(kind, frozenset({COUNT if kind in COUNTED else SECONDS}), word)
                for child in children:
                    yield from self.slots(child)
            case "success" | "failure" as policy, [word] if word.type in ("NAME", "NUMBER"):
                yield _Slot(policy, frozenset({COUNT}), word)
            case _, parts:
                for part in parts:
                    if hasattr(part, "children"):  # no word
                        yield from self.slots(part)

    def _definition(self, name: str, parameters: Sequence[Any], body: Any) -> Iterator[_Slot]:
        own = {str(word): _NONE for each in parameters for word in each.children}
        self._subtree, self._parameters = name, {*own}
        for slot in list(self.slots(body)):
            if slot.word in own:
                own[str(slot.word)] |= slot.purposes
            else:
                yield slot
        self._subtree, self._parameters = "", set()
        self._taken[name] = own

    def _comparison(self, key: str, operator: str, word: Any) -> Iterator[_Slot]:
        purpose = self._key(key)
        if key not in self._parameters and self._words.keys[key].words:
            return
        equal = {EQUAL} if operator in ("==", "!=") else set()
        yield _Slot(f"{key} {operator}", frozenset({purpose, *equal}), word)

    def _use(self, name: str, arguments: Sequence[Any]) -> Iterator[_Slot]:
        parameters = self._taken[name]
        passed = {
            f"{name}({parameter}": self._key(str(argument))
            for parameter, argument in zip(parameters, arguments, strict=True)
            if getattr(argument, "type", "") == "NAME"
        }
        for key_parameter, key in passed.items():
            self._keys.setdefault(key_parameter, set()).add(key)
        for (parameter, purposes), argument in zip(parameters.items(), arguments, strict=True):
            if hasattr(argument, "children"):
                yield from self.slots(argument)
            elif argument.type != "FILE":  # a text
                purposes_here = frozenset(passed.get(purpose, purpose) for purpose in purposes)
                yield _Slot(f"use {name}: {parameter} =", purposes_here, argument)

    def _key(self, name: str) -> str:
        """The purpose of a number that is compared with a key or a key parameter."""
        return f"{self._subtree}({name}" if name in self._parameters else name


def _is_sum(part: Any) -> bool:
    """True for a lark.Tree, False for a word."""
    return hasattr(part, "children")
