"""Eq. (3) and (4) by hand."""

from __future__ import annotations

import pytest

from islandgp.domain import Outcome
from islandgp.gp.state import generation_stats
from islandgp.scoring.generation_stats import diversity
from tests.samples import CLASSES, evaluated, outcome, paper_plan

PATROL, PICKUP, HUMANOID, BALANCED = CLASSES.specialist_names


@pytest.mark.parametrize(
    ("classes", "expected"),
    [
        ([PICKUP], 0.0),
        ([PICKUP] * 30, 0.0),
        ([PICKUP] * 29 + [PATROL], 1 / 30),
        ([PICKUP, PATROL], 0.5),
        ([PICKUP] * 15 + [HUMANOID] * 10 + [BALANCED] * 5, 0.5),
        ([PATROL, PICKUP, HUMANOID, BALANCED], 0.75),  # the most that four classes can give
        ([PATROL] * 8 + [PICKUP] * 8 + [HUMANOID] * 7 + [BALANCED] * 7, 22 / 30),
    ],
)
def test_diversity(classes: list[str], expected: float) -> None:
    """Eq. (3): one minus the share of the largest class."""
    assert diversity(classes) == pytest.approx(expected)


def working_ratio(outcomes: list[Outcome]) -> float:
    """Eq. (4) of a population."""
    population = [evaluated(f"0.{slot}", o) for slot, o in enumerate(outcomes)]
    return generation_stats(paper_plan(), 0, 0.4, population).working


def test_working_ratio() -> None:
    """Eq. (4): who picked up or served a humanoid works; who only delivers or charges does not."""
    outcomes = [
        outcome(),
        outcome(pickups=1),
        outcome(interactions=2),
        outcome(pickups=3, interactions=1),
        outcome(deliveries=5, charges=5, distance=900),
    ]
    assert working_ratio(outcomes) == 3 / 5
    assert working_ratio(outcomes[:1]) == 0
    assert working_ratio(outcomes[1:4]) == 1
