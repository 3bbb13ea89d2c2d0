"""Table 11: first emergence for two arms, and run by run."""

from __future__ import annotations

from collections.abc import Sequence

from islandgp.scoring.classify import Tier
from islandgp.study import paper
from islandgp.study.arms import Arm, Comparison
from islandgp.study.emergence import Summary, first, reduction, summary
from islandgp.study.findings import Finding
from islandgp.study.notation import NONE, interval, number, percent, probability, spread
from islandgp.study.paper import MARK
from islandgp.study.table import Table
from islandgp.study.tables.cells import SIGNS, TESTS, rank_cells


def emergence_table(key: str, title: str, findings: Sequence[Finding], *, family: int) -> Table:
    """Section 3.4 for one pair of arms: when Complete and Excellent Robots came first."""
    a, b = findings[0].arms
    rows = [_emergence_row(f) for f in findings]
    notes = [
        SIGNS.format(n=family),
        "'Without one' is the mean number of generations lived through without one, over all runs"
        " (restricted mean); its difference has a bootstrap interval.",
    ]
    if any(f.censored for f in findings):
        notes.append(
            "Runs without one are censored: the rank test ranks them after the last generation,"
            " the log-rank test counts them as watched to the end, and no mean is given for"
            " their arm."
        )
    return Table(
        key,
        title,
        (
            "Tier",
            a,
            b,
            f"without one, {a}",
            f"without one, {b}",
            "difference without one [95 %]",
            "earlier by",
            *TESTS[1:],
            "log-rank p",
            "log-rank p BH",
            f"{MARK} proposed",
            f"{MARK} baseline",
            f"{MARK} earlier by",
            f"{MARK} p BH",
        ),
        tuple(rows),
        (*notes, paper.NOTE),
    )


def _emergence_row(f: Finding) -> tuple[str, ...]:
    first, second = (summary(sample, f.generations) for sample in f.samples)
    earlier = reduction(first, second)
    theirs = [summary(sample, 41) for sample in paper.TABLE_11[f.measure.key]]
    share, p_bh = paper.EMERGENCE[f.measure.key]
    return (
        f.measure.label,
        when(first),
        when(second),
        number(first.watched, 1),
        number(second.watched, 1),
        interval(f.shift, 1),
        NONE if earlier is None else f"{percent(earlier[0]).lstrip('+')} ({earlier[1]})",
        *rank_cells(f),
        probability(f.log_rank),
        probability(f.log_rank_q),
        *(when(s) for s in theirs),
        percent(share).lstrip("+"),
        probability(p_bh),
    )


def when(s: Summary) -> str:
    """An arm's time to emergence in a cell."""
    if s.mean is not None and s.sd is not None:
        return f"{spread(s.mean, s.sd, 1)}, median {number(s.median, 1)}"
    median_text = "not reached" if s.median is None else number(s.median, 1)
    return f"median {median_text}, {s.emerged} of {s.runs} runs"


def runs_table(study: Comparison) -> Table:
    """Table 11: the generation of the first Complete and Excellent Robot in each run."""
    tiers = (Tier.COMPLETE, Tier.EXCELLENT)
    seeds = sorted({seed for arm in study.arms for seed in arm.seeds})
    rows = [
        (str(seed), *(_firsts(arm, seed, tier) for arm in study.arms for tier in tiers))
        for seed in seeds
    ]
    columns = [f"{arm.name}: {tier.value}" for arm in study.arms for tier in tiers]
    theirs = [
        f"{MARK} {who}: {tier}"
        for who in ("proposed", "baseline")
        for tier in ("complete", "excellent")
    ]
    complete, excellent = paper.TABLE_11["first_complete"], paper.TABLE_11["first_excellent"]
    printed = list(zip(complete[0], excellent[0], complete[1], excellent[1], strict=True))
    padded = [*(tuple(map(str, row)) for row in printed), *[("",) * 4] * len(rows)]
    return Table(
        "table-11-runs",
        "Table 11. Generation of the first Complete and the first Excellent Robot, run by run",
        ("Seed", *columns, *theirs),
        tuple((*row, *beside) for row, beside in zip(rows, padded, strict=False)),
        (
            "Generations count from 0, the initial population. 'never': none up to the last"
            f" generation, {study.generations - 1}; such a run is censored, not dropped.",
            "The paper's five runs stand beside the first rows in its order; they share nothing"
            " with the seeds there.",
            paper.NOTE,
        ),
    )


def _firsts(arm: Arm, seed: int, tier: Tier) -> str:
    found = [first(run, tier) for run in arm.runs if run.seed == seed]
    return ", ".join("never" if g is None else str(g) for g in found) or NONE
