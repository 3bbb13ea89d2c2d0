"""Tests of pairs of arms by measures: the plan, its families, and a row per comparison."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import combinations, product
from math import inf, isfinite, isnan, nan
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from islandgp.compare.arms import Arm
from islandgp.compare.comparable import Comparison, shared_seeds
from islandgp.compare.measures import Measure
from islandgp.errors import StudyError
from islandgp.records.parameters import short_key
from islandgp.statistics import (
    ENUMERATED,
    LEVEL,
    UNTESTED,
    Interval,
    benjamini_hochberg,
    log_rank,
    mean_difference,
    mean_sd,
    paired_difference,
    paired_test,
    rank_test,
    smallest_difference,
)

if TYPE_CHECKING:
    from pandas import DataFrame  # type: ignore[import-untyped] # its stubs are a package apart

FIRST: Final = "the first two arms"
REST: Final = "other pairs"

Sample = Sequence[float | None]
"""The values of an arm's runs; None: censored."""
Row = Mapping[str, Any]
"""A comparison of two arms by a measure: a row of tests.csv."""


@dataclass(frozen=True, slots=True)
class AnalysisPlan:
    """The analysis plan, by the options of the command."""

    families: Mapping[str, tuple[str, ...]] = field(default_factory=dict)  # arms by family
    primary: str | None = None  # key of the measure that is the primary endpoint
    margins: Mapping[str, float] = field(default_factory=dict)  # by measure, in its unit, > 0


DEFAULT_PLAN: Final = AnalysisPlan()
"""The default plan."""


def parse_family(text: str) -> tuple[str, tuple[str, ...]]:
    """Parses NAME=arm,arm,... Raises StudyError for other texts."""
    name, _, rest = text.partition("=")
    arms = tuple(dict.fromkeys(arm.strip() for arm in rest.split(",") if arm.strip()))
    if not name.strip() or len(arms) < 2:
        raise StudyError(
            f"Expected --family NAME=ARM,ARM,... with two arms or more, found {text!r};"
            " for instance --family judgement=expert,blind,trees."
        )
    return name.strip(), arms


def parse_margin(text: str) -> tuple[str, float]:
    """Parses MEASURE=VALUE. Raises StudyError for other texts."""
    name, _, rest = text.partition("=")
    try:
        value = float(rest)
    except ValueError:
        value = 0.0
    if not name.strip() or not isfinite(value) or value <= 0:
        raise StudyError(
            f"Expected --margin MEASURE=VALUE with a value above 0, found {text!r};"
            " for instance --margin mean_max=2500."
        )
    return name.strip(), value


def parse_plan(
    families: Sequence[str], primary: str | None, margins: Sequence[str]
) -> AnalysisPlan:
    """Parses the options of a plan. Raises StudyError if one is not valid."""
    named = list(map(parse_family, families))
    bounds = list(map(parse_margin, margins))
    for option, keys in (("family", [n for n, _ in named]), ("margin", [m for m, _ in bounds])):
        if twice := [key for key in dict.fromkeys(keys) if keys.count(key) > 1]:
            raise StudyError(f"Expected each {option} once, found {twice[0]} twice; leave one out.")
    if {FIRST, REST} & set(dict(named)):
        raise StudyError(
            f"Expected other names for families than {FIRST!r} and {REST!r}, which are taken;"
            " choose another name."
        )
    return AnalysisPlan(dict(named), primary, dict(bounds))


def check_plan(plan: AnalysisPlan, study: Comparison, keys: Sequence[str]) -> None:
    """Raises StudyError if an arm of a plan does not exist, or a measure is not in `keys`."""
    for name, members in plan.families.items():
        for arm in members:
            if arm not in study.names:
                raise StudyError(
                    f"Expected arms of this comparison in --family {name}, found {arm!r};"
                    f" there are {', '.join(study.names)}."
                )
    named = [("--primary", plan.primary)] if plan.primary is not None else []
    named += [("--margin", key) for key in plan.margins]
    for place, key in named:
        if key not in keys:
            raise StudyError(
                f"Expected a measure in {place}, found {key!r}; there are {', '.join(keys)}."
            )
    families(study, plan)


def families(study: Comparison, plan: AnalysisPlan) -> dict[str, tuple[tuple[Arm, Arm], ...]]:
    """The pairs of arms whose p-values are adjusted together, by family.

    The first family is the first pair. The plan's families follow; a pair belongs to the first
    one with both arms. The last family has all other pairs.

    Raises:
        StudyError: all pairs of a family are in earlier families.
    """
    first, *remaining = study.pairs
    result: dict[str, tuple[tuple[Arm, Arm], ...]] = {FIRST: (first,)}
    for name, arms in plan.families.items():
        pairs = tuple(pair for pair in remaining if {a.name for a in pair} <= set(arms))
        if not pairs:
            raise StudyError(
                f"Expected pairs of arms in --family {name} that are in no family before it, found"
                " none; the first pair of arms is a family by itself."
            )
        result[name] = pairs
        remaining = [pair for pair in remaining if pair not in pairs]
    return {**result, REST: tuple(remaining)} if remaining else result


def examine_all(study: Comparison, plan: AnalysisPlan, measures: Sequence[Measure]) -> list[Row]:
    """The comparisons of all pairs of arms by all measures, family by family.

    With margins, the families after the first have the measures with margins only. The p-values
    of other measures, and of those that are not `main`, are adjusted separately.
    """
    rows: list[Row] = []
    for name, pairs in families(study, plan).items():
        keys = {m.key for m in measures if m.main}
        if plan.margins and name != FIRST:
            keys = {*plan.margins}
        inside = [m for m in measures if m.key in keys]
        further = [m for m in measures if m.key not in keys]
        for family, group in ((name, inside), (f"{name}, further", further)):
            found = [row for a, b in pairs for row in _compared(study, a, b, group)]
            rows += adjust(found, family)
    return rows


def _compared(study: Comparison, a: Arm, b: Arm, measures: Sequence[Measure]) -> Iterator[Row]:
    """The row of each measure for a pair of arms."""
    shared = set(shared_seeds(a, b))
    for measure in measures:
        samples = [measure.of(run) for run in a.runs], [measure.of(run) for run in b.runs]
        pairs = [[measure.of(run) for run in arm.runs if run.seed in shared] for arm in (a, b)]
        yield examine(measure, (a.name, b.name), samples, study.generations, pairs=pairs)


def examine(
    measure: Measure,
    arms: tuple[str, str],
    samples: tuple[Sample, Sample],
    generations: int,
    *,
    pairs: Sequence[Sample] = ((), ()),
    enumerated: int = ENUMERATED,
) -> Row:
    """The tests of two samples, with unadjusted p-values.

    Args:
        measure: what the values are.
        arms: names of the arms.
        samples: the values of all runs.
        generations: at which runs are censored.
        pairs: the values of the shared seeds, in the same order in both arms.
        enumerated: as for `rank_test`.
    """
    x, y = (ranks(sample, generations) for sample in samples)
    test = rank_test(x, y, enumerated=enumerated)
    first, second = (ranks(sample, generations) for sample in pairs)
    paired = paired_test(first, second) if first else None
    censored = [sum(v is None for v in sample) for sample in samples]
    never = censored == [len(x), len(y)]
    logs = log_rank(*samples, horizon=generations) if measure.emergence else None
    difference = paired_difference(first, second) if paired else mean_difference(x, y)
    if never:
        difference = Interval(nan, nan, nan)
    (mean_x, sd_x), (mean_y, sd_y) = mean_sd(x), mean_sd(y)
    return {
        "first": arms[0],
        "second": arms[1],
        "measure": measure.key,
        "label": measure.label,
        "unit": "generations without one" if measure.emergence else measure.unit,
        **_two("n", len(x), len(y)),
        **_two("mean", mean_x, mean_y),
        **_two("sd", sd_x, sd_y),
        **_two("median", *(_median(sample) for sample in samples)),
        **_two("censored", *censored),
        "difference": difference.estimate,
        "difference_low": difference.low,
        "difference_high": difference.high,
        "U": test.u,
        "z": test.z,
        "p": test.p,
        "kind": test.kind,
        "p_bh": test.p,
        "r": test.r,
        "pairs": paired and paired.pairs,
        "pairs_lower": paired and paired.lower,
        "pairs_higher": paired and paired.higher,
        "paired_p": paired and paired.p,
        "paired_kind": paired and paired.kind,
        "paired_p_bh": paired and paired.p,
        "log_rank_p": logs,
        "log_rank_p_bh": logs,
    }


def ranks(sample: Sample, generations: int) -> list[float]:
    """Values for a rank test; a censored run ranks after the last generation."""
    return [float(generations if v is None else v) for v in sample]


def _median(sample: Sample) -> float:
    """The median; a censored run is infinite."""
    return float(np.median([inf if v is None else v for v in sample]))


def _two(name: str, first: object, second: object) -> dict[str, object]:
    return {f"{name}_first": first, f"{name}_second": second}


def adjust(rows: Sequence[Row], family: str = "") -> list[Row]:
    """The rows with p-values adjusted by Benjamini-Hochberg over the family, by kind of test."""
    adjusted = [{**row, "family": family, "family_size": len(rows)} for row in rows]
    for p, q in (("p", "p_bh"), ("paired_p", "paired_p_bh"), ("log_rank_p", "log_rank_p_bh")):
        tested = [row for row in adjusted if row[p] is not None]
        for row, value in zip(tested, benjamini_hochberg([r[p] for r in tested]), strict=True):
            row[q] = value
    return [*adjusted]


def finding(rows: Sequence[Row], key: str, arms: tuple[str, str]) -> Row:
    """The row of a measure and a pair of arms. Raises StopIteration if there is none."""
    return next(r for r in rows if r["measure"] == key and (r["first"], r["second"]) == arms)


def decisive(row: Row) -> tuple[float, float, str]:
    """p, adjusted p and name of the test that decides: of the pairs, if the arms share seeds."""
    if row["pairs"]:
        return row["paired_p"], row["paired_p_bh"], f"signed-rank, {row['pairs']} pairs"
    return row["p"], row["p_bh"], "Mann-Whitney U"


def least_p(row: Row) -> float:
    """The smallest p that the deciding test can have with so many runs."""
    if row["pairs"]:
        return min(1.0, 2.0 / 2.0 ** int(row["pairs"]))
    return smallest_difference(row["n_first"], row["n_second"]).least_p


def verdict(row: Row, margin: float | None = None, *, planned: bool = False) -> str:
    """The verdict on two arms, by the adjusted p; by p for a planned endpoint."""
    if isnan(row["difference"]):
        return "never in either arm"
    if row["paired_kind"] == UNTESTED:
        return "equal in every pair"
    p, q, _ = decisive(row)
    low, high = row["difference_low"], row["difference_high"]
    alike = margin is not None and not isnan(low) and -margin < low <= high < margin
    within = f"alike within ±{margin:,g}" if alike else ""
    if (p if planned else q) < LEVEL:
        side = "lower" if row["difference"] < 0 else "higher"
        return f"{side}, shown" + (f", but {within}" if within else "")
    if within:
        return within
    least = least_p(row)
    return "not shown" if least < LEVEL else f"not shown: too few runs (least p {least:.2g})"


# Main effects and interactions of a factorial sweep.


def factors(study: Comparison) -> dict[str, tuple[str, ...]]:
    """The levels of each key in which the arms differ; {} if they are not all combinations."""
    levels = {
        key: tuple(dict.fromkeys(arm.levels.get(key, "") for arm in study.arms))
        for key in sorted({key for arm in study.arms for key in arm.levels})
    }
    levels = {key: values for key, values in levels.items() if len(values) > 1}
    cells = {tuple(arm.levels.get(key, "") for key in levels) for arm in study.arms}
    is_full = cells == set(product(*levels.values())) and len(cells) == len(study.arms)
    return levels if is_full else {}


def effects(study: Comparison, measures: Sequence[Measure]) -> DataFrame:
    """Main effects of the factors and interactions of two of them, over the shared seeds.

    A main effect is the mean of the arms with a level minus that of the arms with the first level
    of the factor; an interaction of two levels with two others is the difference of two such
    differences. Each is a number per seed, tested by the signed-rank test.

    Returns:
        A row per measure and effect; no rows if the arms are not all combinations of two or more
        factors, or share fewer than two seeds.
    """
    from pandas import DataFrame

    levels = factors(study)
    seeds = set.intersection(*({*shared_seeds(study.arms[0], arm)} for arm in study.arms))
    rows: list[dict[str, Any]] = []
    for measure in measures if len(levels) > 1 and len(seeds) > 1 else ():
        values = {
            arm.name: np.array(
                ranks([measure.of(r) for r in arm.runs if r.seed in seeds], study.generations)
            )
            for arm in study.arms
        }
        for name, contrast in _contrasts(levels):
            weights = {arm.name: contrast(arm.levels) for arm in study.arms}
            above, below = (
                sum(abs(w) * values[a] for a, w in weights.items() if w * sign > 0)
                for sign in (1, -1)
            )
            test, difference = paired_test(above, below), paired_difference(above, below)
            rows.append(
                {
                    "measure": measure.label,
                    "effect": name,
                    "seeds": len(seeds),
                    "difference": difference.estimate,
                    "difference_low": difference.low,
                    "difference_high": difference.high,
                    "p": test.p,
                }
            )
    frame = DataFrame(rows)
    if rows:
        frame["p_bh"] = benjamini_hochberg(list(frame["p"]))
    return frame


def _contrasts(levels: Mapping[str, tuple[str, ...]]) -> Iterator[tuple[str, Any]]:
    """The name of each effect, and the weight of an arm in it by the arm's levels."""
    arms = np.prod([len(values) for values in levels.values()])
    share = {key: len(values) / arms for key, values in levels.items()}  # of an arm in a level

    def of(key: str, level: str, at: Mapping[str, str]) -> int:
        return (at.get(key, "") == level) - (at.get(key, "") == levels[key][0])

    main = [(key, level) for key, values in levels.items() for level in values[1:]]
    for key, level in main:
        name = f"{short_key(key, levels)}: {level} minus {levels[key][0]}"
        yield name, lambda at, k=key, v=level: share[k] * of(k, v, at)
    for (a, x), (b, y) in combinations(main, 2):
        if a != b:
            name = f"{short_key(a, levels)}={x} and {short_key(b, levels)}={y}, interaction"
            both = share[a] * len(levels[b])
            yield (
                name,
                lambda at, a=a, x=x, b=b, y=y, w=both: w * of(a, x, at) * of(b, y, at),
            )
