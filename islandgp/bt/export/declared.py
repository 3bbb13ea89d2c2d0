"""A vocabulary from a file, for a robot whose domain is not installed here.

The file is a domain's schema as JSON, as `islandgp domain NAME --json` prints it, or
BehaviorTree.CPP XML with a `TreeNodesModel`. A model declares no blackboard entries, so the keys
are those that the tree reads: numbers if they are compared, else flags. A word on the right of a
comparison is a key, too.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Final

from islandgp.bt.core import parameters
from islandgp.bt.core.arithmetic import Named
from islandgp.bt.core.condition import FLAG_OPERATORS, terms
from islandgp.bt.core.language import domain_of, parse
from islandgp.bt.core.node import Args, CountArgs, GuardArgs, SecondsArgs, SetArgs, keys_of, walk
from islandgp.bt.core.node_builder import MAX_NUMBER
from islandgp.bt.core.parameters import Parameter, is_name, real, switch, validated, whole
from islandgp.bt.core.source import shown
from islandgp.bt.core.vocabulary import NAME, Action, Key, Vocabulary, condition_leaf, enumeration
from islandgp.bt.export.cpp_importer import GATES
from islandgp.bt.export.import_cpp import args_of
from islandgp.bt.export.json import from_json
from islandgp.bt.export.xml_reader import Element, read_xml
from islandgp.errors import DomainError
from islandgp.plain import read_json

UNNAMED: Final = "model"  # domain of a vocabulary from a TreeNodesModel, which has no domain name

_NUMBER_KEY: Final = Key("", flag=False, low=-float(MAX_NUMBER), high=float(MAX_NUMBER))
"""A key that a tree compares and that a model does not declare."""
_IN_AND_OUT: Final = ("input_port", "output_port", "inout_port", "bidirectional_port")


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
        leaves = Vocabulary(domain_of(tree) or UNNAMED, actions)
        # The model's own trees show which texts are words of a key.
        used = [*args_of(model, leaves), *_args_in(tree, leaves, tree_name, folder)]
        return replace(leaves, keys=_keys_of(used))
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


def _args_in(tree: str, leaves: Vocabulary, name: str, folder: Path | None) -> list[Args]:
    """The arguments in a tree, which is in the tree language, in XML or in JSON."""
    start = tree.lstrip("\ufeff \t\r\n")[:1]
    if start == "<":
        return args_of(read_xml(tree, name=name), leaves, folder)
    is_json = start in ("{", "[")
    root = from_json(tree, name=name) if is_json else parse(tree, name=name, folder=folder)
    return [node.args for node in walk(root)]


def _keys_of(used: Iterable[Args]) -> dict[str, Key]:
    """The keys that arguments name, by what they are compared with or set to."""
    words: dict[str, dict[str, None]] = {}  # by key, in the order of the tree
    names, numbers, counts, written = set[str](), set[str](), set[str](), set[str]()
    for args in used:
        names.update(keys_of(args))
        asked = [*terms(args.condition)] if isinstance(args, GuardArgs) else []
        if isinstance(args, CountArgs | SecondsArgs):
            numbers.update(keys_of(args))
            counts.update(keys_of(args) * isinstance(args, CountArgs))
        elif isinstance(args, SetArgs):
            written.add(args.assigned.key)
            asked = [args.assigned]
        for term in asked:
            is_copy = term.operator == "=" and NAME.fullmatch(term.other)
            if term.other[:1] == '"':
                words.setdefault(term.key, {})[term.other[1:-1]] = None
            elif not (is_copy or term.operator in FLAG_OPERATORS or isinstance(term.number, Named)):
                numbers.update(term.keys)
    enumerated = {
        key: enumeration("", [*texts])
        for key, texts in words.items()
        if all(is_name(t) or (not NAME.fullmatch(t) and parameters.is_text(t)) for t in texts)
    }
    known = {"yes", "no", "true", "false"}.union(*(key.words for key in enumerated.values()))
    keys: dict[str, Key] = {}
    for name in sorted(name for name in names - known if NAME.fullmatch(name)):
        key = enumerated.get(name, _NUMBER_KEY if name in numbers else Key(""))
        initial = "no" if key.flag else next(iter(key.words), 0.0)
        whole = key.whole or name in counts
        keys[name] = replace(key, whole=whole, initial=initial if name in written else None)
    return keys


def _schema(text: str, name: str) -> Vocabulary:
    try:
        plain = read_json(text.removeprefix("\ufeff"))
        declaration = plain.get("vocabulary", plain) if isinstance(plain, dict) else plain
        where = f"{name}, the JSON of `islandgp domain NAME --json`"
        return validated(Vocabulary, declaration, where)  # type: ignore[no-any-return]
    except (ValueError, TypeError):  # not JSON; a list in the place of a name
        raise DomainError(
            f"{name}: the file: expected JSON of `islandgp domain NAME --json`, or"
            " BehaviorTree.CPP XML."
        ) from None
