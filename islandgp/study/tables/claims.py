"""Tables of the primary endpoint and of families of tests: one estimand per row."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from math import isnan
from typing import Final

from islandgp.statistics import LEVEL, PairedTest, mean_sd
from islandgp.study.findings import Finding
from islandgp.study.table import (
    DIGITS,
    NONE,
    Row,
    Table,
    change,
    number,
    percent,
    probability,
    signed_interval,
    spread,
    tested,
)
from islandgp.study.tables.comparisons import families_note
from islandgp.study.texts import note

NEVER: Final = "never in either arm"


def questions_table(
    key: str, name: str, findings: Sequence[Finding], margins: Mapping[str, float]
) -> Table:
    """The table of a further family, by pair of arms and measure."""
    rows = (
        [
            ("Arms", f"{f.arms[0]} minus {f.arms[1]}"),
            ("measure", f.measure.label),
            *estimate_cells(f),
            *test_cells(f),
            ("margin", NONE if (m := margins.get(f.measure.key)) is None else f"±{m:,g}"),
            ("verdict", comparison_verdict(f, m)),
        ]
        for f in findings
    )
    notes = (note("reading"), families_note(findings), note("shown", level=LEVEL))
    return Table.of(key, f"Differences: {name}", rows, *notes)


def primary_table(f: Finding, margin: float | None) -> Table:
    """The primary endpoint: one test, not adjusted."""
    a, b = f.arms
    digits, shift = DIGITS[f.measure.unit], f.shift
    wide = (shift.high - shift.low) / abs(shift.estimate) if shift.estimate else float("nan")
    if isinstance(f.test, PairedTest):
        equal = f.test.pairs - f.test.lower - f.test.higher
        pairs = f"{f.test.lower} : {equal} : {f.test.higher}"
    else:
        pairs = NONE
    means = zip(f.arms, f.numbers, strict=True)
    row = [
        *((f"{arm}, mean ± SD", spread(*mean_sd(values), digits)) for arm, values in means),
        *estimate_cells(f),
        ("width of the interval / |difference|", number(wide, 2)),
        (f"pairs: {a} lower : equal : higher", pairs),
        ("test", test_name(f)),
        ("p, not adjusted", tested(f.test)),
        ("verdict", comparison_verdict(f, margin, f.test.p)),
    ]
    heading = f"Primary endpoint: {f.measure.label}, {a} minus {b}"
    notes = note("reading"), note("shown-once", level=LEVEL)
    return Table.of("primary", heading, [row], *notes)


def estimate_cells(f: Finding) -> Row:
    """Cells of the difference of means: unit, difference with its interval, share."""
    yield "unit", "generations without one" if f.measure.emergence else f.measure.unit
    (a, _), (b, sd) = map(mean_sd, f.numbers)
    shift, digits = f.shift, DIGITS[f.measure.unit]
    difference, share = signed_interval(shift, digits), percent(change(a, b, sd))
    if f.never or f.equal:
        difference = NEVER if f.never else "0, equal in every pair"
        share = NONE
    yield "difference [95 %]", difference
    yield "in percent", share


def test_cells(f: Finding) -> Row:
    """The test, its p and its adjusted p."""
    untested = f.never or f.equal
    yield "test", "none: all values are equal" if untested else test_name(f)
    yield "p", NONE if untested else tested(f.test)
    yield "p BH", NONE if untested else probability(f.p_bh)


def test_name(f: Finding) -> str:
    """The name of the test of a difference."""
    if f.paired is None:
        return "Mann-Whitney U"
    return f"signed-rank, {f.paired.pairs} pairs"


def comparison_verdict(f: Finding, margin: float | None, p: float | None = None) -> str:
    """The verdict of a test on two arms; `p` replaces the adjusted p-value."""
    if f.never:
        return NEVER
    if f.equal:
        return "equal in every pair"
    within = f"alike within ±{margin:,g}" if alike(f, margin) else ""
    if (f.p_bh if p is None else p) < LEVEL:
        return f"{_side(f)}, shown" + (f", but {within}" if within else "")
    return within or "not shown"


def alike(f: Finding, margin: float | None) -> bool:
    """True if the interval of the difference lies within a margin."""
    shift = f.shift
    return (
        margin is not None and not isnan(shift.low) and -margin < shift.low <= shift.high < margin
    )


def _side(f: Finding) -> str:
    return "lower" if f.shift.estimate < 0 else "higher"
