"""Tables 9, 10, 11 and 12 for two arms: what the tests say, beside the paper's figures."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Final

from islandgp.study import paper
from islandgp.study.emergence import Summary, reduction, summary
from islandgp.study.findings import Finding
from islandgp.study.measures import TABLE_11, TABLE_12, Measure
from islandgp.study.notation import (
    DIGITS,
    NONE,
    change,
    effect,
    interval,
    number,
    percent,
    probability,
    spread,
    tested,
)
from islandgp.study.paper import MARK
from islandgp.study.statistics import bootstrap, mean_sd, median, median_difference
from islandgp.study.table import Table

TESTS: Final = ("difference", "U", "z", "p", "p BH", "r")
SIGNS: Final = (
    "Mann–Whitney U of the first arm, two-sided; p BH: Benjamini–Hochberg over the whole family"
    " of {n} comparisons; r = 1 − 2U/(n1 n2): above 0, the first arm has the lower values."
    " ± is the sample standard deviation over runs."
)


def fitness_table(
    key: str,
    title: str,
    findings: Sequence[Finding],
    theirs: Mapping[str, paper.Row],
    *,
    family: int,
) -> Table:
    """Table 9 or 10 for one pair of arms; `family` comparisons were adjusted together."""
    a, b = findings[0].arms
    return Table(
        key,
        title,
        (
            "Metric",
            a,
            b,
            *TESTS,
            f"{MARK} proposed",
            f"{MARK} baseline",
            f"{MARK} p",
            f"{MARK} p BH",
            f"{MARK} r",
        ),
        tuple(
            (f.measure.label, *_arms(f), *_tests(f), *_paper_row(theirs[f.measure.key]))
            for f in findings
        ),
        (SIGNS.format(n=family), paper.NOTE),
    )


def _arms(f: Finding) -> tuple[str, ...]:
    digits = DIGITS[f.measure.unit]
    return tuple(spread(*mean_sd(sample), digits) for sample in f.numbers)


def _tests(f: Finding) -> tuple[str, ...]:
    (a, _), (b, _) = (mean_sd(sample) for sample in f.numbers)
    return (percent(change(a, b)), *_rank(f))


def _rank(f: Finding) -> tuple[str, ...]:
    t = f.rank
    return number(t.u, 1), number(t.z, 2), tested(t), probability(f.rank_q), effect(t.r)


def _paper_row(row: paper.Row) -> tuple[str, ...]:
    return (
        spread(*row.proposed),
        spread(*row.baseline),
        probability(row.p),
        probability(row.p_bh),
        effect(row.r),
    )


def emergence_table(key: str, title: str, findings: Sequence[Finding], *, family: int) -> Table:
    """Section 3.4 for one pair of arms: when Complete and Excellent Robots came first."""
    a, b = findings[0].arms
    rows = [_emergence_row(f) for f in findings]
    notes = [SIGNS.format(n=family)]
    if any(f.censored for f in findings):
        notes.append(
            "Runs without one are censored: the rank test ranks them after the last generation,"
            " the log-rank test counts them as watched to the end, and no mean is given for"
            " their arm. 'Without one' is the mean number of generations lived through without"
            " one, over all runs."
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
    first, second = (_summary(sample, f.generations) for sample in f.samples)
    earlier = reduction(first, second)
    theirs = [summary(sample, 41) for sample in paper.TABLE_11[f.measure.key]]
    share, p_bh = paper.EMERGENCE[f.measure.key]
    return (
        f.measure.label,
        when(first),
        when(second),
        number(first.watched, 1),
        number(second.watched, 1),
        NONE if earlier is None else f"{percent(earlier[0]).lstrip('+')} ({earlier[1]})",
        *_rank(f),
        probability(f.log_rank),
        probability(f.log_rank_q),
        *(when(s) for s in theirs),
        percent(share).lstrip("+"),
        probability(p_bh),
    )


def _summary(sample: Sequence[float | None], generations: int) -> Summary:
    return summary([None if g is None else int(g) for g in sample], generations)


def when(s: Summary) -> str:
    """An arm's time to emergence in a cell."""
    if s.mean is not None and s.sd is not None:
        return f"{spread(s.mean, s.sd, 1)}, median {number(s.median, 1)}"
    median_text = "not reached" if s.median is None else number(s.median, 1)
    return f"median {median_text}, {s.emerged} of {s.runs} runs"


def diversity_table(key: str, title: str, findings: Sequence[Finding], *, family: int) -> Table:
    """Table 12 for one pair of arms, with the tests that the paper does not make."""
    a, b = findings[0].arms
    known = {m.key for m in TABLE_12}
    rows = []
    for f in findings:
        if f.measure.key not in known:
            rows.append((f.measure.label, *_arms(f), *_tests(f), *[NONE] * 3))
            continue
        ours, base, share = paper.TABLE_12[f.measure.key]
        rows.append(
            (
                f.measure.label,
                *_arms(f),
                *_tests(f),
                number(ours, 3),
                number(base, 3),
                percent(share),
            )
        )
    return Table(
        key,
        title,
        (
            "Measure",
            a,
            b,
            *TESTS,
            f"{MARK} proposed",
            f"{MARK} baseline",
            f"{MARK} difference",
        ),
        tuple(rows),
        (SIGNS.format(n=family), "The paper tests none of these.", paper.NOTE),
    )


def median_table(key: str, title: str, findings: Sequence[Finding]) -> Table:
    """Medians with bootstrap intervals, and the tests seed by seed."""
    a, b = findings[0].arms
    return Table(
        key,
        title,
        (
            "Measure",
            f"median {a} [95 %]",
            f"median {b} [95 %]",
            "difference of medians [95 %]",
            "pairs",
            f"{a} lower : higher",
            "paired p",
            "paired p BH",
        ),
        tuple(_median_row(f) for f in findings),
        (
            "Intervals: percentiles of 10,000 bootstrap samples of the runs of each arm, seeded."
            " Where a tier never emerged in some run, the interval is left out.",
            "Paired tests compare runs of the same seed: Wilcoxon's signed-rank test, or the sign"
            " test where runs are censored; p BH over the same comparisons.",
        ),
    )


def _median_row(f: Finding) -> tuple[str, ...]:
    digits = DIGITS[f.measure.unit]
    medians = _medians(f, f.measure, digits)
    t = f.paired
    if t is None:
        return (f.measure.label, *medians, *[NONE] * 4)
    return (
        f.measure.label,
        *medians,
        str(t.pairs),
        f"{t.lower} : {t.higher}",
        tested(t),
        probability(f.paired_q),
    )


def _medians(f: Finding, measure: Measure, digits: int) -> tuple[str, ...]:
    if f.censored and measure in TABLE_11:
        return (*(when(_summary(sample, f.generations)) for sample in f.samples), NONE)
    first, second = f.numbers
    return (
        interval(bootstrap([first], median), digits),
        interval(bootstrap([second], median), digits),
        interval(bootstrap([first, second], median_difference), digits),
    )
