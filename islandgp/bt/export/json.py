"""Trees as JSON; reading a written file returns an equal tree.

docs/exports.md shows the format: nodes and conditions as objects with the fields of their classes.
Comments and named subtrees are left out, as they are not part of a tree.
"""

from __future__ import annotations

import json
from typing import Any, Literal

from pydantic import BaseModel, ValidationError, ValidationInfo, field_validator

from islandgp.bt.core.kinds import KINDS
from islandgp.bt.core.language import parse, to_text
from islandgp.bt.core.node import Node
from islandgp.bt.core.parameters import adapter
from islandgp.bt.core.vocabulary import Vocabulary
from islandgp.errors import TreeError
from islandgp.plain import read_json


class _JsonNode(BaseModel, extra="forbid", validate_default=True):
    kind: Literal[tuple(KINDS)]  # type: ignore[valid-type] # computed
    args: Any = {}
    children: list[_JsonNode] = []

    @field_validator("args")
    @classmethod
    def _args_of_kind(cls, value: Any, info: ValidationInfo) -> Any:
        kind: Any = KINDS.get(info.data.get("kind", ""))
        if kind and kind.arguments:
            # As JSON, since only there a strict type takes a list as a tuple.
            return adapter(kind.args).validate_json(json.dumps(value), strict=True)
        if kind and value:
            raise ValueError("Expected no args of this kind")
        return ()

    def node(self) -> Node:
        return Node(self.kind, self.args, tuple(child.node() for child in self.children))


class _JsonTree(BaseModel, extra="forbid"):
    format: Literal["islandgp-tree"] = "islandgp-tree"
    tree: _JsonNode


def to_json(tree: Node) -> str:
    """The text of a JSON file."""
    # Without a vocabulary, a condition has a word and not the word's number.
    document = {"format": "islandgp-tree", "tree": _plain(parse(to_text(tree)))}
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
    place = f"{name}, as text"
    try:
        tree = _JsonTree.model_validate(read_json(text.removeprefix("\ufeff"))).tree.node()
        written = to_text(tree)
        same = parse(written, name=place) == tree
    except json.JSONDecodeError as error:
        line, column = error.lineno, error.colno
        message = f"{name}:{line}:{column}: not JSON: {error.msg}"
        raise TreeError(message, line=line, column=column) from None
    except ValidationError as error:
        first = max(error.errors(include_url=False), key=lambda e: len(e["loc"]))
        at = ".".join(map(str, first["loc"][-8:])) or "the file"
        message = first["msg"].removeprefix("Value error, ").partition(" or instance")[0]
        raise TreeError(f"{name}: {at:.100}: {message}, found {first['input']!r:.40}") from None
    except IndexError:
        raise TreeError(f"{name}: expected a condition in each `not`, found none") from None
    except ValueError as error:
        raise TreeError(f"{name}: {error}") from None
    if not same:
        raise TreeError(f"{name}: expected names, values and sums as `islandgp fmt` writes them")
    return parse(written, vocabulary, name=place)
