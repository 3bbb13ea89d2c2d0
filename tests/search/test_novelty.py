"""Novelty search: distances by hand, who becomes a parent, and what is remembered."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from islandgp.search.novelty import novelty
from islandgp.seeding import Streams
from tests.search.searches import NO_ADVICE, evaluated, generations, search_and_plan

PLACES = st.lists(
    st.tuples(st.integers(-5, 5).map(float), st.integers(-5, 5).map(float)), max_size=8
)


def test_by_hand() -> None:
    """The mean distance to the two nearest, in the generation or in the archive."""
    places = ((0.0, 0.0), (3.0, 4.0), (0.0, 1.0))
    assert novelty(places, (), 2) == pytest.approx([3.0, (5 + 18**0.5) / 2, (1 + 18**0.5) / 2])
    assert novelty(places, ((3.0, 4.0), (3.0, 4.0)), 2) == pytest.approx(
        [3.0, 0.0, (1 + 18**0.5) / 2]
    )
    assert novelty(((1.0, 1.0),), (), 3) == [0.0]


@given(places=PLACES.filter(len), archive=PLACES, k=st.integers(1, 12))
def test_as_defined(
    places: list[tuple[float, float]], archive: list[tuple[float, float]], k: int
) -> None:
    """The definition, without arrays."""
    expected = []
    for i, place in enumerate(places):
        others = [*places[:i], *places[i + 1 :], *archive]
        near = sorted(((place[0] - o[0]) ** 2 + (place[1] - o[1]) ** 2) ** 0.5 for o in others)[:k]
        expected.append(sum(near) / len(near) if near else 0.0)
    assert novelty(tuple(places), tuple(archive), k) == pytest.approx(expected)


def test_the_novel_are_parents_and_the_fittest_stay() -> None:
    """Nine that do nothing for much, and one that does something for nothing."""
    search, _ = search_and_plan(
        "novelty", "allocation.reevaluated=0.1", "search.policy.tournament=8"
    )
    population = [
        *(evaluated(f"0.{k}", float(k)) for k in range(9)),
        evaluated("0.9", -500.0, tree="SeekCharger", charges=1),
    ]
    state = search.tell(search.start(), population, NO_ADVICE)
    assert state.memory.parents[0].id == "0.9"
    assert [parent.id for parent in state.memory.fittest] == ["0.8"]
    new = tuple(search.ask(state, Streams(1)))
    assert (new[0].origin, new[0].parents) == ("elite", ("0.8",))
    mothers = [i.parents[0] for i in new[1:]]
    assert mothers.count("0.9") > len(mothers) / 2


def test_known_behaviour_is_not_novel() -> None:
    """The archive remembers places of individuals that are gone."""
    search, _ = search_and_plan("novelty", "search.policy.neighbours=1")
    first = [evaluated("0.0", charges=1), evaluated("0.1"), evaluated("0.2")]
    state = search.tell(search.start(), first, NO_ADVICE)
    second = [evaluated("1.0", charges=1), evaluated("1.1"), evaluated("1.2", pickups=1)]
    state = search.tell(state, second, NO_ADVICE)
    assert state.memory.parents[0].id == "1.2"


@pytest.mark.parametrize(("most", "added"), [(0, 3), (5, 3), (4, 0), (100, 2)])
def test_the_archive_is_bounded(most: int, added: int) -> None:
    """The oldest places are forgotten."""
    overrides = (f"search.policy.archive={most}", f"search.policy.added={added}")
    search, plan = search_and_plan("novelty", *overrides)
    populations, state = generations(search, plan, 5)
    assert len(state.memory.archive) == min(most, 5 * added)
    if most and added:
        from islandgp.search.descriptor import point

        last = {point(search.counters, e.outcome) for e in populations[-1]}
        assert set(state.memory.archive[-added:]) <= last


def test_scales() -> None:
    """A descriptor may name other counters; each doubling is worth as much."""
    search, _ = search_and_plan("novelty", "search.policy.descriptor=[distance,pickups]")
    state = search.tell(search.start(), [evaluated("0.0", distance=255, pickups=7)], NO_ADVICE)
    assert np.allclose(state.memory.archive, [(8.0, 3.0)])
