"""What a number of seeds can show."""

from __future__ import annotations

import pytest

from islandgp.statistics import smallest_difference


def test_too_few_runs_can_show_nothing() -> None:
    """Three runs an arm give p = 0.1 at best, so no difference is enough."""
    power = smallest_difference(3, 3)
    assert power.least_p == pytest.approx(0.1)
    assert power.shift is None


def test_thirty_runs_show_three_quarters_of_a_standard_deviation() -> None:
    """The t test needs 0.74 SD at n = 30 and 80 %; the rank test needs a little more."""
    power = smallest_difference(30, 30)
    assert power.shift == pytest.approx(0.755, abs=0.03)
    assert power.superiority == pytest.approx(0.70, abs=0.02)


def test_a_stricter_level_needs_a_larger_difference() -> None:
    """The first of nine adjusted comparisons asks for more."""
    loose, strict = smallest_difference(10, 10), smallest_difference(10, 10, 0.05 / 9)
    assert loose.shift is not None
    assert strict.shift is not None
    assert strict.shift > loose.shift
