"""Trees as JSON; reading a written file returns an equal tree.

docs/exports.md shows the format: nodes and conditions as objects with the fields of their classes.
Comments and named subtrees are left out, as they are not part of a tree.
"""

from __future__ import annotations

import json
from typing import Any, Literal, NamedTuple

from pydantic import ValidationError

from islandgp.bt.core.condition import Condition
from islandgp.bt.core.language import parse, to_text
from islandgp.bt.core.node import Node
from islandgp.bt.core.parameters import adapter, first_fault
from islandgp.bt.core.printer import Named, number_text
from islandgp.bt.core.vocabulary import Vocabulary
from islandgp.errors import TreeError
from islandgp.plain import DECODE_ERRORS, read_json


class _File(NamedTuple):
    format: Literal["islandgp-tree"]
    tree: Node


def to_json(tree: Node) -> str:
    """The text of a JSON file."""
    return json.dumps(_plain(_File("islandgp-tree", tree)), indent=2) + "\n"


def _plain(value: Any) -> Any:
    """A node, its arguments or a condition as JSON values, without what is empty."""
    if isinstance(value, Condition) and isinstance(value.number, Named):
        value = value._replace(number=0.0, other=number_text(value.number))
    if hasattr(value, "_asdict"):
        return {key: _plain(each) for key, each in value._asdict().items() if each not in ((), "")}
    return [*map(_plain, value)] if isinstance(value, tuple) else value


def from_json(text: str, vocabulary: Vocabulary | None = None, *, name: str = "<json>") -> Node:
    """The tree in a JSON text.

    Raises:
        TreeError: it is not JSON, or not such a tree; the message has the place.
    """
    place = f"{name}, as text"
    remedy = "compare it with what `islandgp export TREE --to json` prints"
    try:
        tree = adapter(_File).validate_python(read_json(text.removeprefix("\ufeff"))).tree
        written = to_text(tree)
        if _plain(parse(written, name=place)) != _plain(tree):
            raise ValueError("names, values or sums that `islandgp fmt` writes in another way")
    except ValidationError as error:
        at, expected, found = first_fault(error)
        where = f"{name}: {'.'.join(at) or 'the file':.100}"
        raise TreeError(f"{where}: {expected}, found {found!r:.40}; {remedy}") from None
    except DECODE_ERRORS as error:
        found = f"{error!s:.100}"
        raise TreeError(f"{name}: expected JSON of a tree, found: {found}; {remedy}") from None
    return parse(written, vocabulary, name=place)
