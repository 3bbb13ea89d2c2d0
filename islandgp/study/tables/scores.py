"""Mean, median, IQM and probability of improvement of scores, by world and arm."""

from __future__ import annotations

from collections.abc import Sequence
from math import isnan
from typing import Final

from islandgp.statistics import MIN_VALUES
from islandgp.study.aggregates import MIN_PER_WORLD
from islandgp.study.arms import Comparison
from islandgp.study.comparable import paired
from islandgp.study.generalise import Generalisation, champions_by_arm
from islandgp.study.profiles import ALL_WORLDS, ScoreRow, Scores, adjusted, world_rows
from islandgp.study.table import (
    NONE,
    CsvRow,
    Row,
    Table,
    interval,
    interval_values,
    probability,
    tested,
    values_csv,
)
from islandgp.study.texts import note

VALIDATED: Final = "validation mean"
UNSEEN: Final = "mean in unseen worlds"


def champion_scores(study: Comparison, unseen: Sequence[Generalisation]) -> Scores:
    """The scores of the runs' best robots in points, by kind of score and arm, in order of seeds.

    The kinds are the validation mean, unless a run was not validated, and the mean in unseen
    worlds, if there were any.
    """
    scores: dict[str, dict[str, list[float]]] = {}
    means = {arm.name: [run.validation_mean for run in arm.runs] for arm in study.arms}
    if not any(None in values for values in means.values()):
        scores[VALIDATED] = {
            arm: [mean for mean in values if mean is not None] for arm, values in means.items()
        }
    if champions := champions_by_arm(unseen):
        scores[UNSEEN] = {arm: [g.unseen for g in results] for arm, results in champions.items()}
    return scores


def champion_rows(study: Comparison, scores: Scores) -> tuple[ScoreRow, ...]:
    """The scores' rows; the reference is the second arm, the paper's baseline."""
    reference = study.arms[1]
    pairs = {arm.name for arm in study.arms if paired(arm, reference)}
    rows: list[ScoreRow] = []
    for name, arms in scores.items():
        strata = {arm: [values] for arm, values in arms.items()}
        rows += world_rows(name, strata, reference.name, pairs)
    return adjusted(rows)


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
    return Table.of(
        key,
        title,
        (_cells(row, digits[row.world], world) for row in rows),
        note("aggregates", reference=rows[0].reference),
        *_reasons(rows),
        *notes,
    )


def _cells(row: ScoreRow, digits: int, world: str) -> Row:
    yield world, row.world
    yield "arm", row.arm
    yield "runs", str(row.runs)
    yield "mean [95 %]", interval(row.mean, digits)
    yield "median [95 %]", interval(row.median, digits)
    yield "IQM [95 %]", interval(row.iqm, digits)
    better = NONE if row.improvement is None else interval(row.improvement, 2)
    yield f"P(better than {row.reference}) [95 %]", better
    yield "p", NONE if row.test is None else tested(row.test)
    yield "p BH", probability(row.p_bh)


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
        reasons.append(note("few-runs", fewest=MIN_VALUES, world=MIN_PER_WORLD))
    if any(isnan(row.mean.estimate) for row in rows):
        reasons.append(note("no-scale"))
    worlds = list(dict.fromkeys(row.world for row in rows if row.world != ALL_WORLDS))
    cells = {(row.world, row.arm) for row in rows}
    missing_worlds = {
        arm: [world for world in worlds if (world, arm) not in cells]
        for arm in dict.fromkeys(row.arm for row in rows)
    }
    for arm, missing in missing_worlds.items():
        if missing:
            reasons.append(note("lacking", arm=arm, worlds=", ".join(missing)))
    return reasons


def scores_csv(rows: Sequence[ScoreRow], world: str = "world") -> str:
    """The exact numbers of `score_table` as CSV; an empty cell is unknown.

    Args:
        rows: as for `score_table`.
        world: heading of the first column.
    """
    return values_csv(_exact(row, world) for row in rows)


def _exact(row: ScoreRow, world: str) -> CsvRow:
    yield world, row.world
    yield "arm", row.arm
    yield "runs", row.runs
    for name in ("mean", "median", "iqm", "improvement"):
        yield from interval_values(name, getattr(row, name))
    yield "reference", row.reference
    yield "p", row.test and row.test.p
    yield "kind", row.test and row.test.kind
    yield "p_bh", row.p_bh
