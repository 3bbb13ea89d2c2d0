"""Table 14: what supervision costs."""

from __future__ import annotations

from islandgp.study.comparable import compare_arms
from islandgp.study.tables.supervision import overhead_table
from tests.study.fake_runs import fake_arm, fake_run


def test_time_to_the_first_complete_robot_is_a_median_over_all_runs() -> None:
    """A generation takes 1.6 s: in 2, 4 and never the median is 5 x 1.6 s; never twice, none."""
    mostly_complete = [fake_run(seed=k, complete=c) for k, c in enumerate((2, None, 4))]
    rarely_complete = [
        fake_run("baseline", seed=k, complete=c) for k, c in enumerate((None, 2, None))
    ]
    study = compare_arms(
        [fake_arm("expert", mostly_complete), fake_arm("baseline", rarely_complete)]
    )
    (row,) = [r for r in overhead_table(study).rows if r[0].startswith("Time to the first")]
    assert row[1:3] == ("median 8.0, 2 of 3 runs", "median not reached, 1 of 3 runs")
