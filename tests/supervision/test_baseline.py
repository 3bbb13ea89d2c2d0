"""The paper's baseline, by hand: up on stagnation, down on improvement, within its limits."""

from __future__ import annotations

import numpy as np
import pytest

from islandgp.supervision.base import Guidance
from islandgp.supervision.baseline import Baseline, BaselineSettings
from tests.samples import snapshot, state

SETTINGS = BaselineSettings(patience=2, up=1.15, down=0.9, rates=(0.1, 0.5))


def advice(bests: list[float], rate: float) -> Guidance:
    """The baseline's guidance after these generations, at this rate."""
    history = [snapshot(g, fitness_max=best, rate=rate) for g, best in enumerate(bests)]
    return Baseline(SETTINGS).advise(state(history), np.random.default_rng(0))


@pytest.mark.parametrize(
    ("bests", "rate", "expected"),
    [
        ([100], 0.4, 0.4),  # nothing to compare with yet
        ([100, 200], 0.4, 0.36),  # better: 0.4 * 0.9
        ([100, 100], 0.4, 0.4),  # one generation of patience
        ([100, 100, 100], 0.4, 0.46),  # two: 0.4 * 1.15
        ([100, 100, 100, 100], 0.4, 0.46),
        ([100, 100, 100, 200], 0.4, 0.36),
        ([100, 100, 100], 0.45, 0.5),  # at most 0.5
        ([100, 100, 100], 0.5, 0.5),
        ([100, 200], 0.105, 0.1),  # at least 0.1
        ([100, 200], 0.1, 0.1),
        ([100], 0.9, 0.5),  # from outside it comes back in
        ([100], 0.0, 0.1),
    ],
)
def test_rate(bests: list[float], rate: float, expected: float) -> None:
    """The rate moves by its factor, and never leaves its range."""
    assert advice(bests, rate).mutation_rate == pytest.approx(expected)


def test_a_new_stage_is_neither_better_nor_worse() -> None:
    """Other multipliers, another scale: where a stage begins the rate stays."""
    for best in (10.0, 100.0, 1000.0):
        history = [snapshot(9, fitness_max=100.0), snapshot(10, stage=1, fitness_max=best)]
        guidance = Baseline(SETTINGS).advise(state(history), np.random.default_rng(0))
        assert (guidance.mutation_rate, guidance.reasoning) == (0.4, "waiting")
    longer = [*history, snapshot(11, stage=1, fitness_max=2000.0)]
    guidance = Baseline(SETTINGS).advise(state(longer), np.random.default_rng(0))
    assert guidance.mutation_rate == pytest.approx(0.36)
