"""A paper's claims, one by one, beside what these runs show."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

from islandgp.study.emergence import reduction, summary
from islandgp.study.findings import Finding, finding
from islandgp.study.measures import FURTHER
from islandgp.study.notation import DIGITS, NONE, interval, percent, probability, signed
from islandgp.study.paper import Paper
from islandgp.study.power import LEVEL
from islandgp.study.table import Table
from islandgp.study.tables import comparisons
from islandgp.study.tables.comparisons import published

MAIN: Final = "the paper's nine"
OTHERS: Final = "further"
"""The families of Benjamini and Hochberg's procedure."""

UNDECIDED: Final = "no difference shown (no evidence either way)"
"""The verdict where a claim of no difference meets a test that finds none."""


def claims_table(
    key: str, title: str, findings: Sequence[Finding], arms: tuple[str, str], paper: Paper
) -> Table:
    """One row a claim, the first arm standing for the paper's proposed system."""
    rows = []
    for claim in paper.claims:
        f = finding(findings, claim.measure, arms)
        rows.append(
            (
                claim.text,
                difference(f),
                size(f),
                probability(f.rank_q),
                OTHERS if f.measure in FURTHER else MAIN,
                percent(claim.difference),
                probability(claim.p_bh),
                verdict(claim.direction, f),
            )
        )
    return Table(
        key,
        title,
        (
            "Claim",
            "here",
            "difference [95 %]",
            "p BH",
            "family",
            *published(paper, ("difference", "p BH")),
            "verdict",
        ),
        tuple(rows),
        (
            "Difference: of the means, with its bootstrap interval; for emergence, of the mean"
            " generations lived through without one.",
            f"Family: what p BH is adjusted over. '{MAIN}': the comparisons of Tables 9, 10 and 11;"
            f" '{OTHERS}': those of Table 12, which the paper does not test; each times the pairs"
            " of arms.",
            f"{arms[0]} stands for the paper's proposed system, {arms[1]} for its baseline."
            f" 'Shown': p BH < {LEVEL:g}. 'Not shown' is no evidence that there is no difference;"
            " the power note says what could have been found.",
            paper.footnote,
        ),
    )


def difference(f: Finding) -> str:
    """By which share the first arm differs, and how that is measured when not by means."""
    if not f.measure.emergence:
        return comparisons.difference(f)
    if f.never:
        return "never in either arm"
    earlier = reduction(*(summary(sample, f.generations) for sample in f.samples))
    if earlier is None:  # no share of the generation 0
        return f"{NONE} ({signed(f.shift.estimate, 1)} generations)"
    by = "" if earlier[1] == "means" else f" ({earlier[1]})"
    return f"{percent(-earlier[0])}{by}"


def size(f: Finding) -> str:
    """By how much the means differ, in the measure's unit."""
    if f.never:
        return NONE
    unit = {"points": " points", "generation": " generations"}.get(f.measure.unit, "")
    return f"{interval(f.shift, DIGITS[f.measure.unit])}{unit}"


def verdict(direction: int, f: Finding) -> str:
    """What the tests say of a claim; `direction` as in `paper.Claim`."""
    shown = f.rank_q < LEVEL
    if direction == 0:
        return f"differs: {_side(f)}, shown" if shown else UNDECIDED
    if f.never:
        return "never in either arm"
    if not shown:  # ranks and means may point to different sides
        return "not shown"
    return "agrees, shown" if (f.rank.r < 0) == (direction > 0) else "opposite, shown"


def _side(f: Finding) -> str:
    return "lower" if f.rank.r > 0 else "higher"
