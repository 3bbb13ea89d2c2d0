"""The best robot of a run: candidates of the last stage compete in held-out worlds."""

from __future__ import annotations

from collections.abc import Sequence
from math import isclose, isnan
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from islandgp.domain import Outcome
from islandgp.evaluation.base import Job
from islandgp.evolution.candidates import MAX_CANDIDATES, PART, Candidate, by_evidence, by_fitness
from islandgp.evolution.validation import FINALISTS, entrants, rounds, validate, validation_seeds
from islandgp.seeding import Stream, seed_of
from islandgp.statistics import mean_interval
from tests.composed import composed
from tests.samples import outcome

CLASSES = composed().classes


@pytest.mark.parametrize(("episodes", "n"), [(1, 1), (9, 1), (10, 2), (23, 4), (24, 4), (80, 24)])
def test_a_run_of_any_size_validates(episodes: int, n: int) -> None:
    """With fewer episodes than candidates the best in training take part, one at least."""
    pool = [Candidate(0, f"0.{i}", f"tree {i}\n", trained=i) for i in range(24)]
    selected = entrants(pool, episodes)
    assert {c.trained for c in selected} == set(range(24 - n, 24))
    assert 0 < sum(size * new for size, new in rounds(len(selected), episodes)) <= episodes


def record(generation: int, stage: int, *fitness: float) -> dict[str, Any]:
    """A generation whose individuals have these fitnesses, and different trees."""
    return {
        "snapshot": {"generation": generation, "stage": stage},
        "individuals": [
            {
                "id": f"{generation}.{slot}",
                "tree": f"tree {generation}.{slot}\n",
                "fitness": points,
                "tiers": ["complete"] if points == 7 else [],
                "specialist": "patrol_only",
                "counters": {
                    "pickups": 0,
                    "interactions": 0,
                    "charges": points == 3,
                    "deliveries": 0,
                },
            }
            for slot, points in enumerate(fitness)
        ],
    }


class Worlds:
    """An evaluator in which a tree's worth is known, and each world adds some luck."""

    def __init__(self, points: dict[str, float]) -> None:
        self.worth = points
        self.jobs: list[Job] = []

    def evaluate(self, jobs: Sequence[Job]) -> list[Outcome]:
        self.jobs += jobs
        return [
            outcome(components={"garbage": self.worth[job.tree] + job.seed % 7}) for job in jobs
        ]

    def close(self) -> None:
        """Nothing is held."""


def test_candidates_are_of_the_last_stage() -> None:
    """A high fitness under other multipliers does not count; the best of a tier does."""
    records = [record(0, 0, 99, 98), record(1, 1, 5, 4, 3, 7), record(2, 1, 6, 2)]
    pool = by_fitness(records, CLASSES)
    assert {c.generation for c in pool} == {1, 2}
    assert {"tree 1.3\n", "tree 1.2\n"} <= {c.tree for c in pool}, "of a tier, of a behaviour"
    assert len({c.tree for c in pool}) == len(pool)


def test_candidates_are_few() -> None:
    """However long the stage is."""
    pool = by_fitness((record(g, 0, 1, 2, 3) for g in range(100)), CLASSES)
    assert len(pool) == MAX_CANDIDATES


@given(n=st.integers(1, MAX_CANDIDATES), episodes=st.integers(MAX_CANDIDATES, 2000))
def test_rounds_keep_the_budget(n: int, episodes: int) -> None:
    """Half of the candidates go in each round, and the episodes are about as many as allowed."""
    schedule = rounds(n, episodes)
    assert schedule[0][0] == n
    assert schedule[-1][0] <= max(FINALISTS, n if n <= FINALISTS else FINALISTS)
    sizes = [size for size, _ in schedule]
    assert sizes == sorted(sizes, reverse=True)
    assert sum(size * new for size, new in schedule) <= episodes + sum(sizes)


def test_the_best_wins_and_luck_in_training_does_not() -> None:
    """The winner is the tree that is worth most in unseen worlds, with its interval and shares."""
    pool = [Candidate(0, f"0.{i}", f"tree {i}\n", trained=100.0 - i) for i in range(10)]
    worlds = validation_seeds(0, frozenset(), 200)
    evaluator = Worlds({f"tree {i}\n": 10.0 * i for i in range(10)})
    (winner, verdict), *_ = validate(pool, worlds, evaluator, 0, CLASSES, episodes=200)
    assert winner.id == "0.9"
    assert verdict.low <= verdict.mean <= verdict.high
    assert set(verdict.reached) == set(CLASSES.tiers)
    raced = evaluator.jobs
    assert len(raced) <= 200
    met = {c.tree: [job.seed for job in raced if job.tree == c.tree] for c in pool}
    longest = max(met.values(), key=len)
    assert all(worlds == longest[: len(worlds)] for worlds in met.values())


def test_a_single_candidate_is_measured() -> None:
    """With nobody to race against it meets as many worlds as there may be episodes."""
    pool = [Candidate(0, "0.0", "tree\n", trained=1.0)]
    worlds = validation_seeds(0, frozenset(), 30)
    ((_, verdict),) = validate(pool, worlds, Worlds({"tree\n": 1.0}), 0, CLASSES, episodes=30)
    assert len(verdict.worlds) == 30


@given(seed=st.integers(0, 1000))
def test_validation_worlds_are_not_those_of_training(seed: int) -> None:
    """They come from a separate stream, and worlds that a run used are left out."""
    training = frozenset(seed_of(seed, Stream.WORLD, generation=g) for g in range(41))
    worlds = validation_seeds(seed, training, 50)
    assert len(set(worlds)) == 50
    assert not training & set(worlds)
    assert validation_seeds(seed, training | {worlds[0]}, 49) == worlds[1:]


@pytest.mark.parametrize(
    ("values", "low", "high"),
    [((1.0, 3.0), 2 - 12.706, 2 + 12.706), ((2.0,) * 9, 2.0, 2.0)],
)
def test_interval(values: tuple[float, ...], low: float, high: float) -> None:
    """Student's t: for two values 1 apart from their mean the half width is 12.706."""
    _, low_end, high_end = mean_interval(values)
    assert isclose(low_end, low, abs_tol=1e-3)
    assert isclose(high_end, high, abs_tol=1e-3)


def test_a_single_value_has_no_interval() -> None:
    """It has a mean; the ends are nan, not a point."""
    mean, low, high = mean_interval([5.0])
    assert mean == 5.0
    assert isnan(low)
    assert isnan(high)


def test_each_part_of_a_long_run_has_candidates() -> None:
    """Levels of distant generations cannot be compared, so no part takes the places of another."""

    def record(generation: int) -> dict[str, Any]:
        inflated = 50.0 * (generation >= PART)
        points = (("a", 9.0 + inflated), ("b", 3.0 + inflated))
        trees = ((f"{name}{generation // PART}", fitness) for name, fitness in points)
        return {
            "snapshot": {"stage": 0, "generation": generation},
            "individuals": [
                {
                    "id": f"{generation}.{k}",
                    "tree": tree,
                    "fitness": fitness,
                    "counters": {},
                }
                for k, (tree, fitness) in enumerate(trees)
            ],
        }

    long = [record(generation) for generation in range(2 * PART)]
    assert [c.tree for c in by_evidence(long, most=2)] == ["a1", "a0"]
    short = long[1:]
    assert [c.tree for c in by_evidence(short, most=2)] == ["a1", "b1"]
