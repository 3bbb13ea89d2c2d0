"""A vocabulary from a file, for a robot whose domain is not installed here.

The file is a domain's schema as JSON, as `islandgp domain NAME --json` prints it, or
BehaviorTree.CPP XML with a `TreeNodesModel`. A model declares no blackboard entries, so the keys
are those that the tree reads: numbers if they are compared, else flags. A word on the right of a
comparison is a key, too.
"""

from __future__ import annotations

import json
import re
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, Final

from pydantic import ValidationError

from islandgp.bt.core import parameters
from islandgp.bt.core.arithmetic import Named
from islandgp.bt.core.condition import OPERATORS
from islandgp.bt.core.language import domain_of, parse
from islandgp.bt.core.node import Node, SetArgs, asked_in, walk, written_in
from islandgp.bt.core.node_builder import MAX_NUMBER
from islandgp.bt.core.parameters import (
    Parameter,
    adapter,
    first_fault,
    real,
    switch,
    whole,
)
from islandgp.bt.core.source import shown
from islandgp.bt.core.vocabulary import (
    NAME,
    Action,
    Key,
    Vocabulary,
    condition_leaf,
    enumeration,
    is_name,
)
from islandgp.bt.export.cpp_importer import GATES, PRECONDITIONS
from islandgp.bt.export.json import from_json
from islandgp.bt.export.xml_reader import Element, read_xml
from islandgp.errors import DomainError
from islandgp.plain import read_json

UNNAMED: Final = "model"
"""Domain of a vocabulary from a TreeNodesModel, which has no domain name."""

_PORTS: Final = {"double": "number", "float": "number", "int": "integer", "bool": "flag"}
"""Function that declares an argument, by the type of its port; a text for other types."""
_NUMBER_KEY: Final = Key("", flag=False, low=-float(MAX_NUMBER), high=float(MAX_NUMBER))
"""A key that a tree compares and that a model does not declare."""
_IN_AND_OUT: Final = ("input_port", "output_port", "inout_port", "bidirectional_port")
_SCRIPTS: Final = ("code", "condition", *PRECONDITIONS)  # attributes that ask the blackboard
_TEXT: Final = re.compile("'[^']*'")
_WRITTEN: Final = re.compile(r"([A-Za-z_]\w*)\s*(?::=|[-+*/]?=(?!=))")
_WORDS: Final = re.compile(r"([A-Za-z_]\w*)\s*(?::=|[=!]?=)\s*'([^']*)'")
_WORD: Final = re.compile(
    r"(?P<before>[<>=!]=|[-+*/<>])?\s*\b(?P<word>[A-Za-z_]\w*)(?=\s*(?P<after>[<>=!]=|[-+*/<>])?)"
)


def declared(
    text: str, tree: str, *, name: str, tree_name: str = "<tree>", folder: Path | None = None
) -> Vocabulary:
    """The vocabulary declared in a file.

    Args:
        text: the declaration.
        tree: the text of the tree that is read with it, of which a model takes its keys.
        name: of the declaration, in messages.
        tree_name: of the tree, in messages.
        folder: of the tree's file, as in `parse`.

    Raises:
        DomainError: the text has neither format, or an invalid declaration.
        TreeError: the XML or the tree is invalid.
    """
    if text.lstrip("\ufeff \t\r\n").startswith("<"):
        model = read_xml(text, name=name)
        actions = dict(_model(model, name))
        if not actions:
            raise DomainError(f"{name}: expected a <TreeNodesModel> with actions, found none.")
        keys = _keys_in(model, tree, tree_name, folder)
        return Vocabulary(domain_of(tree) or UNNAMED, actions, keys)
    return _schema(text, name)


def _model(root: Element, name: str) -> Iterator[tuple[str, Action]]:
    """The leaves that a model declares."""
    models = [root] if root.tag == "TreeNodesModel" else root.children
    for model in models:
        for element in model.children if model.tag == "TreeNodesModel" else ():
            identity = element.attributes.get("ID", "")
            if element.tag not in ("Action", "Condition") and identity not in GATES:
                continue
            if not is_name(identity):
                raise DomainError(
                    f"{name}:{element.line}:{element.column}: expected an ID of letters, digits and"
                    f" _ that is not a keyword of the language, found {shown(identity)}; rename it."
                )
            ports = {
                port.attributes.get("name", ""): _port(port)
                for port in element.children
                if port.tag in _IN_AND_OUT and NAME.fullmatch(port.attributes.get("name", ""))
            }
            known = condition_leaf("") if element.tag == "Condition" else Action("")
            yield identity, replace(known, arguments=ports)


def _port(port: Element) -> Parameter:
    """A number, a flag or a text; a port without a default has 0, no or an empty text."""
    sort = _PORTS.get(port.attributes.get("type", "")) if port.tag == "input_port" else None
    default = port.attributes.get("default", "")
    if sort is None:
        return parameters.text("", default if parameters.is_text(default) else "")
    if sort == "flag":
        return switch("", default=default in ("true", "1"))
    number = float(default) if re.fullmatch(r"-?[0-9]{1,9}(\.[0-9]{1,9})?", default) else 0.0
    if sort == "integer":
        return whole("", -MAX_NUMBER, MAX_NUMBER, default=int(number))
    return real("", -MAX_NUMBER, MAX_NUMBER, default=number)


def words_as_keys(tree: Node, vocabulary: Vocabulary) -> list[str]:
    """Words of a tree that a model makes keys, but that may be meant as words of a key.

    These are the words on the right of == and != that the tree compares in no other way.
    """
    asked = list(asked_in(tree))
    equal = ("==", "!=")
    others = {term.key for term in asked}
    others |= {k for t in asked if t.operator not in equal or t.other not in t.keys for k in t.keys}
    undeclared = {name for name, key in vocabulary.keys.items() if key == _NUMBER_KEY}
    return sorted({term.other for term in asked} & undeclared - others)


def _keys_in(model: Element, tree: str, name: str, folder: Path | None) -> dict[str, Key]:
    """The keys of a tree, which is in the tree language, in XML or in JSON.

    The scripts of the model's own trees show which texts are words of a key.
    """
    start = tree.lstrip("\ufeff \t\r\n")[:1]
    scripts = [*_scripts(model)]
    if start == "<":
        scripts += _scripts(read_xml(tree, name=name))
        written = frozenset(key for script in scripts for key in _WRITTEN.findall(script))
        asked = {
            (match["word"], bool(match["before"] or match["after"]))
            for script in scripts
            for match in _WORD.finditer(_TEXT.sub("''", script))
            if match["word"] not in ("and", "or", "not", "true", "false")
        }
    else:
        is_json = start in ("{", "[")
        root = from_json(tree, name=name) if is_json else parse(tree, name=name, folder=folder)
        asked = {(key, term.operator in OPERATORS) for term in asked_in(root) for key in term.keys}
        sets = [node.args.assigned for node in walk(root) if isinstance(node.args, SetArgs)]
        asked |= {(k, not isinstance(t.number, Named)) for t in sets for k in t.keys}
        written = written_in(root)
    words: dict[str, dict[str, None]] = {}  # by key, in the order of the scripts
    for key, text in (pair for script in scripts for pair in _WORDS.findall(script)):
        words.setdefault(key, {})[text] = None
    enumerated = {
        n: enumeration("", [*texts]) for n, texts in words.items() if all(map(is_name, texts))
    }
    all_words = {word for key in enumerated.values() for word in key.words}
    # The pair of a key that is compared somewhere comes last.
    keys = {key: _NUMBER_KEY if compared else Key("") for key, compared in sorted(asked)}
    keys = {n: enumerated.get(n, key) for n, key in keys.items() if n not in all_words}
    for each in written & keys.keys():
        initial = "no" if keys[each].flag else next(iter(keys[each].words), 0.0)
        keys[each] = replace(keys[each], initial=initial)
    return keys


def _scripts(element: Element) -> Iterator[str]:
    waiting = [element]
    while waiting:
        each = waiting.pop()
        if each.tag == "SetBlackboard":
            key, value = (each.attributes.get(n, "").strip("{}") for n in ("output_key", "value"))
            is_flag, is_text = value in ("true", "false"), NAME.fullmatch(value)
            form = "{} := {}" if is_flag else "{} := '{}'" if is_text else "{} := {} + 0"
            yield form.format(key, value)
        yield from (each.attributes[a] for a in _SCRIPTS if a in each.attributes)
        if each.tag.startswith("Switch"):
            yield each.attributes.get("variable", "").strip("{}") + " =="
        waiting += each.children


def _line(text: str, plain: Any, path: Sequence[str | int]) -> int:
    """The line of the last key on a path into a JSON text, whose value is `plain`."""
    at = 0
    for key in path:
        if isinstance(plain, dict) and key in plain:
            match = re.compile(rf"{re.escape(json.dumps(key))}\s*:").search(text, at)
            at = match.end() if match else at
            plain = plain[key]
    return text.count("\n", 0, at) + 1


def _schema(text: str, name: str) -> Vocabulary:
    try:
        plain = read_json(text.removeprefix("\ufeff"))
        declaration = plain.get("vocabulary", plain) if isinstance(plain, dict) else plain
        return adapter(Vocabulary).validate_python(declaration)  # type: ignore[no-any-return]
    except ValidationError as error:
        path, reason, _ = first_fault(error)
        at, line = (
            ".".join(path) or "the file",
            _line(text, plain, ("vocabulary", *path, "default")),
        )
        raise DomainError(
            f"{name}:{line}: {at:.100}: {reason}; see `islandgp domain --json`."
        ) from None
    except DomainError as error:
        raise DomainError(f"{name}: {error}") from None
    except ValueError:
        raise DomainError(
            f"{name}: the file: expected JSON of `islandgp domain NAME --json`, or"
            " BehaviorTree.CPP XML."
        ) from None
