"""A vocabulary from a file, for a robot whose domain is not installed here.

The file is a domain's schema as JSON, as `islandgp domain NAME --json` prints it, or
BehaviorTree.CPP XML with a `TreeNodesModel`. A model declares no blackboard entries,
so the keys are those that the tree asks: a number where it compares, else a flag.
"""

from __future__ import annotations

import json
import re
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, Final, NoReturn

from islandgp.bt.builder import MAX_NUMBER
from islandgp.bt.condition import FLAG_OPERATORS, OPERATORS, Condition
from islandgp.bt.export.xml_reader import Element, read_xml
from islandgp.bt.language import domain_of, parse
from islandgp.bt.node import FAILURE, STATUS_NAMES, SUCCESS, asked_in
from islandgp.bt.source import shown
from islandgp.bt.vocabulary import RESERVED, Action, Key, Vocabulary
from islandgp.errors import DomainError

UNNAMED: Final = "model"
"""The domain of a vocabulary from a TreeNodesModel, which names none."""

_SCRIPTS: Final = ("code", "condition")  # attributes that ask the blackboard
_WORD: Final = re.compile(r"([A-Za-z_][A-Za-z0-9_]*)\s*([<>=!]=|[<>])?")
_NUMBERS: Final = ("low", "high", "step", "most")  # entries of a key that is a number
_STATUSES: Final = {name: status for status, name in enumerate(STATUS_NAMES[:3])}


def declared(
    text: str, tree: str, *, name: str, tree_name: str = "<tree>", folder: Path | None = None
) -> Vocabulary:
    """The vocabulary that a file declares.

    Args:
        text: the declaration.
        tree: the text of the tree that is read with it, of which a model takes its keys.
        name: what messages call the declaration.
        tree_name: what they call the tree.
        folder: of the tree's file, as in `parse`.

    Raises:
        DomainError: it is neither of both forms, or declares what the language cannot say.
        TreeError: it is no XML, or the tree is not one.
    """
    if text.lstrip("\ufeff \t\r\n").startswith("<"):
        actions = dict(_model(read_xml(text, name=name), name))
        if not actions:
            raise DomainError(f"{name}: expected a <TreeNodesModel> with actions, found none.")
        return Vocabulary(domain_of(tree) or UNNAMED, actions, _asked(tree, tree_name, folder))
    return _schema(text, name)


def _model(root: Element, name: str) -> Iterator[tuple[str, Action]]:
    """The leaves that a model declares; what has children is known to the language or not."""
    models = [root] if root.tag == "TreeNodesModel" else root.children
    for model in models:
        for element in model.children if model.tag == "TreeNodesModel" else ():
            if element.tag not in ("Action", "Condition"):
                continue
            identity = element.attributes.get("ID", "")
            if not re.fullmatch(r"[A-Za-z_][A-Za-z0-9_]*", identity) or identity in RESERVED:
                raise DomainError(
                    f"{name}:{element.line}:{element.column}: expected an ID of letters, digits and"
                    f" _ that is no word of the language, found {shown(identity)}; rename it."
                )
            at_once = frozenset({FAILURE, SUCCESS})
            known = Action("") if element.tag == "Action" else Action("", at_once)
            yield identity, known


def _asked(tree: str, name: str, folder: Path | None) -> dict[str, Key]:
    """The keys that a tree asks, in our language or in XML."""
    numbers: dict[str, bool] = {}
    if tree.lstrip("\ufeff \t\r\n").startswith("<"):
        for script in _scripts(read_xml(tree, name=name)):
            for word, compared in _WORD.findall(script):
                if word not in ("and", "or", "not", "true", "false"):
                    numbers[word] = numbers.get(word, False) or bool(compared)
    else:
        for term in asked_in(parse(tree, name=name, folder=folder)):
            compares = term.operator in OPERATORS
            numbers[term.key] = numbers.get(term.key, False) or compares
    whole = Key("", flag=False, low=-float(MAX_NUMBER), high=float(MAX_NUMBER))
    return {key: whole if number else Key("") for key, number in sorted(numbers.items())}


def _scripts(element: Element) -> Iterator[str]:
    waiting = [element]
    while waiting:
        each = waiting.pop()
        yield from (each.attributes[a] for a in _SCRIPTS if a in each.attributes)
        waiting += each.children


def _schema(text: str, name: str) -> Vocabulary:
    try:
        found = json.loads(text.removeprefix("\ufeff"))
    except (ValueError, RecursionError):
        _wrong(name, "the file", "JSON of `islandgp domain NAME --json`, or BehaviorTree.CPP XML")
    words = _mapping(found, name, "the file").get("vocabulary", found)
    words = _mapping(words, name, "vocabulary")
    actions = {
        action: _action(_mapping(given, name, f"actions.{action}"), name, f"actions.{action}")
        for action, given in _mapping(words.get("actions"), name, "actions").items()
    }
    keys = {
        key: _key(_mapping(given, name, f"keys.{key}"), name, f"keys.{key}")
        for key, given in _mapping(words.get("keys", {}), name, "keys").items()
    }
    domain = words.get("domain")
    if not isinstance(domain, str):
        _wrong(name, "domain", "a name")
    try:
        return Vocabulary(domain, actions, keys)
    except DomainError as error:
        raise DomainError(f"{name}: {error}") from None


def _action(given: Mapping[str, Any], name: str, at: str) -> Action:
    _only(given, ("meaning", "statuses", "to_start", "to_succeed", "changes"), name, at)
    known = [*_STATUSES]
    statuses = given.get("statuses", known)
    if not isinstance(statuses, list) or not statuses or any(s not in known for s in statuses):
        _wrong(name, f"{at}.statuses", f"some of {', '.join(_STATUSES)}")
    changes = _mapping(given.get("changes", {}), name, f"{at}.changes")
    if not all(sign in (-1, 1) for sign in changes.values()):
        _wrong(name, f"{at}.changes", "-1 or 1 for each key")
    return Action(
        _meaning(given, name, at),
        frozenset(_STATUSES[status] for status in statuses),
        _conditions(given, "to_start", name, at),
        _conditions(given, "to_succeed", name, at),
        changes,
    )


def _conditions(given: Mapping[str, Any], which: str, name: str, at: str) -> tuple[Condition, ...]:
    found = given.get(which, [])
    for each in found if isinstance(found, list) else [""]:
        right = isinstance(each, list) and len(each) == 3 and isinstance(each[0], str)
        if not right or each[1] not in (*OPERATORS, *FLAG_OPERATORS) or not _number(each[2]):
            _wrong(name, f"{at}.{which}", 'a list of conditions such as ["charge", "<", 25]')
    return tuple(Condition(key, operator, float(number)) for key, operator, number in found)


def _key(given: Mapping[str, Any], name: str, at: str) -> Key:
    _only(given, ("meaning", "flag", *_NUMBERS), name, at)
    numbers = {key: given[key] for key in _NUMBERS if key in given}
    flag = given.get("flag", not numbers)
    if not isinstance(flag, bool):
        _wrong(name, f"{at}.flag", "true or false")
    if numbers.get("most", 0) is None:
        del numbers["most"]
    for key, value in numbers.items():
        if not _number(value):
            _wrong(name, f"{at}.{key}", "a number")
    return Key(_meaning(given, name, at), flag, **{k: float(v) for k, v in numbers.items()})


def _only(given: Mapping[str, Any], known: Sequence[str], name: str, at: str) -> None:
    if unknown := sorted(set(given) - set(known)):
        _wrong(name, at, f"no other entries than {', '.join(known)}, found {shown(unknown[0])}")


def _number(value: object) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool) and abs(value) < 1e300


def _meaning(given: Mapping[str, Any], name: str, at: str) -> str:
    meaning = given.get("meaning", "")
    if not isinstance(meaning, str):
        _wrong(name, f"{at}.meaning", "a text")
    return meaning


def _mapping(value: object, name: str, at: str) -> Mapping[str, Any]:
    if not isinstance(value, dict):
        _wrong(name, at, "a JSON object")
    return value


def _wrong(name: str, at: str, expected: str) -> NoReturn:
    raise DomainError(f"{name}: {at}: expected {expected}; see `islandgp domain --json`.")
