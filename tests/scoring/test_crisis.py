"""Eq. (7) and (8) at their thresholds."""

from __future__ import annotations

import pytest

from islandgp.scoring.state import Crisis

CRISIS = Crisis(diversity_below=0.15, stagnant_epochs_above=3, emergency_rate=0.5)


@pytest.mark.parametrize(
    ("diversity", "plateau", "reason"),
    [
        (0.6, 0, ""),
        (0.15, 0, ""),  # not below
        (0.149, 0, "diversity"),
        (0.0, 0, "diversity"),
        (0.6, 15, ""),  # 3 epochs of 5 generations are not more than 3
        (0.6, 16, "stagnation"),
        (0.1, 16, "diversity"),  # both: diversity is named
    ],
)
def test_crisis_reason(diversity: float, plateau: int, reason: str) -> None:
    """Eq. (7): diversity below its threshold, or stagnation for more than so many epochs."""
    assert CRISIS.reason(diversity, plateau / 5) == reason


def test_applied_rate() -> None:
    """Eq. (8): the emergency rate in a crisis, else the wanted one."""
    assert CRISIS.rate(0.12, "") == 0.12
    assert CRISIS.rate(0.12, "diversity") == 0.5
    assert CRISIS.rate(0.9, "stagnation") == 0.5
