"""Tables that compare two arms by several measures: Tables 9 to 12, medians, power."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence

from islandgp.statistics import (
    LEVEL,
    MIN_VALUES,
    bootstrap,
    mean_sd,
    median_difference,
    median_interval,
    smallest_difference,
)
from islandgp.study.arms import Arm, Comparison
from islandgp.study.emergence import EmergenceSummary, first, reduction, summary
from islandgp.study.findings import Finding
from islandgp.study.measures import Measure, all_measures
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
from islandgp.study.texts import note
from islandgp.text import title


def families_note(findings: Sequence[Finding]) -> str:
    """A note on the families in which p-values are adjusted."""
    families = {(f.family, f.size): [g for g in findings if g.family == f.family] for f in findings}
    each = []
    for (name, size), members in families.items():
        labels = f" ({', '.join(f.measure.label for f in members)})" if len(families) > 1 else ""
        each.append(f"'{name}', {size} comparisons{labels}")
    return f"p BH: Benjamini-Hochberg over the family {'; '.join(each)}."


def difference(f: Finding) -> str:
    """The relative difference of the means, or the absolute one if a share has no meaning."""
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


def _result_cells(f: Finding) -> Row:
    """Mean and deviation of each arm, and their difference."""
    for arm, sample in zip(f.arms, f.numbers, strict=True):
        yield arm, spread(*mean_sd(sample), DIGITS[f.measure.unit])
    yield "difference", difference(f)
    yield from rank_cells(f)


def by_pair(
    study: Comparison, findings: Sequence[Finding], measures: Sequence[Measure]
) -> Iterator[tuple[str, str, list[Finding]]]:
    """For each pair of arms: suffixes of a table's key and title, and the findings of measures."""
    keys, has_several_pairs = {m.key for m in measures}, len(study.pairs) > 1
    for a, b in ((a.name, b.name) for a, b in study.pairs):
        selected = [f for f in findings if f.arms == (a, b) and f.measure.key in keys]
        yield *((f"-{a}-{b}", f": {a} against {b}") if has_several_pairs else ("", "")), selected


def paper_tables(
    study: Comparison,
    findings: Sequence[Finding],
    key: str,
    title: str,
    measures: Sequence[Measure],
    row: Callable[[Finding], Row],
    *notes: str,
) -> Iterator[Table]:
    """One of Tables 9 to 12 for each pair of arms; `row` creates the row of a measure."""
    for end, of, selected in by_pair(study, findings, measures):
        more = [note("censored")] if any(f.censored for f in selected) else []
        yield Table.of(
            f"{key}{end}",
            f"{title}{of}",
            map(row, selected),
            note("signs"),
            families_note(selected),
            *notes,
            *more,
        )


def fitness_row(f: Finding) -> Row:
    """Cells of Tables 9 and 10."""
    yield "Metric", f.measure.label
    yield from _result_cells(f)


def diversity_row(f: Finding) -> Row:
    """Cells of Table 12, with tests that the paper does not have."""
    yield "Measure", f.measure.label
    yield from _result_cells(f)


def emergence_row(f: Finding) -> Row:
    """Cells of Table 11, section 3.4: the generation of the first robot of a milestone."""
    first, second = (summary(sample, f.generations) for sample in f.samples)
    earlier = reduction(first, second)
    share = NONE if earlier is None else f"{percent(earlier[0]).lstrip('+')} ({earlier[1]})"
    a, b = f.arms
    yield "Tier", f.measure.label
    yield a, time_cell(first)
    yield b, time_cell(second)
    yield f"without one, {a}", without(first)
    yield f"without one, {b}", without(second)
    yield "difference without one [95 %]", interval(f.shift, 1)
    yield "earlier by", share
    yield "hazard ratio [95 %]", interval(f.hazard, 2)
    yield from rank_cells(f)
    yield "log-rank p", probability(f.log_rank)
    yield "log-rank p BH", probability(f.log_rank_q)


def time_cell(s: EmergenceSummary) -> str:
    """An arm's time to emergence in a cell."""
    if s.never:
        return f"never in {s.runs} runs"
    if s.mean is not None and s.sd is not None:
        return f"{spread(s.mean, s.sd, 1)}, median {number(s.median, 1)}"
    middle = "not reached" if s.median is None else number(s.median, 1)
    return f"median {middle}, {s.emerged} of {s.runs} runs"


def without(s: EmergenceSummary) -> str:
    """The mean number of generations without one; "all" of them if there never was one."""
    return f"all {s.watched:g}" if s.never else number(s.watched, 1)


def runs_table(study: Comparison) -> Table:
    """Table 11: the generation of the first robot of each milestone in each run."""
    tiers = study.milestones
    names = " and the first ".join(map(title, tiers))
    rows = [
        [
            ("Seed", str(seed)),
            *((f"{a.name}: {title(t)}", _firsts(a, seed, t)) for a in study.arms for t in tiers),
        ]
        for seed in sorted({seed for arm in study.arms for seed in arm.seeds})
    ]
    return Table.of(
        "table-11-runs",
        f"Table 11. Generation of the first {names} {study.classes.agent}, run by run",
        rows,
        note("firsts", last=study.generations - 1),
    )


def _firsts(arm: Arm, seed: int, tier: str) -> str:
    generations = [first(run, tier) for run in arm.runs if run.seed == seed]
    return ", ".join("never" if g is None else str(g) for g in generations) or NONE


def median_tables(study: Comparison, findings: Sequence[Finding]) -> Iterator[Table]:
    """Medians with bootstrap intervals, and the tests seed by seed, for each pair of arms."""
    for end, of, selected in by_pair(study, findings, all_measures(study)):
        yield Table.of(
            f"medians{end}",
            f"Medians, intervals and paired tests{of}",
            ([("Measure", f.measure.label), *_medians(f), *_pairs(f)] for f in selected),
            note("medians", fewest=MIN_VALUES),
            note("pairs"),
        )


def _medians(f: Finding) -> Row:
    digits = DIGITS[f.measure.unit]
    for arm, sample, ends in zip(f.arms, f.samples, f.endless, strict=True):
        is_unreached = all(v is None for v in sample)
        middle = "never" if is_unreached else interval(median_interval(ends), digits)
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
    """The smallest differences that tests with so many runs can detect."""
    rows = (
        _power(n1, n2, label, level)
        for n1, n2 in dict.fromkeys((len(a.runs), len(b.runs)) for a, b in study.pairs)
        for label, level in ((f"{LEVEL:g}", LEVEL), (f"{LEVEL:g} / {family}", LEVEL / family))
    )
    heading = "Smallest difference that is found with 80 % power"
    return Table.of("power", heading, rows, note("power"))


def _power(n1: int, n2: int, label: str, level: float) -> Row:
    p = smallest_difference(n1, n2, level)
    better = NONE if p.superiority is None else f"{p.superiority:.0%}"
    yield "Runs", f"{n1} and {n2}"
    yield "level of one test", label
    yield "shift (SD)", "none" if p.shift is None else number(p.shift, 2)
    yield "chance that the better arm's run is better", better
    yield "|r|", number(p.r, 2)
    yield "least p possible", probability(p.least_p)
