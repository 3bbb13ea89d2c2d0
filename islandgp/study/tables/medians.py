"""Medians with bootstrap intervals, and the tests seed by seed."""

from __future__ import annotations

from collections.abc import Sequence

from islandgp.study.findings import Finding
from islandgp.study.notation import DIGITS, NONE, interval, probability, tested
from islandgp.study.statistics import bootstrap, median, median_difference
from islandgp.study.table import Table


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
            " A run in which a tier never emerged counts as infinite in a median: \N{INFINITY} says"
            " that it was not reached by the last generation, and a dash that neither arm's was.",
            "Paired tests compare runs of the same seed: Wilcoxon's signed-rank test, or the sign"
            " test where runs are censored; p BH over the same comparisons.",
        ),
    )


def _median_row(f: Finding) -> tuple[str, ...]:
    digits = DIGITS[f.measure.unit]
    medians = _medians(f, digits)
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


def _medians(f: Finding, digits: int) -> tuple[str, ...]:
    first, second = f.endless
    return (
        interval(bootstrap([first], median), digits),
        interval(bootstrap([second], median), digits),
        interval(bootstrap([first, second], median_difference), digits),
    )
