"""Hostile inputs: sound texts and JSON values, edited."""

from __future__ import annotations

import copy
import json
import re
from collections.abc import Sequence
from typing import Any, Final, NamedTuple

from hypothesis import strategies as st

_WORD: Final = re.compile(rb"\w+|\s+|.", re.DOTALL)

DEEP: Final = b"[" * 20_000
DIGITS: Final = b"9" * 5_000

BYTES: Final[tuple[bytes, ...]] = (
    *(b"\x00", b"\xff", b"\xed\xa0\x80", "\ufeff".encode(), "\u2028".encode(), b"\r", b"\x1b[2J"),
    *("\u202e".encode(), "é".encode(), b"\\", b'"', b"'", b"</script>", b"-", b"0", b"1e400"),
    *(b"-1", b"nan", b"null", b"true", b"{}", b"[]", b"{", b"}", b"(", b")", DEEP, DIGITS),
)
"""Pieces that trouble readers of any format."""

_NESTED: list[Any] = []
for _ in range(200):
    _NESTED = [_NESTED]

VALUES: Final[tuple[Any, ...]] = (
    *(None, True, False, 0, -1, 1, 2, 10**9, 10**400, -(10**30), 0.5, -0.0, 1e308),
    *(
        float("nan"),
        float("inf"),
        "",
        "a",
        "\x00",
        "\ud800",
        "\u202e",
        "é",
        "9" * 5_000,
        "x" * 9_000,
    ),
    *("</script><script>alert(1)</script>", "../../../etc/passwd", "selector { A }", "os:system"),
    *([], {}, [None], [[]], {"": None}, {"a": {"b": []}}, _NESTED, "NaN", "null", "-1", "1e999"),
)
"""Values that replace others."""


class Edit(NamedTuple):
    """One change of a text, at places that are taken modulo its length."""

    kind: int  # 0: insert, 1: replace, 2: delete, 3: copy a part, 4: cut off the end
    at: int
    other: int
    piece: int


def _number(most: int) -> st.SearchStrategy[int]:
    return st.integers(0, most)


def edits(most: int = 6) -> st.SearchStrategy[list[Edit]]:
    """A few changes."""
    one = st.builds(Edit, _number(4), _number(2**16), _number(2**16), _number(2**10))
    return st.lists(one, max_size=most)


def edited(text: bytes, changes: Sequence[Edit], pieces: Sequence[bytes]) -> bytes:
    """A text whose words were changed; `pieces` are inserted."""
    tokens = _WORD.findall(text)
    for kind, at, other, piece in changes:
        i, new = at % (len(tokens) + 1), pieces[piece % len(pieces)]
        if kind == 0:
            tokens.insert(i, new)
        elif kind == 1:
            tokens[i : i + 1] = [new]
        elif kind == 2:
            del tokens[i : i + 1 + other % 4]
        elif kind == 3:
            j = other % (len(tokens) + 1)
            tokens[i:i] = tokens[j : j + 1 + piece % 12]
        elif other % 4 == 0:  # what is cut off hides what comes after it
            del tokens[i:]
    return b"".join(tokens)


def texts(seeds: Sequence[bytes], pieces: Sequence[bytes]) -> st.SearchStrategy[bytes]:
    """Edited seeds, and words in no order."""
    pieces = (*pieces, *BYTES)
    changed = st.builds(edited, st.sampled_from(seeds), edits(), st.just(pieces))
    mixed = st.lists(st.sampled_from(pieces[: -len(BYTES)] or pieces), max_size=40).map(b" ".join)
    return st.one_of(changed, changed, mixed)


class Swap(NamedTuple):
    """One change of a JSON value, at a place that is taken modulo their number."""

    kind: int  # 0 to 2: another value, 3: delete, 4: double or rename, 5: a value from elsewhere
    at: int
    value: int


def swaps(most: int = 3) -> st.SearchStrategy[list[Swap]]:
    """At least one change."""
    return st.lists(
        st.builds(Swap, _number(5), _number(2**16), _number(2**16)), min_size=1, max_size=most
    )


def _places(value: Any) -> list[tuple[Any, Any]]:
    """Each container in a value with each of its keys."""
    places: list[tuple[Any, Any]] = []
    waiting = [value]
    while waiting:
        container = waiting.pop()
        if isinstance(container, dict | list):
            keys = list(container) if isinstance(container, dict) else list(range(len(container)))
            places += [(container, key) for key in keys]
            waiting += [container[key] for key in keys]
    return places


def swapped(value: Any, changes: Sequence[Swap]) -> Any:
    """A JSON value with parts changed."""
    box = [copy.deepcopy(value)]
    for kind, at, other in changes:
        places = _places(box)
        if not places:
            break
        container, key = places[at % len(places)]
        if kind <= 2:
            container[key] = copy.deepcopy(VALUES[other % len(VALUES)])
        elif kind == 3:
            del container[key]
        elif kind == 4 and isinstance(container, list):
            container.insert(key, copy.deepcopy(container[key]))
        elif kind == 4:
            container[f"{key}_"] = container.pop(key)
        else:
            source, name = places[other % len(places)]
            container[key] = copy.deepcopy(source[name])
    return box[0] if box else None


def as_json(value: Any) -> bytes:
    """JSON as hostile as the value: with NaN, lone surrogates, numbers of any length."""
    return json.dumps(value).encode()


def values(seeds: Sequence[Any]) -> st.SearchStrategy[Any]:
    """Changed JSON values."""
    return st.builds(swapped, st.sampled_from(seeds), swaps())
