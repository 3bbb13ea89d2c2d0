"""Summarises scores of several arms in several worlds; works with any scores.

    rows = summarise({"island": {"expert": [...], "random": [...]}, "cartpole": {...}})
    table = score_table(rows)  # score_table
    picture = profile_picture(scores)  # profile_figure

The aggregates are those of `aggregates`. Every arm is compared with a reference arm; the
p-values of all tests are adjusted together.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from math import isfinite, nan
from typing import Final

import numpy as np

from islandgp.errors import StudyError
from islandgp.statistics import Interval, benjamini_hochberg
from studies.comparison.aggregates import (
    ImprovementTest,
    improvement_interval,
    improvement_test,
    interquartile_mean,
    mean,
    median,
    stratified_bootstrap,
)
from studies.comparison.strata import Strata

Scores = Mapping[str, Mapping[str, Sequence[float]]]
"""Scores by world and arm, one per seed; higher is better."""

ALL_WORLDS: Final = "all worlds"
UNKNOWN: Final = Interval(nan, nan, nan)


@dataclass(frozen=True, slots=True)
class ScoreRow:
    """An arm's scores in a world, or in all worlds; intervals are of 95 %."""

    world: str
    arm: str
    runs: int
    mean: Interval  # mean, median and IQM are nan over worlds that are not pooled
    median: Interval
    iqm: Interval
    reference: str  # the arm with which it is compared; may be itself
    improvement: Interval | None = None  # probability to score higher; None: no comparison
    test: ImprovementTest | None = None  # of the probability against one half
    p_bh: float | None = None  # its p, adjusted over all tests of the table


def summarise(
    scores: Scores, *, reference: str | None = None, paired: bool = False, pool: bool = False
) -> tuple[ScoreRow, ...]:
    """Mean, median, IQM and probability of improvement of each arm, by world and over all worlds.

    Rows are in the order of the worlds; if there are several, rows over all worlds follow, for arms
    with scores in each. p-values are adjusted over all rows by Benjamini-Hochberg.

    Args:
        scores: by world and arm, one per seed. An arm may lack a world.
        reference: the arm with which the others are compared; default: the first arm.
        paired: the k-th scores of all arms in a world are of one seed.
        pool: aggregate mean, median and IQM over all worlds too. Scores must then have one
            scale in all of them, for which `normalised` serves. The probability of improvement
            needs no common scale.

    Raises:
        StudyError: there are no scores, some are not finite, the reference is unknown, or arms
            that are paired have unequal numbers of scores.
    """
    arms = arm_names(scores)
    against = arms[0] if reference is None else reference
    if against not in arms:
        raise StudyError(
            f"Expected a reference among the arms {', '.join(arms)}, found {against!r}."
        )
    pairs = frozenset(arms if paired else ())
    rows: list[ScoreRow] = []
    for world, each in scores.items():
        rows += world_rows(world, {arm: [each[arm]] for arm in each}, against, pairs)
    if len(scores) > 1:
        rows += world_rows(ALL_WORLDS, over_all_worlds(scores), against, pairs, pool=pool)
    return adjusted(rows)


def over_all_worlds(scores: Scores) -> dict[str, Strata]:
    """The scores of the arms that have some in each world, by arm."""
    worlds = [*scores.values()]
    return {
        arm: [each[arm] for each in worlds]
        for arm in arm_names(scores)
        if all(arm in each for each in worlds)
    }


def world_rows(
    world: str,
    arms: Mapping[str, Strata],
    reference: str,
    paired: Collection[str],
    *,
    pool: bool = True,
) -> Iterator[ScoreRow]:
    """A row for each arm, before p-values are adjusted.

    Args:
        world: name of the rows.
        arms: scores of each arm, world by world.
        reference: the arm with which the others are compared, if it is one of them.
        paired: arms whose scores have the seeds of the reference's scores, in the same order.
        pool: True: with mean, median and IQM.

    Raises:
        StudyError: scores are missing or not finite, or a score has no pair.
    """
    for arm, strata in arms.items():
        with _naming(arm, world):
            average, middle, iqm = (
                stratified_bootstrap(strata, statistic) if pool else UNKNOWN
                for statistic in (mean, median, interquartile_mean)
            )
            row = ScoreRow(world, arm, sum(map(len, strata)), average, middle, iqm, reference)
            if arm != reference and reference in arms:
                other, pairs = arms[reference], arm in paired
                row = replace(
                    row,
                    improvement=improvement_interval(strata, other, paired=pairs),
                    test=improvement_test(strata, other, paired=pairs),
                )
        yield row


@contextmanager
def _naming(arm: str, world: str) -> Iterator[None]:
    """Context in which errors name the arm and the world."""
    try:
        yield
    except StudyError as error:
        raise StudyError(f"{arm} in {world}: {error}") from error


def adjusted(rows: Sequence[ScoreRow]) -> tuple[ScoreRow, ...]:
    """The rows with p-values adjusted over all tests by Benjamini-Hochberg."""
    adjusted_p = iter(benjamini_hochberg([row.test.p for row in rows if row.test is not None]))
    return tuple(row if row.test is None else replace(row, p_bh=next(adjusted_p)) for row in rows)


def normalised(
    scores: Scores, bounds: Mapping[str, tuple[float, float]]
) -> dict[str, dict[str, list[float]]]:
    """The scores on a common scale: in each world, 0 is the first bound and 1 the second.

    Args:
        scores: by world and arm.
        bounds: by world, e.g. the mean scores of random and of hand-written trees.

    Raises:
        StudyError: a world has no bounds, or they are not two finite and different numbers.
    """
    by_world: dict[str, dict[str, list[float]]] = {}
    for world, arms in scores.items():
        low, high = bounds.get(world, (nan, nan))
        if not (isfinite(low) and isfinite(high) and low != high):
            raise StudyError(
                f"Expected two finite and different bounds for {world}, found"
                f" {bounds.get(world, 'none')}; give the scores that are to become 0 and 1."
            )
        by_world[world] = {
            arm: ((np.asarray(values, float) - low) / (high - low)).tolist()
            for arm, values in arms.items()
        }
    return by_world


def arm_names(scores: Scores) -> list[str]:
    """The arms in order of their first occurrence. Raises StudyError if there are none."""
    if not all(isinstance(each, Mapping) for each in scores.values()):
        raise StudyError(
            "Expected scores by world and arm, found a world without arms; give"
            " {world: {arm: [score, ...]}}."
        )
    arms = list(dict.fromkeys(arm for each in scores.values() for arm in each))
    for name in (*scores, *arms):
        if not isinstance(name, str):
            raise StudyError(f"Expected names of worlds and arms as text, found {name!r}.")
    if not arms:
        raise StudyError("Expected scores by world and arm, found none; give some.")
    if len(scores) > 1 and ALL_WORLDS in scores:
        raise StudyError(
            f"Expected another name than {ALL_WORLDS!r} for a world, since rows over all worlds"
            " are called so; rename it."
        )
    return arms
