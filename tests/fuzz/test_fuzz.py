"""Hostile input of every kind: refused in words or read right, never a traceback.

`make fuzz` searches longer. What it finds is kept in `corpus/`, and tried here again.
"""

from __future__ import annotations

from pathlib import Path

import pytest
from hypothesis import HealthCheck, given

from tests.fuzz.targets import targets
from tests.profiles import examples, sweep

CORPUS = Path(__file__).parent / "corpus"
EXAMPLES = {"records": 15, "overrides": 10}  # they take longest
TARGETS = targets()
FINDS = sorted(CORPUS.glob("*/*"))


@sweep("file", FINDS, ids=[f"{f.parent.name}-{f.name}" for f in FINDS], quick=15)
def test_what_was_once_found(file: Path) -> None:
    """Each input that has ever broken a promise keeps it."""
    TARGETS[file.parent.name].check(file.read_bytes())


@pytest.mark.parametrize("name", TARGETS)
def test_hostile_input(name: str) -> None:
    """Eighty inputs in all; `check` raises where a promise is broken."""
    target = TARGETS[name]

    @examples(max_examples=EXAMPLES.get(name, 100), suppress_health_check=list(HealthCheck))
    @given(target.inputs)
    def search(data: bytes) -> None:
        target.check(data)

    search()


@pytest.mark.parametrize("name", TARGETS)
def test_the_seeds_are_sound(name: str) -> None:
    """What the inputs are made from is taken as it is, or the search would be blind."""
    assert all(map(TARGETS[name].check, TARGETS[name].seeds()))
