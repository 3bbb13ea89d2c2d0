"""Tests of pairs of arms by measures: the plan, its families, and a row per comparison."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from itertools import combinations, product
from math import isnan, nan
from typing import TYPE_CHECKING, Any, Final

import numpy as np

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
    least_p,
    mean_difference,
    mean_sd,
    paired_difference,
    paired_test,
    rank_test,
)

if TYPE_CHECKING:
    from pandas import DataFrame, Series  # type: ignore[import-untyped] # stubs are a package apart

FIRST: Final = "the first two arms"
REST: Final = "other pairs"

Row = Mapping[str, Any]  # a comparison of two arms by a measure: a row of tests.csv


def check_primary(primary: str | None, measures: Sequence[Measure]) -> None:
    """Raises StudyError if the primary endpoint is none of these measures."""
    keys = [measure.key for measure in measures]
    if primary not in (None, *keys):
        raise StudyError(
            f"Expected a measure in --primary, found {primary!r}; there are {', '.join(keys)}."
        )


def examine_all(study: Comparison, measures: Sequence[Measure]) -> DataFrame:
    """The comparisons of all pairs of arms by all measures.

    p-values are adjusted over a family of comparisons. One has the first pair of arms, the other
    all other pairs. Those of measures that are not `main` are adjusted separately.
    """
    from pandas import DataFrame

    rows = []
    for (a, b), measure in product(study.pairs, measures):
        name = FIRST if (a, b) == study.pairs[0] else REST
        shared = [*shared_seeds(a, b)]
        samples = [study.of_arm(arm.name).set_index("seed")[measure.key] for arm in (a, b)]
        pairs = [sample.loc[shared] for sample in samples]
        row = examine(measure, (a.name, b.name), samples, study.horizon, pairs=pairs)
        rows.append({**row, "family": name if measure.main else f"{name}, further"})
    return adjust(DataFrame(rows))


def examine(
    measure: Measure,
    arms: tuple[str, str],
    samples: Sequence[Sequence[float]],
    generations: int,
    *,
    pairs: Sequence[Sequence[float]] = ((), ()),
    enumerated: int = ENUMERATED,
) -> Row:
    """The tests of two samples, with unadjusted p-values.

    Args:
        measure: what the values are.
        arms: names of the arms.
        samples: the values of all runs; nan: censored.
        generations: at which runs are censored: they rank after the last generation.
        pairs: the values of the shared seeds, in the same order in both arms.
        enumerated: as for `rank_test`.
    """
    x, y = (np.nan_to_num(np.asarray(s, float), nan=generations) for s in samples)
    first, second = (np.nan_to_num(np.asarray(s, float), nan=generations) for s in pairs)
    test = rank_test(x, y, enumerated=enumerated)
    paired = paired_test(first, second) if len(first) else None
    censored = [int(np.isnan(np.asarray(sample, float)).sum()) for sample in samples]
    difference = paired_difference(first, second) if paired else mean_difference(x, y)
    if censored == [len(x), len(y)]:
        difference = Interval(nan, nan, nan)
    sides: dict[str, float] = {}
    for side, values, missing in zip(("first", "second"), (x, y), censored, strict=True):
        mean, sd = mean_sd(values)
        figures = {"n": len(values), "mean": mean, "sd": sd, "censored": missing}
        sides |= {f"{name}_{side}": value for name, value in figures.items()}
    return {
        "first": arms[0],
        "second": arms[1],
        "measure": measure.key,
        "label": measure.label,
        "unit": "generations without one" if measure.emergence else measure.unit,
        **sides,
        "difference": difference.estimate,
        "difference_low": difference.low,
        "difference_high": difference.high,
        "U": test.u,
        "p": test.p,
        "kind": test.kind,
        "r": test.r,
        "pairs": paired.pairs if paired else 0,
        "pairs_lower": paired.lower if paired else 0,
        "pairs_higher": paired.higher if paired else 0,
        "paired_p": paired.p if paired else nan,
        "paired_kind": paired.kind if paired else "",
    }


def adjust(rows: DataFrame) -> DataFrame:
    """The rows with p-values adjusted by Benjamini-Hochberg over each `family`, by kind of test."""

    def adjusted(p: Series) -> Series:
        p, tested = p.copy(), p.notna()
        p[tested] = benjamini_hochberg([*p[tested]])
        return p

    families = rows.groupby("family")
    return rows.assign(
        family_size=families["p"].transform("size"),
        p_bh=families["p"].transform(adjusted),
        paired_p_bh=families["paired_p"].transform(adjusted),
    )


def row_of(rows: DataFrame, key: str, arms: tuple[str, str]) -> Row:
    """The row of a measure and a pair of arms, which must exist."""
    found = rows[
        (rows["measure"] == key) & (rows["first"] == arms[0]) & (rows["second"] == arms[1])
    ]
    return dict(found.iloc[0])


def decisive(row: Row) -> tuple[float, float, str]:
    """p, adjusted p and name of the test that decides: of the pairs, if the arms share seeds."""
    if row["pairs"]:
        return row["paired_p"], row["paired_p_bh"], f"signed-rank, {row['pairs']} pairs"
    return row["p"], row["p_bh"], "Mann-Whitney U"


def verdict(row: Row, *, planned: bool = False) -> str:
    """The verdict on two arms, by the adjusted p; by p for a planned endpoint."""
    if isnan(row["difference"]):
        return "never in either arm"
    if row["paired_kind"] == UNTESTED:
        return "equal in every pair"
    p, q, _ = decisive(row)
    if (p if planned else q) < LEVEL:
        return ("lower" if row["difference"] < 0 else "higher") + ", shown"
    least = least_p(row["pairs"]) if row["pairs"] else least_p(row["n_first"], row["n_second"])
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
        runs = study.runs[study.runs["seed"].isin(seeds)]
        values = runs.pivot(index="seed", columns="arm", values=measure.key).fillna(study.horizon)
        for name, change in _effects(study, levels, values):
            low_to_high = paired_difference(change, np.zeros_like(change))
            rows.append(
                {
                    "measure": measure.label,
                    "effect": name,
                    "seeds": len(seeds),
                    "difference": low_to_high.estimate,
                    "difference_low": low_to_high.low,
                    "difference_high": low_to_high.high,
                    "p": paired_test(change, np.zeros_like(change)).p,
                }
            )
    frame = DataFrame(rows)
    return frame.assign(p_bh=benjamini_hochberg([*frame["p"]])) if rows else frame


def _effects(
    study: Comparison, levels: Mapping[str, tuple[str, ...]], values: DataFrame
) -> Iterator[tuple[str, Any]]:
    """The name of each effect, and its number per seed; `values` has a column per arm."""

    def mean(**at: str) -> Any:
        arms = [a.name for a in study.arms if all(a.levels.get(k, "") == v for k, v in at.items())]
        return values[arms].mean(axis=1).to_numpy()

    main = [(key, level) for key, each in levels.items() for level in each[1:]]
    for key, level in main:
        first = levels[key][0]
        name = f"{short_key(key, levels)}: {level} minus {first}"
        yield name, mean(**{key: level}) - mean(**{key: first})
    for (a, x), (b, y) in combinations(main, 2):
        if a != b:
            high, low = (
                mean(**{a: x, b: level}) - mean(**{a: levels[a][0], b: level})
                for level in (y, levels[b][0])
            )
            name = f"{short_key(a, levels)}={x} and {short_key(b, levels)}={y}, interaction"
            yield name, high - low
