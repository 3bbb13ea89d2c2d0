"""Table 11: first emergence of each milestone for two arms, and run by run."""

from __future__ import annotations

from collections.abc import Sequence

from islandgp.study.arms import Arm, Comparison
from islandgp.study.emergence import Summary, first, reduction, summary
from islandgp.study.findings import Finding
from islandgp.study.paper import MARK, Emergence, Paper
from islandgp.study.table import NONE, Row, Table, interval, number, percent, probability, spread
from islandgp.study.tables.comparisons import (
    SIGNS,
    Cells,
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
    known = paper.emergence if paper else None
    theirs: Cells[Emergence] = {
        "proposed": lambda row: when(summary(row.proposed, PAPER_GENERATIONS)),
        "baseline": lambda row: when(summary(row.baseline, PAPER_GENERATIONS)),
        "earlier by": lambda row: percent(row.earlier).lstrip("+"),
        "p BH": lambda row: probability(row.p_bh),
    }
    rows = (
        [*_ours(f), *published(known, f.measure.key.removeprefix("first_"), theirs)]
        for f in findings
    )
    return Table.of(key, heading, rows, (*notes, *footnotes(paper)))


def _ours(f: Finding) -> Row:
    first, second = (summary(sample, f.generations) for sample in f.samples)
    earlier = reduction(first, second)
    share = NONE if earlier is None else f"{percent(earlier[0]).lstrip('+')} ({earlier[1]})"
    a, b = f.arms
    yield "Tier", f.measure.label
    yield a, when(first)
    yield b, when(second)
    yield f"without one, {a}", without(first)
    yield f"without one, {b}", without(second)
    yield "difference without one [95 %]", interval(f.shift, 1)
    yield "earlier by", share
    yield from rank_cells(f)
    yield "log-rank p", probability(f.log_rank)
    yield "log-rank p BH", probability(f.log_rank_q)


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
    notes = [
        "Generations count from 0, the initial population. 'never': none up to the last"
        f" generation, {study.generations - 1}; such a run is censored, not dropped.",
    ]
    if study.paper:
        notes.append(
            "The paper's five runs stand beside the first rows in its order; they share nothing"
            " with the seeds there."
        )
    seeds = sorted({seed for arm in study.arms for seed in arm.seeds})
    return Table.of(
        "table-11-runs",
        "Table 11. Generation of the first"
        f" {' and the first '.join(map(title, tiers))} Robot, run by run",
        (
            [
                ("Seed", str(seed)),
                *(
                    (f"{a.name}: {title(t)}", _firsts(a, seed, t))
                    for a in study.arms
                    for t in tiers
                ),
                *_beside(place, study.paper, tiers),
            ]
            for place, seed in enumerate(seeds)
        ),
        (*notes, *footnotes(study.paper)),
    )


def _beside(place: int, paper: Paper | None, tiers: Sequence[str]) -> Row:
    """The paper's run of that number, empty beyond its last one."""
    known = [(tier, paper.emergence.get(tier)) for tier in tiers] if paper else []
    for who in ("proposed", "baseline"):
        for tier, row in known:
            cells = getattr(row, who)[place : place + 1] if row else ()
            yield f"{MARK} {who}: {title(tier)}", "".join(map(str, cells))


def _firsts(arm: Arm, seed: int, tier: str) -> str:
    found = [first(run, tier) for run in arm.runs if run.seed == seed]
    return ", ".join("never" if g is None else str(g) for g in found) or NONE
