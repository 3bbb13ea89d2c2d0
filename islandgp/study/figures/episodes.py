"""Curves by episodes, instead of generations."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from operator import attrgetter
from typing import TYPE_CHECKING, Final

import numpy as np

from islandgp.scoring.generation_stats import GenerationStats
from islandgp.study.arms import Arm, Comparison
from islandgp.study.emergence import first
from islandgp.study.episodes import episodes_until
from islandgp.study.figures import drawing
from islandgp.study.measures import best, diversity

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

COLUMNS: Final = 2
HEIGHT: Final = 2.6  # inches, of a panel

CURVES: Final[tuple[tuple[str, Callable[[GenerationStats], float], str], ...]] = (
    ("Best fitness of a generation", best, "Points"),
    ("Behavioural diversity", diversity, "Eq. (3)"),
    ("Mutation rate", attrgetter("rate"), "Rate"),
)
"""Title, value and y axis of each panel of means."""


def by_episodes(study: Comparison) -> drawing.Picture:
    """Fitness, diversity, mutation rate and first robots by episodes."""
    n = len(CURVES) + len(study.milestones)

    def draw(figure: Figure) -> None:
        grid = drawing.grid(figure, n, COLUMNS)
        for axes, (name, of, label) in zip(grid, CURVES, strict=False):
            for arm, style in drawing.arm_styles(study):
                drawing.band(axes, arm, style, *at_episodes(arm, of))
            axes.set(title=name, ylabel=label)
        for axes, tier in zip(grid[len(CURVES) :], study.milestones, strict=False):
            _emergence(axes, study, tier)
        for axes in grid:
            axes.set_xlim(left=0)
            axes.set_xlabel("Episodes", loc="right")
            axes.locator_params(axis="x", nbins=5)
            axes.xaxis.set_major_formatter(drawing.THOUSANDS)
        grid[0].yaxis.set_major_formatter(drawing.THOUSANDS)
        drawing.legend(figure, grid[0])

    return drawing.picture("episodes", draw, height=0.4 + HEIGHT * -(-n // COLUMNS))


def at_episodes(
    arm: Arm, of: Callable[[GenerationStats], float]
) -> tuple[Sequence[float], list[list[float]]]:
    """A value of the last finished generation, by number of episodes.

    Args:
        arm: its runs may have different numbers of episodes per generation.
        of: returns the value of a generation.

    Returns:
        Rising numbers of episodes, within the range of all runs; and the values of each run there.
    """
    each = [(episodes_until(run), [of(s) for s in run.snapshots]) for run in arm.runs]
    start, end = max(x[0] for x, _ in each), min(x[-1] for x, _ in each)
    places = np.unique(np.concatenate([x for x, _ in each]))
    places = places[(start <= places) & (places <= end)]
    rows = [
        np.asarray(y, float)[np.searchsorted(x, places, side="right") - 1].tolist() for x, y in each
    ]
    return places.tolist(), rows


def _emergence(axes: Axes, study: Comparison, tier: str) -> None:
    """The share of each arm's runs that have had a robot of a tier."""
    for arm, style in drawing.arm_styles(study):
        until = [episodes_until(run) for run in arm.runs]
        end = min(x[-1] for x in until)  # all runs have at least so many episodes
        firsts = [first(run, tier) for run in arm.runs]
        at = sorted(x[g] for x, g in zip(until, firsts, strict=True) if g is not None)
        steps = [episodes for episodes in at if episodes <= end]
        axes.plot(
            [0, *steps, end],
            [k / len(until) for k in (*range(len(steps) + 1), len(steps))],
            drawstyle="steps-post",
            color=style.colour,
            linestyle=style.line,
            marker=style.marker,
            markersize=4,
            markevery=(0.1, 0.3),
        )
    axes.set_ylim(-0.03, 1.03)
    axes.yaxis.set_major_formatter(drawing.PERCENT)
    axes.set(title=study.classes.tier_title(tier), ylabel="Runs that have had one")
