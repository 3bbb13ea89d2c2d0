"""Trees as JSON; reading a written file returns an equal tree.

docs/exports.md shows the format: nodes and conditions as objects with the fields of their classes.
Comments and named subtrees are left out, as they are not part of a tree.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator
from functools import cache
from itertools import count
from typing import Any, Final, Literal

from pydantic import BaseModel, TypeAdapter, ValidationError

from islandgp.bt.core.kinds import KINDS
from islandgp.bt.core.language import MAX_LEVELS, MAX_NODES, parse, to_text
from islandgp.bt.core.node import Node
from islandgp.bt.core.vocabulary import Vocabulary
from islandgp.errors import TreeError

FORMAT: Final = "islandgp-tree"


class _File(BaseModel, extra="forbid"):
    format: Literal["islandgp-tree"]
    tree: Any


class _PlainNode(BaseModel, extra="forbid"):
    """A node whose arguments and children are not yet checked."""

    kind: Literal[tuple(KINDS)]  # type: ignore[valid-type] # computed
    args: dict[str, Any] = {}
    children: list[Any] = []


def to_json(tree: Node) -> str:
    """The text of a JSON file."""
    # Without a vocabulary, a condition has a word and not the word's number.
    document = {"format": FORMAT, "tree": _plain(parse(to_text(tree)))}
    return json.dumps(document, indent=2) + "\n"


def _plain(value: Any) -> Any:
    """A node, its arguments or a condition as JSON values, without what is empty."""
    if hasattr(value, "_asdict"):
        return {key: _plain(each) for key, each in value._asdict().items() if each not in ((), "")}
    return [*map(_plain, value)] if isinstance(value, tuple) else value


def from_json(text: str, vocabulary: Vocabulary | None = None, *, name: str = "<json>") -> Node:
    """The tree in a JSON text.

    Raises:
        TreeError: it is not JSON, or not such a tree; the message has the place.
    """
    try:
        # An integer of any length is a float; the largest ones are infinite, and rejected.
        document = json.loads(text.removeprefix("\ufeff"), parse_int=float)
        tree = _node(_valid(_File.model_validate, document, "").tree, "tree", 1, count(1))
    except json.JSONDecodeError as error:
        line, column = error.lineno, error.colno
        message = f"{name}:{line}:{column}: not JSON: {error.msg}"
        raise TreeError(message, line=line, column=column) from None
    except RecursionError:
        raise TreeError(f"{name}: the tree is nested too deeply") from None
    except ValueError as error:
        raise TreeError(f"{name}: {error}") from None
    written, place = to_text(tree), f"{name}, as text"
    if parse(written, name=place) != tree:
        raise TreeError(f"{name}: expected names and values, found other parts of a tree in one")
    return parse(written, vocabulary, name=place)


def _node(value: Any, at: str, level: int, numbers: Iterator[int]) -> Node:
    """The node at a path such as `tree.children[0]`, on a level from 1. Raises ValueError."""
    if level > MAX_LEVELS or next(numbers) > MAX_NODES:
        raise ValueError(f"expected a tree of at most {MAX_LEVELS} levels and {MAX_NODES} nodes")
    plain = _valid(_PlainNode.model_validate, value, at)
    kind = KINDS[plain.kind]
    if plain.args and not kind.arguments:
        raise ValueError(f"{_short(at)}: expected no args of {plain.kind}, found some")
    args = _valid(_arguments(plain.kind), plain.args, f"{at}.args") if kind.arguments else ()
    children = enumerate(plain.children)
    nodes = tuple(_node(v, f"{at}.children[{i}]", level + 1, numbers) for i, v in children)
    fewest, most = kind.children
    if not fewest <= len(nodes) <= most:
        expected = fewest if fewest == most else f"at least {fewest}"
        raise ValueError(f"{_short(at)}: expected {expected} children, found {len(nodes)}")
    return Node(plain.kind, args, nodes)


@cache
def _arguments(kind: str) -> Callable[[Any], Any]:
    """The function that makes the args of a node of a kind from their JSON values."""
    adapter = TypeAdapter(KINDS[kind].args)
    # As JSON, since only there a strict model takes a list as a tuple.
    return lambda value: adapter.validate_json(json.dumps(value, allow_nan=False), strict=True)


def _valid(validate: Callable[[Any], Any], value: Any, at: str) -> Any:
    """The validated value. Raises ValueError with the deepest of the errors."""
    try:
        return validate(value)
    except ValidationError as error:
        first = max(error.errors(include_url=False), key=lambda e: len(e["loc"]))
        path = _short(".".join(str(part) for part in (at, *first["loc"]) if part != ""))
        is_object = first["type"] == "model_type"
        expected = "input should be an object" if is_object else first["msg"]
        message = f"{expected[0].lower()}{expected[1:]}, found {first['input']!r:.40}"
        raise ValueError(f"{path}: {message}" if path else message) from None


def _short(path: str) -> str:
    """A path whose middle is left out if it is very long."""
    return path if len(path) <= 100 else f"{path[:40]}...{path[-40:]}"
