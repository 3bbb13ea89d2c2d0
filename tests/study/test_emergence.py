"""First emergence, and runs in which it never came."""

from __future__ import annotations

import pytest

from islandgp.statistics import EXACT, EXACT_TIES
from islandgp.study.emergence import (
    band,
    first,
    quantile,
    ranks,
    reduction,
    still_without,
    summary,
)
from islandgp.study.figures.emergence import box
from islandgp.study.findings import examine
from islandgp.study.measures import emergence
from islandgp.study.tables.comparisons import time_cell
from tests.study.fake_runs import fake_run


def test_first_is_a_generation_or_never() -> None:
    """The first generation with an individual of the tier; None when there is none."""
    run = fake_run(complete=7)
    assert first(run, "complete") == 7
    assert first(run, "excellent") is None
    assert first(fake_run(complete=0), "complete") == 0


def test_a_censored_arm_gets_no_mean() -> None:
    """With a run without one there is no mean; there is a median if half the runs got there."""
    censored = summary([3, None, 5], 41)
    assert (censored.mean, censored.sd) == (None, None)
    assert censored.median == 5
    assert summary([3, None, None], 41).median is None
    assert summary([3, 5, None, None], 41).median is None


def test_quantiles_are_of_all_runs() -> None:
    """Of 2 4 6 and two without one: the lower quartile is 4, the median 6, no upper quartile."""
    firsts = [6, None, 2, None, 4]
    assert [quantile(firsts, q) for q in (0, 0.25, 0.5, 0.75, 1)] == [2, 4, 6, None, None]
    assert quantile([1, 2, None, None], 0.5) is None  # between the second and a run without one
    assert quantile([1, 2, 4, None], 0.5) == 3


def test_a_box_shows_table_11_s_median() -> None:
    """What falls among the runs without one is drawn in their strip, the median included."""
    assert box([6, None, 2, None, 4], 41.7) == {
        "whislo": 2,
        "q1": 4,
        "med": 6,
        "q3": 41.7,
        "whishi": 41.7,
    }
    assert box([None, None, 5], 41.7)["med"] == 41.7
    assert summary([None, None, 5], 41).median is None


def test_a_censored_run_counts_with_the_generations_it_was_watched() -> None:
    """First in generation 3 means three generations without one; never means all of them."""
    assert summary([3, None], 41).watched == (3 + 41) / 2


def test_reduction_names_what_it_compares() -> None:
    """Means when all got there, medians when the half did, else generations without one."""
    full, half, none = summary([5, 5], 41), summary([10, 20, None], 41), summary([None] * 2, 41)
    assert reduction(full, summary([10, 10], 41)) == (0.5, "means")
    assert reduction(full, half) == (0.75, "medians")
    assert reduction(full, none) == (1 - 5 / 41, "generations without one")
    assert reduction(none, none) is None


def test_never_ranks_after_the_last_generation() -> None:
    """For the rank test a run without one is later than one in the last generation."""
    assert ranks([40, None], 41) == [40.0, 41.0]


def test_censored_runs_are_tested_and_not_dropped() -> None:
    """All runs enter the rank test, the log-rank test and the paired test."""
    f = examine(emergence("complete"), ("a", "b"), ((1, 2, 3), (4, None, None)), 41, in_pairs=True)
    assert f.censored
    assert f.rank.n == (3, 3)
    assert f.rank.u == 0
    assert f.paired is not None
    assert (f.paired.kind, f.paired.lower) == (EXACT, 3)
    assert f.log_rank is not None
    assert f.log_rank < 0.1


def test_one_censored_run_changes_no_kind_of_test() -> None:
    """The paired test is the signed-rank test of generations without one, censored or not."""
    first = tuple(range(8))
    for last in (30, None):
        second = (*(10 + 2 * g for g in range(7)), last)
        f = examine(emergence("complete"), ("a", "b"), (first, second), 41, in_pairs=True)
        assert f.paired is not None
        assert (f.paired.kind, f.paired.p) == (EXACT, 2 / 2**8)
    never = (None,) * 8
    tied = examine(emergence("complete"), ("a", "b"), (never, (1, *never[1:])), 41, in_pairs=True)
    assert tied.paired is not None
    assert (tied.paired.kind, tied.paired.higher) == (EXACT_TIES, 1)


def test_curve_of_runs_without_one() -> None:
    """The share falls in the generation of the first one, and stays where it never came."""
    assert still_without([1, None], 3) == [1.0, 0.5, 0.5]


def test_band_of_a_share_by_hand() -> None:
    """Wilson's interval of 5 of 10 is 0.237 to 0.763; of none it has a width all the same."""
    assert band(0.5, 10) == (pytest.approx(0.2366, abs=1e-4), pytest.approx(0.7634, abs=1e-4))
    assert band(0.0, 10) == (pytest.approx(0.0), pytest.approx(0.2775, abs=1e-4))


def test_a_cell_shows_how_many_runs_got_there() -> None:
    """A table's cell gives mean, SD and median, or the median and how many runs it rests on."""
    assert time_cell(summary([6, 8, 5, 5, 15], 41)) == "7.8 ± 4.2, median 6.0"
    assert time_cell(summary([6], 41)) == "6.0 ± \N{EN DASH}, median 6.0"
    assert time_cell(summary([3, None, 5], 41)) == "median 5.0, 2 of 3 runs"
    assert time_cell(summary([None, None], 41)) == "never in 2 runs"
