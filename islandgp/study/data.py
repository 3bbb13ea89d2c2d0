"""The exact numbers behind the tables: one line a run, one line a comparison."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict
from math import isnan
from statistics import fmean

from islandgp.study.arms import Comparison
from islandgp.study.emergence import quantile
from islandgp.study.findings import Finding
from islandgp.study.generalise import Generalisation
from islandgp.study.measures import FURTHER, main_family, overhead
from islandgp.study.statistics import mean_sd
from islandgp.study.table import to_csv

TEST_COLUMNS = (
    "first",
    "second",
    "measure",
    "unit",
    "family",  # what the adjusted p-values belong to, and its comparisons
    "family_size",
    "n_first",
    "n_second",
    "mean_first",
    "sd_first",
    "mean_second",
    "sd_second",
    "median_first",
    "median_second",
    "censored_first",
    "censored_second",
    "U",
    "z",
    "p",
    "kind",
    "p_bh",
    "r",
    "paired_p",
    "paired_kind",
    "paired_p_bh",
    "log_rank_p",
    "log_rank_p_bh",
    "without_first",  # these two, for emergence: mean generations lived through without one
    "without_second",
    "difference",  # of the means, or of the two before; with its 95 % interval
    "difference_low",
    "difference_high",
)


def runs_csv(study: Comparison) -> str:
    """Every run's measures; an empty cell is a tier that never emerged."""
    measures = (*main_family(study.milestones), *FURTHER)
    rows = []
    for arm in study.arms:
        for run in arm.runs:
            costs = asdict(overhead(run))
            numbers = [m.of(run) for m in measures]
            rows.append([arm.name, run.seed, run.supervisor, run.name, *numbers, *costs.values()])
    return to_csv(("arm", "seed", "supervisor", "name", *(m.key for m in measures), *costs), rows)


def champions_csv(found: Sequence[Generalisation]) -> str:
    """Each champion in unseen worlds, and its paired difference to each yardstick, in points."""
    yardsticks = [g for g in found if g.seed is None]
    columns = ["arm", "seed", "trained", "worlds", "unseen", "worst", *found[0].reached]
    for y in yardsticks:
        columns += [f"minus {y.arm}{end}" for end in ("", ", low", ", high")]
    rows = []
    for g in found:
        if g.seed is not None:
            row: list[object] = [
                g.arm,
                g.seed,
                g.trained,
                g.worlds,
                g.unseen,
                g.worst,
                *g.reached.values(),
            ]
            for y in yardsticks:
                d = g.minus(y)
                row += map(_known, (d.estimate, d.low, d.high))
            rows.append(row)
    return to_csv(columns, rows)


def tests_csv(findings: Sequence[Finding]) -> str:
    """Every comparison; the mean of a sample with censored runs is left empty.

    Its median is left empty when half of the runs or more are censored.
    """
    return to_csv(TEST_COLUMNS, [_row(f) for f in findings])


def _row(f: Finding) -> list[object]:
    sides: list[tuple[float | None, float | None, float | None, int]] = []
    for sample in f.samples:
        known = [v for v in sample if v is not None]
        left = len(sample) - len(known)
        mean, sd = (None, None) if left else map(_known, mean_sd(known))
        sides.append((mean, sd, quantile(sample, 0.5), left))
    (m1, s1, d1, c1), (m2, s2, d2, c2) = sides
    t, p, shift = f.rank, f.paired, f.shift
    without = map(fmean, f.numbers) if f.measure.emergence else (None, None)
    return [
        *f.arms,
        f.measure.key,
        f.measure.unit,
        f.family,
        f.size,
        *t.n,
        *(m1, s1, m2, s2, d1, d2, c1, c2),
        *(t.u, t.z, t.p, t.kind, f.rank_q, t.r),
        *(None if p is None else p.p, None if p is None else p.kind, f.paired_q),
        *(f.log_rank, f.log_rank_q),
        *(*without, *map(_known, (shift.estimate, shift.low, shift.high))),
    ]


def _known(x: float) -> float | None:
    """An empty cell stands for what one run cannot tell."""
    return None if isnan(x) else x


def metrics(findings: Sequence[Finding]) -> dict[str, float]:
    """What an MLflow run of a comparison is to be found by."""
    several = len({f.arms for f in findings}) > 1
    found = {}
    for f in findings:
        name = f"{f.measure.key} {f.arms[0]} {f.arms[1]}" if several else f.measure.key
        found[f"p_bh/{name}"] = f.rank_q
        found[f"r/{name}"] = f.rank.r
    return found
