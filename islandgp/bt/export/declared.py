"""A vocabulary from a file, for a robot whose domain is not installed here.

The file is a domain's schema as JSON, as `islandgp domain NAME --json` prints it, or
BehaviorTree.CPP XML with a `TreeNodesModel`. A model declares no blackboard entries, so the keys
are those that the tree reads: numbers if they are compared, else flags. A word on the right of a
comparison is a key, too.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Final

from pydantic import ValidationError

from islandgp.bt.core import parameters
from islandgp.bt.core.language import domain_of, parse
from islandgp.bt.core.node import CountArgs, SecondsArgs, SetArgs, asked_in, keys_of, walk
from islandgp.bt.core.node_builder import MAX_NUMBER
from islandgp.bt.core.parameters import (
    Parameter,
    adapter,
    first_fault,
    real,
    switch,
    whole,
)
from islandgp.bt.core.printer import condition_text
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
from islandgp.bt.export.cpp_importer import GATES, POSTCONDITIONS, PRECONDITIONS
from islandgp.bt.export.json import from_json
from islandgp.bt.export.xml_reader import Element, XmlTrees, read_xml
from islandgp.errors import DomainError
from islandgp.plain import read_json

UNNAMED: Final = "model"
"""Domain of a vocabulary from a TreeNodesModel, which has no domain name."""

_NUMBER_KEY: Final = Key("", flag=False, low=-float(MAX_NUMBER), high=float(MAX_NUMBER))
"""A key that a tree compares and that a model does not declare."""
_IN_AND_OUT: Final = ("input_port", "output_port", "inout_port", "bidirectional_port")
_SCRIPTS: Final = ("code", "condition", "if", *PRECONDITIONS, *POSTCONDITIONS)
"""Attributes that ask the blackboard, or write to it."""
_AMOUNTS: Final = {"num_cycles": " times", "num_attempts": " times", "seconds": ""}
"""Attributes in which an entry of the blackboard is a number; of some a whole one."""
_TEXT: Final = re.compile("'[^']*'")
_WRITTEN: Final = re.compile(r"([A-Za-z_]\w*)\s*(?::=|[-+*/]?=(?!=))")
_WORDS: Final = re.compile(r"([A-Za-z_]\w*)\s*(?::=|[=!]?=)\s*'([^']*)'")
_NAME: Final = re.compile(r"'[^']*'|[A-Za-z_]\w*")
_COUNTED: Final = re.compile(r"(\w+) < 1 times")
_WORD: Final = re.compile(
    r"(?P<before>[<>=!]=|[-+*/<>])?\s*\b(?P<word>[A-Za-z_]\w*)"
    r"(?=\s*(?P<after>[<>=!]=|[-+*/<>]|:?=\s*[-\d])?)"
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
            if element.tag == "SubTree":
                identity = re.sub(r"\W", "_", identity)
            elif element.tag not in ("Action", "Condition") and identity not in GATES:
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
    default = port.attributes.get("default", "")
    number = float(default) if re.fullmatch(r"-?[0-9]{1,9}(\.[0-9]{1,9})?", default) else 0.0
    match port.attributes.get("type", "") if port.tag == "input_port" else "":
        case "double" | "float":
            return real("", -MAX_NUMBER, MAX_NUMBER, default=number)
        case "int":
            return whole("", -MAX_NUMBER, MAX_NUMBER, default=int(number))
        case "bool":
            return switch("", default=default in ("true", "1"))
    return parameters.text("", default if parameters.is_text(default) else "")


def _keys_in(model: Element, tree: str, name: str, folder: Path | None) -> dict[str, Key]:
    """The keys of a tree, which is in the tree language, in XML or in JSON.

    The scripts of the model's own trees show which texts are words of a key.
    """
    if (start := tree.lstrip("\ufeff \t\r\n")[:1]) == "<":
        scripts = [*_scripts(model), *_scripts(read_xml(tree, name=name), name, folder)]
    else:
        is_json = start in ("{", "[")
        root = from_json(tree, name=name) if is_json else parse(tree, name=name, folder=folder)
        sets = (node.args.assigned for node in walk(root) if isinstance(node.args, SetArgs))
        scripts = [*_scripts(model), *map(condition_text, (*asked_in(root), *sets))]
        amounts = (n.args for n in walk(root) if isinstance(n.args, CountArgs | SecondsArgs))
        scripts += [
            f"{key} < 1{' times' * isinstance(args, CountArgs)}"
            for args in amounts
            for key in keys_of(args)
        ]
    words: dict[str, dict[str, None]] = {}  # by key, in the order of the scripts
    compared: dict[str, bool] = {}  # by key
    for script in scripts:
        for key, text in _WORDS.findall(script):
            words.setdefault(key, {})[text] = None
        for match in _WORD.finditer(_TEXT.sub("''", script)):
            key, beside = match["word"], bool(match["before"] or match["after"])
            compared[key] = compared.get(key, False) or beside
    enumerated = {
        n: enumeration("", [*texts])
        for n, texts in words.items()
        if all(is_name(t) or (not NAME.fullmatch(t) and parameters.is_text(t)) for t in texts)
    }
    no_keys = {"and", "or", "not", "true", "false", "yes", "no"}
    no_keys |= {word for key in enumerated.values() for word in key.words}
    keys = {
        key: enumerated.get(key, _NUMBER_KEY if is_number else Key(""))
        for key, is_number in sorted(compared.items())
        if key not in no_keys
    }
    counts = {key for script in scripts for key in _COUNTED.findall(script)}
    keys |= {key: replace(keys[key], whole=True) for key in counts & keys.keys()}
    for each in keys.keys() & {key for script in scripts for key in _WRITTEN.findall(script)}:
        initial = "no" if keys[each].flag else next(iter(keys[each].words), 0.0)
        keys[each] = replace(keys[each], initial=initial)
    return keys


def _scripts(root: Element, name: str = "", folder: Path | None = None) -> Iterator[str]:
    """The scripts of a file and of the trees that it uses, with the keys that it passes to them."""
    waiting: list[tuple[Element, dict[str, str]]] = [(root, {})]
    seen: set[tuple[str, frozenset[tuple[str, str]]]] = set()
    trees = XmlTrees(root, name, folder) if folder else None
    version_3 = root.attributes.get("BTCPP_format", "3") == "3"
    for each, names in waiting:  # the list grows while it is iterated
        given = each.attributes
        for script in _own_scripts(each):
            yield _NAME.sub(lambda m, names=names: names.get(m[0], m[0]), script)  # type: ignore[misc]
        if trees and each.tag.startswith("SubTree"):
            passed = {k: v for k, v in given.items() if k[0] != "_" and k not in ("ID", "name")}
            for key, value in passed.items():
                is_key = value[:1] == "{" or (version_3 and each.tag == "SubTree")
                entry = value.strip("{}")
                plain = is_key or re.fullmatch(r"-?[0-9.]+", value)
                passed[key] = names.get(entry, entry) if plain else f"'{value}'"
            use = given.get("ID", ""), frozenset(passed.items())
            found = trees.find(use[0])
            if found and use not in seen:
                seen.add(use)
                waiting.append((found.element, passed))
        waiting += [(child, names) for child in each.children]


def _own_scripts(each: Element) -> Iterator[str]:
    """The scripts of an element, and what its ports say of keys, as scripts."""
    given = each.attributes
    if each.tag == "SetBlackboard" or each.tag.startswith("BlackboardCheck"):
        is_set = each.tag == "SetBlackboard"
        ports = ("output_key", "value") if is_set else ("value_A", "value_B")
        key, value = (given.get(port, "") for port in ports)
        is_plain = re.fullmatch(r"\{\w+\}|-?[0-9.]+|true|false", value)
        value = value.strip("{}") if is_plain else f"'{value}'"
        yield f"{key.strip('{}')} {':=' if is_set else '=='} {value}"
    yield from (given[a].replace('"', "'") for a in _SCRIPTS if a in given)
    for port, unit in _AMOUNTS.items():
        if (value := given.get(port, ""))[:1] == "{":
            yield f"{value[1:-1]} < 1{unit}"
    if each.tag.startswith("Switch"):
        yield given.get("variable", "").strip("{}") + " =="


def _schema(text: str, name: str) -> Vocabulary:
    try:
        plain = read_json(text.removeprefix("\ufeff"))
        declaration = plain.get("vocabulary", plain) if isinstance(plain, dict) else plain
        return adapter(Vocabulary).validate_python(declaration)  # type: ignore[no-any-return]
    except ValidationError as error:
        path, reason, _ = first_fault(error)
        at = ".".join(path) or "the file"
        raise DomainError(f"{name}: {at:.100}: {reason}; see `islandgp domain --json`.") from None
    except DomainError as error:
        raise DomainError(f"{name}: {error}") from None
    except (ValueError, TypeError):  # not JSON; a list in the place of a name
        raise DomainError(
            f"{name}: the file: expected JSON of `islandgp domain NAME --json`, or"
            " BehaviorTree.CPP XML."
        ) from None
