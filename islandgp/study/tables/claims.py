"""The paper's claims, one by one, beside what these runs show."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

from islandgp.study import paper
from islandgp.study.emergence import reduction, summary
from islandgp.study.findings import Finding, finding
from islandgp.study.measures import FAMILY
from islandgp.study.notation import DIGITS, interval, percent, probability
from islandgp.study.paper import MARK
from islandgp.study.power import LEVEL
from islandgp.study.table import Table
from islandgp.study.tables import cells


@dataclass(frozen=True, slots=True)
class Claim:
    """What the paper says of its proposed system against its baseline."""

    measure: str
    text: str
    direction: int  # of the first arm's values: -1 lower, +1 higher, 0 no difference
    size: float | None  # the paper's difference as a share
    p_bh: float | None


CLAIMS: Final = (
    Claim("first_complete", "Complete Robots come earlier", -1, -0.717, 0.0358),
    Claim("first_excellent", "Excellent Robots come earlier", -1, -0.652, None),
    Claim("diversity_overall", "Behavioural diversity is higher", 1, 0.280, None),
    Claim("mutation_rate", "with lower mutation rates", -1, None, None),
    Claim("stage_early", "Early fitness is higher (the paper: not shown)", 1, 0.184, 0.057),
    Claim("stage_mid", "Mid-training fitness is higher", 1, 0.402, 0.036),
    Claim("stage_late", "Late fitness does not differ", 0, 0.002, 0.616),
    Claim("max_ever", "The fitness ceiling does not differ", 0, -0.007, 1.0),
    Claim("final_mean", "The final average fitness is lower", -1, -0.273, 0.036),
)

NINE: Final = "the paper's nine"
OTHERS: Final = "further"
"""The families of Benjamini and Hochberg's procedure."""

UNDECIDED: Final = "no difference shown (no evidence either way)"
"""The verdict where a claim of no difference meets a test that finds none."""


def claims_table(key: str, title: str, findings: Sequence[Finding], arms: tuple[str, str]) -> Table:
    """One row a claim, the first arm standing for the paper's proposed system."""
    rows = []
    for claim in CLAIMS:
        f = finding(findings, claim.measure, arms)
        rows.append(
            (
                claim.text,
                difference(f),
                size(f),
                probability(f.rank_q),
                NINE if f.measure in FAMILY else OTHERS,
                percent(claim.size),
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
            f"{MARK} difference",
            f"{MARK} p BH",
            "verdict",
        ),
        tuple(rows),
        (
            "Difference: of the means, with its bootstrap interval; for emergence, of the mean"
            " generations lived through without one.",
            f"Family: what p BH is adjusted over. '{NINE}': the comparisons of Tables 9, 10 and 11;"
            f" '{OTHERS}': those of Table 12, which the paper does not test; each times the pairs"
            " of arms.",
            f"{arms[0]} stands for the paper's proposed system, {arms[1]} for its baseline."
            f" 'Shown': p BH < {LEVEL:g}. 'Not shown' is no evidence that there is no difference;"
            " the power note says what could have been found.",
            paper.NOTE,
        ),
    )


def difference(f: Finding) -> str:
    """By which share the first arm differs, and how that is measured when not by means."""
    if not f.measure.emergence:
        return cells.difference(f)
    first, second = (summary(sample, f.generations) for sample in f.samples)
    earlier = reduction(first, second)
    if earlier is None:
        return "never in either arm"
    by = "" if earlier[1] == "means" else f" ({earlier[1]})"
    return f"{percent(-earlier[0])}{by}"


def size(f: Finding) -> str:
    """By how much the means differ, in the measure's unit."""
    unit = {"points": " points", "generation": " generations"}.get(f.measure.unit, "")
    return f"{interval(f.shift, DIGITS[f.measure.unit])}{unit}"


def verdict(direction: int, f: Finding) -> str:
    """What the tests say of a claim; `direction` as in `Claim`."""
    shown = f.rank_q < LEVEL
    if direction == 0:
        return f"differs: {_side(f)}, shown" if shown else UNDECIDED
    if f.measure.emergence and all(value is None for sample in f.samples for value in sample):
        return "never in either arm"
    if not shown:  # ranks and means may point to different sides
        return "not shown"
    return "agrees, shown" if (f.rank.r < 0) == (direction > 0) else "opposite, shown"


def _side(f: Finding) -> str:
    return "lower" if f.rank.r > 0 else "higher"
