"""Streams by purpose: distinct, stateless, and the same for ever; and sums that are so."""

from __future__ import annotations

import json
from itertools import product

from islandgp.domain import total
from islandgp.seeding import Stream, seed_of, stream


def first(seed: int, purpose: Stream, generation: int, slot: int) -> int:
    """The first draw of a stream."""
    return int(stream(seed, purpose, generation=generation, slot=slot).integers(2**62))


def test_streams_are_distinct() -> None:
    """Another seed, purpose, generation or slot is another stream."""
    places = list(product((0, 1, 2**40), Stream, (0, 1, 2, 40), (0, 1, 29)))
    assert len({first(*place) for place in places}) == len(places)


def test_streams_keep_no_state() -> None:
    """Two requests give the same draws, for any draws in between."""
    one = stream(5, Stream.MUTATION, generation=3, slot=7)
    draws = one.random(10).tolist()
    stream(5, Stream.MUTATION, generation=3, slot=8).random(1000)
    assert stream(5, Stream.MUTATION, generation=3, slot=7).random(10).tolist() == draws


def test_sums_do_not_depend_on_the_version_of_python() -> None:
    """Python 3.12 and later compensate in `sum` for what rounding loses."""
    assert total([0.1] * 10) == 0.9999999999999999
    assert total(iter([1e16, 1.0, -1e16])) == 0.0
    assert json.dumps([total([]), total([1, 2])]) == "[0, 3]"


def test_numbers_of_purposes() -> None:
    """The numbers are part of every run's identity."""
    assert {purpose.name: int(purpose) for purpose in Stream} == {
        "INITIAL": 1,
        "WORLD": 2,
        "SELECTION": 3,
        "CROSSOVER": 4,
        "DIVERSITY": 5,
        "MUTATION": 6,
        "SUPERVISION": 7,
        "NETWORK": 8,
        "UNSEEN": 9,
        "LIBRARY": 10,
        "VALIDATION": 11,
        "TEST": 13,
        "TUNING": 14,
        "SEARCH": 15,
        "ARCHIVE": 16,
        "PERTURBATION": 18,
        "PRUNING": 19,
        "JUDGING": 20,
        "ORDER": 21,
        "RESAMPLING": 100,
    }


def test_the_same_for_ever() -> None:
    """First draws as they were when the project began: a change here changes every run."""
    assert [first(0, purpose, 1, 2) for purpose in (Stream.INITIAL, Stream.NETWORK)] == [
        1418395269214005295,
        1994482718393982649,
    ]
    assert [
        seed_of(0, Stream.WORLD, generation=g, slot=e) for g, e in ((0, 0), (40, 0), (40, 1))
    ] == [
        1243955231,
        531944655,
        2430504513,
    ]


def test_world_seeds() -> None:
    """World seeds fit into 32 bits, and differ by generation and episode."""
    seeds = [seed_of(9, Stream.WORLD, generation=g, slot=e) for g in range(41) for e in range(5)]
    assert len(set(seeds)) == len(seeds)
    assert all(0 <= seed < 2**32 for seed in seeds)


def test_no_two_purposes_share_a_stream() -> None:
    """An equal number would make two names of one stream, without an error."""
    assert len(Stream.__members__) == len(list(Stream))
