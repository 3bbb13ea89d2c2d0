"""Two arms by several measures: Tables 9, 10 and 12, medians, and what so many runs can show."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Final, TypeVar

from islandgp.study.arms import Comparison
from islandgp.study.findings import Finding
from islandgp.study.paper import MARK, Diversity, Paper, Tested
from islandgp.study.statistics import (
    FEWEST,
    LEVEL,
    bootstrap,
    mean_sd,
    median_difference,
    median_interval,
    smallest_difference,
)
from islandgp.study.table import (
    DIGITS,
    NONE,
    Row,
    Table,
    change,
    effect,
    interval,
    number,
    percent,
    probability,
    signed,
    spread,
    tested,
)

SIGNS: Final = (
    "Mann-Whitney U of the first arm, two-sided, as in the paper;"
    " r = 1 - 2U/(n1 n2): above 0, the first arm has the lower values."
    " A difference in percent is left out unless both means are positive, and where the second is"
    " nearer to zero than its SD. ± is the sample standard deviation over runs."
)


def families_note(findings: Sequence[Finding]) -> str:
    """What each measure's p-values are adjusted with."""
    families = {(f.family, f.size): [g for g in findings if g.family == f.family] for f in findings}
    each = [
        f"'{name}', {size} comparisons"
        + (f" ({', '.join(g.measure.label for g in mine)})" if len(families) > 1 else "")
        for (name, size), mine in families.items()
    ]
    return f"p BH: Benjamini-Hochberg over the family {'; '.join(each)}."


def difference(f: Finding) -> str:
    """By which share the means differ; by how much, where a share would say nothing."""
    (a, _), (b, sd) = (mean_sd(sample) for sample in f.numbers)
    share = change(a, b, sd)
    if share is not None:
        return percent(share)
    unit = " points" if f.measure.unit == "points" else ""
    return f"{NONE} ({signed(a - b, DIGITS[f.measure.unit])}{unit})"


def rank_cells(f: Finding) -> Row:
    """The rank test."""
    yield "U", number(f.rank.u, 1)
    yield "z", number(f.rank.z, 2)
    yield "p", tested(f.rank)
    yield "p BH", probability(f.rank_q)
    yield "r", effect(f.rank.r)


def _ours(f: Finding) -> Row:
    """Mean and deviation of each arm, and how they differ."""
    for arm, sample in zip(f.arms, f.numbers, strict=True):
        yield arm, spread(*mean_sd(sample), DIGITS[f.measure.unit])
    yield "difference", difference(f)
    yield from rank_cells(f)


def fitness_table(key: str, title: str, findings: Sequence[Finding], paper: Paper | None) -> Table:
    """Table 9 or 10 for one pair of arms."""
    known = paper.fitness if paper else None
    theirs: Cells[Tested] = {
        "proposed": lambda row: spread(*row.proposed),
        "baseline": lambda row: spread(*row.baseline),
        "p": lambda row: probability(row.p),
        "p BH": lambda row: probability(row.p_bh),
        "r": lambda row: effect(row.r),
    }
    rows = (
        [("Metric", f.measure.label), *_ours(f), *published(known, f.measure.key, theirs)]
        for f in findings
    )
    return Table.of(key, title, rows, (SIGNS, families_note(findings), *footnotes(paper)))


def diversity_table(
    key: str, title: str, findings: Sequence[Finding], paper: Paper | None
) -> Table:
    """Table 12 for one pair of arms, with the tests that the paper does not make."""
    known = paper.diversity if paper else None
    theirs: Cells[Diversity] = {
        "proposed": lambda row: number(row.proposed, 3),
        "baseline": lambda row: number(row.baseline, 3),
        "difference": lambda row: percent(row.difference),
    }
    rows = (
        [("Measure", f.measure.label), *_ours(f), *published(known, f.measure.key, theirs)]
        for f in findings
    )
    notes = SIGNS, families_note(findings), "The paper tests none of these.", *footnotes(paper)
    return Table.of(key, title, rows, notes)


T = TypeVar("T")
Cells = Mapping[str, Callable[[T], str]]  # by column, how its cell is made


def published(known: Mapping[str, T] | None, key: str, cells: Cells[T]) -> Row:
    """The columns of published figures: dashes where none are known of a key, None: no columns."""
    if known is not None:
        row = known.get(key)
        for head, cell in cells.items():
            yield f"{MARK} {head}", NONE if row is None else cell(row)


def footnotes(paper: Paper | None) -> tuple[str, ...]:
    """The note below a table with published figures."""
    return (paper.footnote,) if paper else ()


def median_table(key: str, title: str, findings: Sequence[Finding]) -> Table:
    """Medians with bootstrap intervals, and the tests seed by seed."""
    return Table.of(
        key,
        title,
        ([("Measure", f.measure.label), *_medians(f), *_pairs(f)] for f in findings),
        (
            "Intervals of medians: order statistics, exact; fewer than six runs have none. Those of"
            " differences: percentiles of 10,000 bootstrap samples of the runs of each arm, seeded;"
            f" fewer than {FEWEST} runs have none. A run in which"
            " a tier never emerged counts as infinite in a median: \N{INFINITY} says"
            " that it was not reached by the last generation, and a dash that neither arm's was."
            " 'never' is an arm in which it emerged in no run.",
            "Paired tests compare runs of the same seed: Wilcoxon's signed-rank test; of emergence,"
            " on the generations lived through without one. p BH over the same families.",
        ),
    )


def _medians(f: Finding) -> Row:
    digits = DIGITS[f.measure.unit]
    for arm, sample, ends in zip(f.arms, f.samples, f.endless, strict=True):
        never = all(v is None for v in sample)
        middle = "never" if never else interval(median_interval(ends), digits)
        yield f"median {arm} [95 %]", middle
    apart = bootstrap(f.endless, median_difference)
    yield "difference of medians [95 %]", interval(apart, digits)


def _pairs(f: Finding) -> Row:
    t = f.paired
    yield "pairs", NONE if t is None else str(t.pairs)
    yield f"{f.arms[0]} lower : higher", NONE if t is None else f"{t.lower} : {t.higher}"
    yield "paired p", NONE if t is None else tested(t)
    yield "paired p BH", probability(f.paired_q)


def power_table(study: Comparison, family: int) -> Table:
    """The smallest differences that so many runs can show at all."""
    rows = []
    for n1, n2 in dict.fromkeys((len(a.runs), len(b.runs)) for a, b in study.pairs):
        for label, level in ((f"{LEVEL:g}", LEVEL), (f"{LEVEL:g} / {family}", LEVEL / family)):
            p = smallest_difference(n1, n2, level)
            better = NONE if p.superiority is None else f"{p.superiority:.0%}"
            rows.append(
                {
                    "Runs": f"{n1} and {n2}",
                    "level of one test": label,
                    "shift (SD)": "none" if p.shift is None else number(p.shift, 2),
                    "chance that the better arm's run is better": better,
                    "|r|": number(p.r, 2),
                    "least p possible": probability(p.least_p),
                }
            )
    return Table.of(
        "power",
        "Smallest difference that is found with 80 % power",
        map(dict.items, rows),
        (
            "By simulation of the exact Mann-Whitney test on normal values that differ by a shift"
            " (4,000 pairs of samples a step, seeded). The second level is the strictest one of"
            " Benjamini and Hochberg's procedure, for the case that nothing else is found. Smaller"
            " differences than these can exist and stay unseen.",
        ),
    )
