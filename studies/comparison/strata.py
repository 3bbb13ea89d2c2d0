"""Scores of an arm world by world ("strata"): checked, rounded and sorted."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Final

import numpy as np

from islandgp.errors import StudyError, brief
from islandgp.statistics import DECIMALS

Strata = Sequence[Sequence[float]]
"""An arm's scores, one sequence per world."""

MAX_SCORES: Final = 10_000  # most scores of an arm in a world
MAX_SCORE: Final = 1e100  # largest absolute value of a score, so that sums are finite


def in_worlds(first: Strata, second: Strata, *, paired: bool = False) -> list[tuple[Any, Any]]:
    """Both arms' scores in each world, sorted: as pairs if `paired`, else independently.

    They are rounded to DECIMALS, as in `rank_test`.
    """
    first_arrays, second_arrays = arrays_of(first), arrays_of(second)
    if len(first_arrays) != len(second_arrays):
        raise StudyError(
            f"Expected scores of both arms in the same worlds, found {len(first_arrays)} worlds and"
            f" {len(second_arrays)}; leave out worlds that one of them lacks."
        )
    worlds = []
    for a, b in zip(first_arrays, second_arrays, strict=True):
        x, y = np.round(a, DECIMALS), np.round(b, DECIMALS)
        if paired and len(x) != len(y):
            raise StudyError(
                f"Expected as many scores of both arms where they are paired, found {len(x)} and"
                f" {len(y)}; give those of the same seeds, or compare without pairs."
            )
        order = np.lexsort((y, x)) if paired else None
        worlds.append((np.sort(x), np.sort(y)) if order is None else (x[order], y[order]))
    return worlds


def arrays_of(strata: Strata) -> list[Any]:
    """The scores as arrays. Raises StudyError for invalid scores."""
    try:
        arrays = [np.asarray(each, float) for each in strata]
    except (TypeError, ValueError) as error:
        raise StudyError(
            f"Expected scores as lists of numbers, found others ({brief(error)}); give one number a"
            " run."
        ) from error
    if not arrays:
        raise StudyError("Expected scores of at least one world, found none; give some.")
    for values in arrays:
        if values.ndim != 1 or not 0 < len(values) <= MAX_SCORES:
            raise StudyError(
                f"Expected 1 to {MAX_SCORES:,} scores of an arm in a world, found an array of"
                f" shape {values.shape}; give one number a run."
            )
        wrong = ~(np.abs(values) <= MAX_SCORE)
        if np.any(wrong):
            raise StudyError(
                f"Expected finite scores of at most {MAX_SCORE:g}, found"
                f" {first_values(values[wrong])}; a run that failed needs a score, or must be left"
                " out in all arms."
            )
    return arrays


def first_values(values: Any) -> str:
    """The first three numbers."""
    return ", ".join(f"{value:g}" for value in values[:3]) + (", ..." if len(values) > 3 else "")
