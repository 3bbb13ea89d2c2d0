"""What a run is measured by."""

from __future__ import annotations

import pytest

from islandgp.study.measures import SPANS, TABLE_9, TABLE_10, main_family
from tests.study.fake_runs import fake_run


def test_table_9_by_hand() -> None:
    """Highest ever, highest of the last generation, mean of the highest, last mean."""
    run = fake_run(best=[1.0, 5.0, 3.0])
    assert [m.of(run) for m in TABLE_9] == [5.0, 3.0, 3.0, 100.0]


def test_table_10_by_hand() -> None:
    """A stage's value is the mean of its generations' highest fitness."""
    run = fake_run(best=[float(g) for g in range(41)])
    assert [m.of(run) for m in TABLE_10] == [5.0, 18.0, 33.0]


@pytest.mark.parametrize("n", [4, 5, 6, 16, 41, 100])
def test_stages_cover_a_run_of_any_length(n: int) -> None:
    """Each generation belongs to one stage, in order, and no stage is empty."""
    assert [g for span in SPANS for g in span.generations(n)] == list(range(n))
    assert all(span.generations(n) for span in SPANS)


def test_the_family_is_the_paper_s_nine() -> None:
    """Four of Table 9, three of Table 10, two emergences."""
    family = main_family(["complete", "excellent"])
    assert len({m.key for m in family}) == len(family) == 9
