"""Table 5: what one generation measures, and what a supervisor sees of the history."""

from __future__ import annotations

import pytest

from islandgp.gp.state import generation_stats
from islandgp.scoring.state import stagnant, trend
from tests.samples import CLASSES, evaluated, outcome, paper_plan, snapshot, state


@pytest.mark.parametrize(
    ("values", "slope"),
    [
        ([], 0),
        ([7], 0),
        ([1, 3], 2),
        ([5, 5, 5], 0),
        ([0, 1, 2, 3, 4], 1),
        ([4, 3, 2, 1, 0], -1),
        ([0, 0, 0, 10], 3),  # sum (i - 1.5) v / sum (i - 1.5)^2 = 15 / 5
        ([1, 0, 2], 0.5),
    ],
)
def test_trend(values: list[float], slope: float) -> None:
    """The slope of the least-squares line, a step apart."""
    assert trend(values) == pytest.approx(slope)


@pytest.mark.parametrize(
    ("bests", "expected"),
    [
        ([100], 0),
        ([100, 100], 1),
        ([100, 101], 1),  # 1 % is not more than 1 %
        ([100, 101.5], 0),
        ([100, 200, 150, 150], 2),  # counted from the best ever
        ([100, 50, 60, 70], 3),  # rising again is not yet better
        ([100, 100.9, 101.8], 0),  # small rises add up
        ([-100, -99.5], 1),  # of a negative best, too, 1 % of its size
        ([-100, -98], 0),
        ([0, 0, 1], 0),
        ([0, 0, 0], 2),
    ],
)
def test_stagnant(bests: list[float], expected: int) -> None:
    """Generations since the best ever rose by more than one percent."""
    history = [snapshot(g, fitness_max=float(b)) for g, b in enumerate(bests)]
    assert stagnant(history, 0.01) == expected


def test_a_new_stage_counts_afresh() -> None:
    """Other multipliers are another scale: a stage's first generation is never stagnant."""
    bests = [(0, 900.0), (0, 900.0), (1, 500.0), (1, 500.0), (1, 500.0), (1, 600.0), (2, 600.0)]
    history = [snapshot(g, stage=stage, fitness_max=best) for g, (stage, best) in enumerate(bests)]
    stagnation = [stagnant(history[: n + 1], 0.01) for n in range(len(history))]
    assert stagnation == [0, 1, 0, 1, 2, 0, 0]


def test_measure() -> None:
    """A population of four in numbers, worked by hand."""
    outcomes = [
        outcome(fitness=-100, distance=100, inactive=10),
        outcome(fitness=300, pickups=3, charges=1, distance=200, inactive=20),
        outcome(fitness=500, interactions=1, deliveries=2, distance=300, inactive=30),
        outcome(fitness=20000, pickups=2, interactions=1, deliveries=1, charges=1, gathered=9,
                distance=400, inactive=40),
    ]  # fmt: skip
    trees = ["sequence { " + "PatrolWaypoint " * n + "}" for n in (2, 4, 6, 8)]
    population = [evaluated(f"0.{k}", o, tree=trees[k]) for k, o in enumerate(outcomes)]
    stats = generation_stats(paper_plan(), 12, 0.3, population)
    assert (stats.generation, stats.epoch, stats.stage, stats.rate) == (12, 3, 1, 0.3)
    assert (stats.fitness_max, stats.fitness_mean) == (20000, 5175)
    # deviations -5275, -4875, -4675, 14825: sum of squares 293,227,500, a quarter is 73,306,875
    assert stats.fitness_sd == pytest.approx(73_306_875**0.5)
    assert stats.diversity == 0.75
    assert stats.working == 0.75
    assert stats.specialists == {"patrol_only": 1, "pickup": 1, "humanoid": 1, "balanced": 1}
    assert stats.behaviour_counts == {"pickup": 2, "humanoid": 2, "clearing": 2, "charging": 2}
    assert stats.tiers == {"excellent": 0, "complete": 1, "full_service": 1, "balanced_elite": 1}
    means = stats.counters
    assert (means["distance"], means["inactive"], means["pickups"], stats.size) == (
        250,
        25,
        1.25,
        6,
    )
    assert list(means) == list(outcomes[0].counters)


def test_state_of_the_first_generation() -> None:
    """Without a past nothing has changed, and nothing is stagnant."""
    population_state = state([snapshot(0)])
    assert (
        population_state.best_change,
        population_state.mean_change,
        population_state.best_trend,
    ) == (0, 0, 0)
    assert (
        population_state.diversity_change,
        population_state.stagnant_generations,
        population_state.stagnant_epochs,
    ) == (0, 0, 0)
    assert population_state.history == (population_state.now,)


def test_state_after_seven_generations() -> None:
    """Changes look back one generation, trends over the window, plateaus over the whole run."""
    history = [
        snapshot(0, fitness_max=9000.0, complete=1, excellent=1),
        *(
            snapshot(g, fitness_max=1000.0 * g, fitness_mean=100.0 * g, diversity=0.75 - 0.0625 * g)
            for g in range(1, 7)
        ),
    ]
    population_state = state(history)
    assert [s.generation for s in population_state.history] == [2, 3, 4, 5, 6]
    assert (population_state.best_change, population_state.best_trend) == (
        1000,
        pytest.approx(1000),
    )
    assert (population_state.mean_change, population_state.mean_trend) == (100, pytest.approx(100))
    assert population_state.diversity_change == pytest.approx(-0.0625)
    assert population_state.diversity_trend == pytest.approx(-0.0625)
    assert (population_state.stagnant_generations, population_state.stagnant_epochs) == (6, 1.2)
    assert population_state.milestones_reached == {"complete": True, "excellent": True}
    assert (population_state.quality_count, population_state.ever_quality) == (0, True)
    assert (population_state.dominant, population_state.mutation_rate) == ("patrol_only", 0.4)


def test_milestones() -> None:
    """Milestones are of the whole history, `quality` of the first one and the present."""
    population_state = state([snapshot(0, complete=1), snapshot(1, complete=3)])
    assert population_state.milestones_reached == {"complete": True, "excellent": False}
    assert (population_state.quality_count, population_state.ever_quality) == (3, True)
    assert (state([snapshot(0)]).quality_count, state([snapshot(0)]).ever_quality) == (0, False)
    assert population_state.targets == CLASSES.targets


def test_rarest_behaviours_are_sorted() -> None:
    """Behaviours are sorted by rising count, equals in the order of configuration."""
    counts = {"pickup": 9, "humanoid": 2, "clearing": 0, "charging": 2}
    population_state = state([snapshot(0, behaviour_counts=counts, diversity=0.29)])
    assert population_state.rarest_behaviours == ("clearing", "humanoid", "charging", "pickup")
    assert population_state.diversity_warning is True


@pytest.mark.parametrize(("diversity", "warning"), [(0.31, False), (0.3, False), (0.29, True)])
def test_diversity_warning(diversity: float, warning: bool) -> None:
    """Below 0.3 diversity is low; at 0.3 it is not yet."""
    assert state([snapshot(0, diversity=diversity)]).diversity_warning is warning
