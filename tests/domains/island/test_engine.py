"""The compiled functions of the island, and where numba keeps them."""

from __future__ import annotations

from math import hypot, inf
from pathlib import Path

import numba
import pytest
from hypothesis import given
from hypothesis import strategies as st

from islandgp.domains.island import engine
from islandgp.domains.island.memory import norm
from islandgp.domains.island.state import State
from tests.domains.island.days import points, world

numbers = st.floats(-1e9, 1e9).map(lambda x: x if abs(x) > 1e-200 else 0.0)


@given(numbers, numbers)
def test_lengths_are_those_of_python(x: float, y: float) -> None:
    """To the last bit, while those of C libraries differ from machine to machine."""
    assert norm(x, y) == hypot(x, y)


def test_other_sources_are_compiled_again(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """The same sources are compiled once, also if it is another file that has changed."""
    monkeypatch.setattr(numba.config, "CACHE_DIR", str(tmp_path))

    def loaded(version: int) -> bool:
        straight = engine._entries(version)[-1]
        assert straight(0.0, 1.0, 1.0, -1.0, 0.5, 2) == (1.0, 0.0)
        return bool(straight.stats.cache_hits)

    assert [loaded(version) for version in (1, 1, 2, 2, 1)] == [False, True, False, True, True]


def test_it_runs_where_nothing_can_be_written(monkeypatch: pytest.MonkeyPatch) -> None:
    """In a read-only package, for a user without a home: compiled in each process."""
    monkeypatch.setattr("numba.core.caching.CacheImpl._locator_classes", [])
    assert engine._cached(lambda x: x + 1)(2) == 3


def test_coasting_needs_the_sums_of_chipmunk(monkeypatch: pytest.MonkeyPatch) -> None:
    """Where sums are rounded in another way, Chipmunk makes every step."""
    assert engine.ADDS_AS_CHIPMUNK
    monkeypatch.setattr(engine, "straight", lambda x, y, *_: (x, y))
    assert not engine._adds_as_chipmunk()


def test_a_state_has_the_fields_of_the_record() -> None:
    """Another name is an error."""
    island = State(world(), 0, points())
    island.record["load"] = 3
    assert (island.load, island.x, island.lead) == (3, 150.0, inf)
    with pytest.raises(AttributeError, match="no attribute 'loads'"):
        _ = island.loads
