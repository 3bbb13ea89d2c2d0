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
"""Values that stand in the place of others."""


class Edit(NamedTuple):
    """One change of a text, at places that are taken modulo its length."""

    how: int  # 0: insert, 1: replace, 2: delete, 3: copy a part, 4: cut off the end
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
    words = _WORD.findall(text)
    for how, at, other, piece in changes:
        i, new = at % (len(words) + 1), pieces[piece % len(pieces)]
        if how == 0:
            words.insert(i, new)
        elif how == 1:
            words[i : i + 1] = [new]
        elif how == 2:
            del words[i : i + 1 + other % 4]
        elif how == 3:
            j = other % (len(words) + 1)
            words[i:i] = words[j : j + 1 + piece % 12]
        elif other % 4 == 0:  # what is cut off hides what comes after it
            del words[i:]
    return b"".join(words)


def texts(seeds: Sequence[bytes], pieces: Sequence[bytes]) -> st.SearchStrategy[bytes]:
    """Edited seeds, and words in no order."""
    pieces = (*pieces, *BYTES)
    changed = st.builds(edited, st.sampled_from(seeds), edits(), st.just(pieces))
    mixed = st.lists(st.sampled_from(pieces[: -len(BYTES)] or pieces), max_size=40).map(b" ".join)
    return st.one_of(changed, changed, mixed)


class Swap(NamedTuple):
    """One change of a JSON value, at a place that is taken modulo their number."""

    how: int  # 0 to 2: another value, 3: delete, 4: double or rename, 5: a value from elsewhere
    at: int
    value: int


def swaps(most: int = 3) -> st.SearchStrategy[list[Swap]]:
    """At least one change."""
    return st.lists(
        st.builds(Swap, _number(5), _number(2**16), _number(2**16)), min_size=1, max_size=most
    )


def _places(value: Any) -> list[tuple[Any, Any]]:
    """Each container in a value with each of its keys."""
    found: list[tuple[Any, Any]] = []
    waiting = [value]
    while waiting:
        here = waiting.pop()
        if isinstance(here, dict | list):
            keys = list(here) if isinstance(here, dict) else list(range(len(here)))
            found += [(here, key) for key in keys]
            waiting += [here[key] for key in keys]
    return found


def swapped(value: Any, changes: Sequence[Swap]) -> Any:
    """A JSON value with parts changed."""
    box = [copy.deepcopy(value)]
    for how, at, other in changes:
        places = _places(box)
        if not places:
            break
        here, key = places[at % len(places)]
        if how <= 2:
            here[key] = copy.deepcopy(VALUES[other % len(VALUES)])
        elif how == 3:
            del here[key]
        elif how == 4 and isinstance(here, list):
            here.insert(key, copy.deepcopy(here[key]))
        elif how == 4:
            here[f"{key}_"] = here.pop(key)
        else:
            there, name = places[other % len(places)]
            here[key] = copy.deepcopy(there[name])
    return box[0] if box else None


def as_json(value: Any) -> bytes:
    """JSON as hostile as the value: with NaN, lone surrogates, numbers of any length."""
    return json.dumps(value).encode()


def values(seeds: Sequence[Any]) -> st.SearchStrategy[Any]:
    """Changed JSON values."""
    return st.builds(swapped, st.sampled_from(seeds), swaps())
