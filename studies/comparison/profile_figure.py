"""Performance profiles: the share of runs with a score above each threshold."""

from __future__ import annotations

from math import isnan
from typing import TYPE_CHECKING, Any, Final

import islandgp.compare.figures as drawing
from studies.comparison.aggregates import performance_profile, thresholds
from studies.comparison.profiles import ALL_WORLDS, Scores, arm_names, over_all_worlds
from studies.comparison.strata import Strata
from studies.pictures import Picture, picture
from studies.resampling import MIN_VALUES

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

PANELS: Final = 2  # most panels in a row, for narrow pages
WIDTH: Final = 5.6  # inches; text is readable at a width of 400 pixels
HEIGHT: Final = 2.3  # inches, of a panel
LETTERS: Final = 60  # characters of a line in the legend
BANDS: Final = 4  # most arms with distinguishable bands

CAPTION: Final = (
    "Share of an arm's runs with a score above each value. A higher line is better; a flat part"
    " between two steep ones is a gap between two peaks. Bands, for up to {bands} arms: pointwise"
    " 95 % intervals by a bootstrap of the runs stratified by world; fewer than {fewest} runs have"
    " none."
)

Panels = dict[str, dict[str, Strata]]  # by title and arm


def profile_picture(
    scores: Scores, *, pool: bool = False, label: str = "Score", key: str = "profiles"
) -> Picture:
    """Performance profiles: a panel per world, a line per arm, with 95 % bands for up to four arms.

    Args:
        scores: by world and arm, one per seed.
        pool: a further panel over all worlds, of the arms that have scores in each; scores
            must have one scale in all of them (`profiles.normalised`).
        label: of the x axes.
        key: file name of the picture without extension.

    Raises:
        StudyError: there are no scores, or some are not finite.
    """
    arms = arm_names(scores)
    panels: Panels = {world: {arm: [each[arm]] for arm in each} for world, each in scores.items()}
    if pool and len(scores) > 1:
        panels[ALL_WORLDS] = over_all_worlds(scores)
    panels = {title: strata for title, strata in panels.items() if strata}

    def draw(figure: Figure) -> None:
        grid = drawing.grid(figure, len(panels), PANELS, sharey=True)
        for axes, (title, strata) in zip(grid, panels.items(), strict=True):
            _panel(axes, arms, strata, bands=len(arms) <= BANDS)
            axes.set(title=drawing.plain(title), xlabel=label)
        for axes in grid[::PANELS]:
            axes.set_ylabel("Share of runs above")
        _legend(figure, arms)

    height = HEIGHT * -(-len(panels) // PANELS) + 0.4 + 0.2 * -(-len(arms) // _across(arms))
    caption = CAPTION.format(bands=BANDS, fewest=MIN_VALUES)
    return picture(key, "Performance profiles", caption, draw, height=height, width=WIDTH)


def _panel(axes: Axes, arms: list[str], strata: dict[str, Strata], *, bands: bool) -> None:
    """The profiles of some arms, each with the style of its index among all arms."""
    at = thresholds(*strata.values())
    margin = 0.04 * (at[-1] - at[0]) or max(0.5, 0.04 * abs(at[0]))
    ends = at[0] - margin, at[-1] + margin
    for place, arm in enumerate(arms):
        if arm not in strata:
            continue
        style = drawing.nth_style(place)
        profile = performance_profile(strata[arm], at)
        x = (ends[0], *at, ends[1])
        if bands and not isnan(profile.low[0]):
            axes.fill_between(
                x,
                (1, *profile.low, 0),
                (1, *profile.high, 0),
                step="post",
                color=style["color"],
                alpha=0.15,
                linewidth=0,
            )
        axes.plot(
            x,
            (1, *profile.share, 0),
            drawstyle="steps-post",
            markevery=(0.06 * (1 + place % 4), 0.3),  # in shares of the axes, by turns
            clip_on=False,
            **_line(style),
        )
    axes.set_xlim(*ends)
    axes.set_ylim(-0.03, 1.03)
    largest = max(map(abs, ends))
    axes.locator_params(axis="x", nbins=4 if largest >= 1000 else 5)
    if 1000 <= largest < 1e8:  # larger ones in powers of ten
        axes.xaxis.set_major_formatter(drawing.THOUSANDS)
    axes.yaxis.set_major_formatter(drawing.PERCENT)


def _line(style: dict[str, Any]) -> dict[str, Any]:
    return {
        **style,
        "markersize": 5,
        "markeredgecolor": "white",
        "markeredgewidth": 0.5,
    }


def _legend(figure: Figure, arms: list[str]) -> None:
    from matplotlib.lines import Line2D

    lines = [Line2D([], [], **_line(drawing.nth_style(place))) for place in range(len(arms))]
    figure.legend(
        lines,
        list(map(drawing.plain, arms)),
        loc="outside lower center",
        ncols=_across(arms),
        handlelength=3.4,
    )


def _across(arms: list[str]) -> int:
    """The number of columns of the legend."""
    return max(1, min(4, LETTERS // (max(map(len, arms)) + 7)))
