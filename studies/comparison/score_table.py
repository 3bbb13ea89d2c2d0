"""Mean, median, IQM and probability of improvement of scores, by world and arm."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from math import isnan
from typing import Final

import pandas as pd  # type: ignore[import-untyped] # its stubs are a package apart

from islandgp.compare.tables import NONE, interval, probability
from studies.comparison.aggregates import MIN_PER_WORLD
from studies.comparison.profiles import ALL_WORLDS, ScoreRow
from studies.pictures import Table
from studies.resampling import MIN_VALUES

AGGREGATES: Final = (
    "IQM: mean of the middle half of the runs (interquartile mean). P(better than {reference}): the"
    " chance that a run of the arm scores higher than one of {reference}, U / (n1 n2), with ties"
    " counted half; over several worlds, it is their mean. Intervals: percentiles of 10,000"
    " bootstrap samples of the runs, stratified by world, seeds drawn as pairs if the arms share"
    " them. p: Mann-Whitney's test, stratified by world, with exchanges within pairs if there are"
    " pairs; p BH: Benjamini-Hochberg over the tests of this table. After Agarwal et al. (2021)."
)
FEW_RUNS: Final = (
    "A dash in brackets: there is no interval for fewer than {fewest} runs, or for several worlds"
    " with fewer than {world} runs in one, as it would cover too little."
)
NO_SCALE: Final = (
    "Over all worlds there are no mean, median and IQM: the worlds' scores have no common scale."
)


def score_table(
    rows: Sequence[ScoreRow],
    *,
    key: str = "scores",
    title: str = "Scores",
    world: str = "World",
    notes: tuple[str, ...] = (),
) -> Table:
    """The rows as a table; unknown values are dashes, with the reason in a note.

    Args:
        rows: at least one, as returned by `summarise`.
        key: file name of the table without extension.
        title: of the table.
        world: heading of the first column.
        notes: further notes below the table.
    """
    digits = {row.world: _digits([r for r in rows if r.world == row.world]) for row in rows}
    return Table(
        key,
        title,
        pd.DataFrame([_cells(row, digits[row.world], world) for row in rows]),
        (AGGREGATES.format(reference=rows[0].reference), *_reasons(rows), *notes),
    )


def _cells(row: ScoreRow, digits: int, world: str) -> Mapping[str, str]:
    better = NONE if row.improvement is None else interval(row.improvement, 2)
    p = NONE if row.test is None else f"{probability(row.test.p)} ({row.test.kind})"
    return {
        world: row.world,
        "arm": row.arm,
        "runs": str(row.runs),
        "mean [95 %]": interval(row.mean, digits),
        "median [95 %]": interval(row.median, digits),
        "IQM [95 %]": interval(row.iqm, digits),
        f"P(better than {row.reference}) [95 %]": better,
        "p": p,
        "p BH": NONE if row.p_bh is None else probability(row.p_bh),
    }


def _digits(rows: Sequence[ScoreRow]) -> int:
    """Decimals that show three significant digits of a world's largest mean; 0 to 3."""
    means = [abs(row.mean.estimate) for row in rows if not isnan(row.mean.estimate)]
    largest = max(means, default=0.0)
    return 0 if largest >= 1000 else 1 if largest >= 100 else 2 if largest >= 10 else 3


def _reasons(rows: Sequence[ScoreRow]) -> list[str]:
    """Notes on cells with a dash."""
    reasons = []
    intervals = [i for row in rows for i in (row.mean, row.improvement) if i is not None]
    if any(isnan(i.low) and not isnan(i.estimate) for i in intervals):
        reasons.append(FEW_RUNS.format(fewest=MIN_VALUES, world=MIN_PER_WORLD))
    if any(isnan(row.mean.estimate) for row in rows):
        reasons.append(NO_SCALE)
    worlds = list(dict.fromkeys(row.world for row in rows if row.world != ALL_WORLDS))
    cells = {(row.world, row.arm) for row in rows}
    missing_worlds = {
        arm: [world for world in worlds if (world, arm) not in cells]
        for arm in dict.fromkeys(row.arm for row in rows)
    }
    for arm, missing in missing_worlds.items():
        if missing:
            reasons.append(
                f"{arm} has no scores in {', '.join(missing)}, so it is not in the rows over all"
                " worlds."
            )
    return reasons


def scores_csv(rows: Sequence[ScoreRow], world: str = "world") -> str:
    """The exact numbers of `score_table` as CSV; an empty cell is unknown.

    Args:
        rows: as for `score_table`.
        world: heading of the first column.
    """
    columns: dict[str, list[object]] = {}
    for row in rows:
        for name, value in _exact(row, world).items():
            columns.setdefault(name, []).append(value)
    return str(pd.DataFrame(columns).to_csv(index=False))


def _exact(row: ScoreRow, world: str) -> Mapping[str, object]:
    values: dict[str, object] = {world: row.world, "arm": row.arm, "runs": row.runs}
    for name in ("mean", "median", "iqm", "improvement"):
        i = getattr(row, name)
        ends = (None, None, None) if i is None else (i.estimate, i.low, i.high)
        values |= dict(zip((name, f"{name}_low", f"{name}_high"), ends, strict=True))
    return {
        **values,
        "reference": row.reference,
        "p": row.test and row.test.p,
        "kind": row.test and row.test.kind,
        "p_bh": row.p_bh,
    }
