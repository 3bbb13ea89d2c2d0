"""Table 11: first emergence of each milestone for two arms, and run by run."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import zip_longest

from islandgp.study.arms import Arm, Comparison
from islandgp.study.emergence import Summary, first, reduction, summary
from islandgp.study.findings import Finding
from islandgp.study.paper import Paper
from islandgp.study.table import NONE, Table, interval, number, percent, probability, spread
from islandgp.study.tables.comparisons import (
    SIGNS,
    TESTS,
    families_note,
    footnotes,
    published,
    rank_cells,
)
from islandgp.supervision.state_json import title

PAPER_GENERATIONS = 41  # of the runs of Table 11


def emergence_table(
    key: str, heading: str, findings: Sequence[Finding], paper: Paper | None
) -> Table:
    """Section 3.4 for one pair of arms: when the first robot of each milestone came."""
    a, b = findings[0].arms
    notes = [
        SIGNS,
        families_note(findings),
        "'Without one' is the mean number of generations lived through without one, over all runs"
        " (restricted mean); the interval of its difference is Student's t of the pairs, Welch's"
        " where arms share no seeds. 'all' and a number: no run"
        " of the arm had one in all its generations.",
    ]
    if any(f.censored for f in findings):
        notes.append(
            "Runs without one are censored: the rank test ranks them after the last generation,"
            " the log-rank test counts them as watched to the end, and no mean is given for"
            " their arm."
        )
    return Table(
        key,
        heading,
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
            *published(paper, ("proposed", "baseline", "earlier by", "p BH")),
        ),
        tuple((*_ours(f), *_theirs(paper, f.measure.key)) for f in findings),
        (*notes, *footnotes(paper)),
    )


def _ours(f: Finding) -> tuple[str, ...]:
    first, second = (summary(sample, f.generations) for sample in f.samples)
    earlier = reduction(first, second)
    return (
        f.measure.label,
        when(first),
        when(second),
        without(first),
        without(second),
        interval(f.shift, 1),
        NONE if earlier is None else f"{percent(earlier[0]).lstrip('+')} ({earlier[1]})",
        *rank_cells(f),
        probability(f.log_rank),
        probability(f.log_rank_q),
    )


def _theirs(paper: Paper | None, key: str) -> tuple[str, ...]:
    if paper is None:
        return ()
    if (row := paper.emergence.get(key.removeprefix("first_"))) is None:
        return (NONE,) * 4
    return (
        when(summary(row.proposed, PAPER_GENERATIONS)),
        when(summary(row.baseline, PAPER_GENERATIONS)),
        percent(row.earlier).lstrip("+"),
        probability(row.p_bh),
    )


def when(s: Summary) -> str:
    """An arm's time to emergence in a cell."""
    if s.never:
        return f"never in {s.runs} runs"
    if s.mean is not None and s.sd is not None:
        return f"{spread(s.mean, s.sd, 1)}, median {number(s.median, 1)}"
    middle = "not reached" if s.median is None else number(s.median, 1)
    return f"median {middle}, {s.emerged} of {s.runs} runs"


def without(s: Summary) -> str:
    """The mean number of generations without one; "all" of them where there never was one."""
    return f"all {s.watched:g}" if s.never else number(s.watched, 1)


def runs_table(study: Comparison) -> Table:
    """Table 11: the generation of the first robot of each milestone in each run."""
    tiers = study.milestones
    seeds = sorted({seed for arm in study.arms for seed in arm.seeds})
    rows = [
        (str(seed), *(_firsts(arm, seed, tier) for arm in study.arms for tier in tiers))
        for seed in seeds
    ]
    heads = [f"{who}: {title(tier)}" for who in ("proposed", "baseline") for tier in tiers]
    notes: tuple[str, ...] = (
        "Generations count from 0, the initial population. 'never': none up to the last"
        f" generation, {study.generations - 1}; such a run is censored, not dropped.",
    )
    if study.paper:
        notes += (
            "The paper's five runs stand beside the first rows in its order; they share nothing"
            " with the seeds there.",
        )
    return Table(
        "table-11-runs",
        "Table 11. Generation of the first"
        f" {' and the first '.join(map(title, tiers))} Robot, run by run",
        (
            "Seed",
            *(f"{arm.name}: {title(tier)}" for arm in study.arms for tier in tiers),
            *published(study.paper, heads),
        ),
        tuple(_beside(rows, study.paper, tiers)),
        (*notes, *footnotes(study.paper)),
    )


def _beside(
    rows: Sequence[tuple[str, ...]], paper: Paper | None, tiers: Sequence[str]
) -> list[tuple[str, ...]]:
    """The rows, the first of them with the paper's runs beside them."""
    if paper is None:
        return list(rows)
    found = [paper.emergence.get(tier) for tier in tiers]
    columns = [
        *(row.proposed if row else () for row in found),
        *(row.baseline if row else () for row in found),
    ]
    theirs = [tuple(map(str, row)) for row in zip_longest(*columns, fillvalue="")]
    empty = ("",) * len(columns)
    return [(*row, *(theirs[k] if k < len(theirs) else empty)) for k, row in enumerate(rows)]


def _firsts(arm: Arm, seed: int, tier: str) -> str:
    found = [first(run, tier) for run in arm.runs if run.seed == seed]
    return ", ".join("never" if g is None else str(g) for g in found) or NONE
