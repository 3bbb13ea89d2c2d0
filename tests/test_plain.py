"""Plain values that a file holds, and the types that they must fit."""

from __future__ import annotations

import json
from dataclasses import dataclass
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from islandgp.gate import cleaned_values
from islandgp.plain import from_json, validate_json

TEXTS = st.lists(
    st.sampled_from(["\\", "u", "d8", '"', "\udcff", "\ud800", "\U0001f600", "é", "00"]), max_size=8
).map("".join)
"""Texts with halves of surrogate pairs, as paths have them, and with what looks like them."""


@dataclass(frozen=True)
class Named:
    """What may be read from a file."""

    name: str
    n: int


@given(TEXTS, st.booleans())
def test_any_text_that_json_writes_fits(text: str, as_bytes: bool) -> None:
    """Also the path of a folder whose name is no text, cleaned. Further fields are kept."""
    values = {"name": text, "n": 1, "more": text}
    document = json.dumps(values)
    # JSON joins a first half and a second half that meet; the gate replaces the others.
    expected = cleaned_values(json.loads(document))
    assert validate_json(Named, document.encode() if as_bytes else document) == expected


@given(TEXTS, st.sampled_from([None, 1.5, "1", [], True]))
def test_another_type_does_not_fit(text: str, n: Any) -> None:
    """And the message names the field."""
    with pytest.raises(ValueError, match=r"^n: "):
        validate_json(Named, json.dumps({"name": text, "n": n}))


@dataclass(frozen=True)
class Pair:
    """One dataclass inside another."""

    both: tuple[Named, ...]


def test_dataclasses_are_made_whole() -> None:
    """Those inside as well; what is too much is left out, and nothing becomes another type."""
    plain = {"both": [{"name": "a", "n": 1, "more": 2}]}
    assert from_json(Pair, plain) == Pair((Named("a", 1),))
    with pytest.raises(ValueError, match=r"^both\.0\.n: "):
        from_json(Pair, {"both": [{"name": "a", "n": "1"}]})
