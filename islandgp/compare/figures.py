"""Figures of a report: curves over generations and episodes, first robots, best robots.

Arms differ in colour, line style and marker, so that figures are readable in grey and by
colour-blind readers.
"""

from __future__ import annotations

import io
import textwrap
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from islandgp.compare.comparable import Comparison
from islandgp.scoring.curriculum import Curriculum
from islandgp.statistics import mean_interval

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from pandas import DataFrame  # type: ignore[import-untyped] # its stubs are a package apart

PALETTE: Final = (
    *("#0072B2", "#D55E00", "#009E73", "#CC79A7"),
    *("#E69F00", "#56B4E9", "#555555", "#BBBBBB"),
)
"""Okabe and Ito's palette, ordered by lightness."""
LINES: Final[tuple[str | tuple[int, tuple[float, ...]], ...]] = (
    *("-", "--", "-.", ":"),
    *((0, (9, 2)), (0, (6, 1, 1, 1, 1, 1)), (0, (1.5, 0.8)), (0, (9, 1, 3, 1))),
)
MARKERS: Final = ("o", "s", "^", "D", "v", "P", "X", "*")
WIDTH: Final = 7.2  # text width of a page, inches
LETTERS: Final = 110  # characters of a line in a legend
COLUMNS: Final = 2  # panels in a row
HEIGHT: Final = 2.6  # of a panel, inches
STYLE: Final = Path(__file__).with_name("report.mplstyle")
THOUSANDS: Final = "{x:,.0f}"  # formats of ticks: 30,000
PERCENT: Final = "{x:.0%}"


def nth_style(i: int) -> dict[str, Any]:
    """Colour, line style and marker of the i-th arm in all figures; 64 are distinct."""
    repetition = i // len(PALETTE)  # number of earlier styles with the same colour
    return {
        "color": PALETTE[i % len(PALETTE)],
        "linestyle": LINES[(i + repetition) % len(LINES)],
        "marker": MARKERS[(i + 3 * repetition) % len(MARKERS)],
    }


def to_svg(draw: Callable[[Figure], None], *, height: float, width: float = WIDTH) -> str:
    """A figure of `width` x `height` inches as SVG."""
    from matplotlib import rc_context
    from matplotlib.figure import Figure

    with rc_context(fname=STYLE):
        figure = Figure(figsize=(width, height), layout="constrained")
        draw(figure)
        svg = io.StringIO()
        figure.savefig(svg, format="svg", metadata={"Date": None, "Creator": None})
    return svg.getvalue()


def grid(figure: Figure, n: int, columns: int = COLUMNS, *, sharey: bool = False) -> list[Axes]:
    """The axes of n panels, in rows of at most `columns`."""
    cells = figure.subplots(-(-n // columns), min(n, columns), sharey=sharey, squeeze=False).flat
    for blank in cells[n:]:
        blank.axis("off")
    return list(cells[:n])


def plain(name: str) -> str:
    """A name escaped for matplotlib: `$` would begin a formula, `_` would hide a legend entry."""
    return (" " if name.startswith("_") else "") + name.replace("$", r"\$")


def _panels(
    study: Comparison, n: int, draw: Callable[[list[Axes]], None], *, sharey: bool = False
) -> str:
    """A figure of n panels with a legend of the arms below."""

    def draw_all(figure: Figure) -> None:
        panels = grid(figure, n, sharey=sharey)
        draw(panels)
        handles, labels = panels[0].get_legend_handles_labels()
        columns = max(1, min(4, LETTERS // (max(map(len, labels), default=1) + 5)))
        figure.legend(handles, labels, loc="outside lower center", ncols=columns)

    return to_svg(draw_all, height=HEIGHT * -(-n // COLUMNS) + 0.4 + 0.1 * len(study.arms))


def _arms(study: Comparison) -> Iterator[tuple[str, dict[str, Any]]]:
    """The names of the arms, with the properties of their lines."""
    for i, arm in enumerate(study.arms):
        label = f"{plain(arm.name)} (n = {len(arm.runs)})"
        yield arm.name, {**nth_style(i), "markersize": 4, "label": label}


def curves(study: Comparison) -> str:
    """Best fitness by generation and by episodes, diversity and mutation rate by generation."""
    own = "" if study.same_training else ", own scales"
    by_generation, by_episodes = ("generation", "Generation"), ("until", "Episodes")
    panels = (
        (by_generation, "fitness_max", f"Figure 4. Best fitness{own}", "points"),
        (by_episodes, "fitness_max", "Best fitness by episodes", "points"),
        (by_generation, "diversity", "Behavioural diversity", "Eq. (3)"),
        (by_generation, "rate", "Figure 7. Mutation rate", "rate"),
    )

    def draw(every: list[Axes]) -> None:
        for axes, ((x, heading), y, title, unit) in zip(every, panels, strict=True):
            for name, look in _arms(study):
                of_arm = study.generations[study.generations["arm"] == name]
                values = by_run(of_arm, x, y)
                mean, sd = values.mean(axis=1), values.std(axis=1)
                band = {"color": look["color"], "alpha": 0.16, "linewidth": 0}
                axes.fill_between(values.index, mean - sd, mean + sd, **band)
                axes.plot(values.index, mean, markevery=(0.05, 0.2), **look)
            axes.set(title=title, ylabel=unit)
            axes.set_xlabel(heading, loc="right")
            if x == by_episodes[0]:
                axes.xaxis.set_major_formatter(THOUSANDS)
            elif study.same_training:
                _stages(axes, study)
            if unit == "points":
                axes.yaxis.set_major_formatter(THOUSANDS)

    return _panels(study, len(panels), draw)


def by_run(generations: DataFrame, x: str, y: str) -> DataFrame:
    """A value of the last finished generation at each x that all runs have, a column per run."""
    values = generations.pivot(index=x, columns="run", values=y).sort_index().ffill().dropna()
    return values[values.index <= generations.groupby("run")[x].max().min()]


def _stages(axes: Axes, study: Comparison) -> None:
    """Dashed lines at the ends of stages of the common curriculum."""
    plan = Curriculum(**study.arms[0].runs[0].config["curriculum"])
    for g in range(1, study.horizon):
        if plan.stage(g) != plan.stage(g - 1):
            axes.axvline(g - 0.5, color="#7d7d7d", linestyle=(0, (4, 3)), linewidth=0.8, zorder=0.5)


def first_robots(study: Comparison) -> str:
    """Share of runs in which a tier has emerged, by generation."""
    tiers = study.classes.milestones

    def draw(panels: list[Axes]) -> None:
        generations = np.arange(study.horizon)
        for axes, tier in zip(panels, tiers, strict=True):
            for name, look in _arms(study):
                firsts = study.of_arm(name)[f"first.{tier}"].to_numpy(float)
                share = (firsts[:, None] <= generations).mean(axis=0)  # nan: never
                axes.plot(generations, share, drawstyle="steps-post", markevery=(0.05, 0.2), **look)
            axes.set(title=study.classes.tier_title(tier), ylim=(-0.03, 1.03))
            axes.set_xlabel("Generation", loc="right")
            axes.yaxis.set_major_formatter(PERCENT)
        panels[0].set_ylabel("Runs that have had one")

    return _panels(study, len(tiers), draw, sharey=True)


def best_robots(study: Comparison, tested: DataFrame) -> str:
    """Each run's best robot in unseen worlds, by arm: a panel per task."""

    def draw(panels: list[Axes]) -> None:
        for axes, task in zip(panels, study.tasks, strict=True):
            found = tested[(tested["task"] == task.label) & tested["run"].notna()]
            for place, (name, look) in enumerate(_arms(study)):
                points = found[found["arm"] == name]["points"].tolist()
                at = place + np.linspace(-0.25, 0.25, len(points) + 2)[1:-1]
                axes.plot(at, points, **{**look, "linestyle": ""}, alpha=0.8)
                mean, low, _ = mean_interval(points)
                axes.errorbar(place, mean, yerr=mean - low, color="#222222", marker="_", capsize=4)
            axes.set_xticks([])
            axes.yaxis.set_major_formatter(THOUSANDS)
            if len(study.tasks) > 1:
                axes.set_title(plain(textwrap.fill(f"under {task.label}", LETTERS // COLUMNS)))
        panels[0].set_ylabel("Mean in unseen worlds (points)")

    return _panels(study, len(study.tasks), draw)
