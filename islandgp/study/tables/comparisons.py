"""Two arms by several measures: Tables 9, 10 and 12, medians, and what so many runs can show."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

from islandgp.study.arms import Comparison
from islandgp.study.findings import Finding
from islandgp.study.paper import MARK, Paper
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

TESTS: Final = ("difference", "U", "z", "p", "p BH", "r")

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


def arm_cells(f: Finding) -> tuple[str, ...]:
    """Mean and deviation of each arm."""
    digits = DIGITS[f.measure.unit]
    return tuple(spread(*mean_sd(sample), digits) for sample in f.numbers)


def difference(f: Finding) -> str:
    """By which share the means differ; by how much, where a share would say nothing."""
    (a, _), (b, sd) = (mean_sd(sample) for sample in f.numbers)
    share = change(a, b, sd)
    if share is not None:
        return percent(share)
    unit = " points" if f.measure.unit == "points" else ""
    return f"{NONE} ({signed(a - b, DIGITS[f.measure.unit])}{unit})"


def rank_cells(f: Finding) -> tuple[str, ...]:
    """The rank test: TESTS without the difference."""
    t = f.rank
    return number(t.u, 1), number(t.z, 2), tested(t), probability(f.rank_q), effect(t.r)


def fitness_table(key: str, title: str, findings: Sequence[Finding], paper: Paper | None) -> Table:
    """Table 9 or 10 for one pair of arms."""
    heads = ("proposed", "baseline", "p", "p BH", "r")
    return Table(
        key,
        title,
        ("Metric", *findings[0].arms, *TESTS, *published(paper, heads)),
        tuple(
            (f.measure.label, *_ours(f), *_fitness(paper, f.measure.key, len(heads)))
            for f in findings
        ),
        (SIGNS, families_note(findings), *footnotes(paper)),
    )


def diversity_table(
    key: str, title: str, findings: Sequence[Finding], paper: Paper | None
) -> Table:
    """Table 12 for one pair of arms, with the tests that the paper does not make."""
    heads = ("proposed", "baseline", "difference")
    return Table(
        key,
        title,
        ("Measure", *findings[0].arms, *TESTS, *published(paper, heads)),
        tuple(
            (f.measure.label, *_ours(f), *_diversity(paper, f.measure.key, len(heads)))
            for f in findings
        ),
        (SIGNS, families_note(findings), "The paper tests none of these.", *footnotes(paper)),
    )


def published(paper: Paper | None, heads: Sequence[str]) -> tuple[str, ...]:
    """The columns of published figures; none where there is no such paper."""
    return tuple(f"{MARK} {head}" for head in heads) if paper else ()


def footnotes(paper: Paper | None) -> tuple[str, ...]:
    """The note below a table with published figures."""
    return (paper.footnote,) if paper else ()


def _ours(f: Finding) -> tuple[str, ...]:
    return (*arm_cells(f), difference(f), *rank_cells(f))


def _fitness(paper: Paper | None, key: str, columns: int) -> tuple[str, ...]:
    if paper is None:
        return ()
    if (row := paper.fitness.get(key)) is None:
        return (NONE,) * columns
    return (
        spread(*row.proposed),
        spread(*row.baseline),
        probability(row.p),
        probability(row.p_bh),
        effect(row.r),
    )


def _diversity(paper: Paper | None, key: str, columns: int) -> tuple[str, ...]:
    if paper is None:
        return ()
    if (row := paper.diversity.get(key)) is None:
        return (NONE,) * columns
    return number(row.proposed, 3), number(row.baseline, 3), percent(row.difference)


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
        tuple((f.measure.label, *_medians(f), *_pairs(f)) for f in findings),
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


def _medians(f: Finding) -> tuple[str, ...]:
    digits = DIGITS[f.measure.unit]
    first, second = (
        "never" if all(v is None for v in sample) else interval(median_interval(ends), digits)
        for sample, ends in zip(f.samples, f.endless, strict=True)
    )
    apart = bootstrap(f.endless, median_difference)
    return first, second, interval(apart, digits)


def _pairs(f: Finding) -> tuple[str, ...]:
    if (t := f.paired) is None:
        return (NONE,) * 4
    return str(t.pairs), f"{t.lower} : {t.higher}", tested(t), probability(f.paired_q)


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
        rows,
        (
            "By simulation of the exact Mann-Whitney test on normal values that differ by a shift"
            " (4,000 pairs of samples a step, seeded). The second level is the strictest one of"
            " Benjamini and Hochberg's procedure, for the case that nothing else is found. Smaller"
            " differences than these can exist and stay unseen.",
        ),
    )
