"""Figures of a report: curves over generations and episodes, first robots, best robots.

Arms differ in colour, line style and marker, so that figures are readable in grey and by
colour-blind readers.
"""

from __future__ import annotations

import io
import textwrap
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from islandgp.compare.arms import Arm
from islandgp.compare.champions import TreeResult
from islandgp.compare.comparable import Comparison
from islandgp.compare.measures import Value, best, diversity, episodes_until, first, rate
from islandgp.scoring.curriculum import Curriculum
from islandgp.statistics import mean_interval

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

PALETTE: Final = (
    *("#0072B2", "#D55E00", "#009E73", "#CC79A7"),
    *("#E69F00", "#56B4E9", "#555555", "#BBBBBB"),
)
"""Okabe and Ito's palette, ordered by lightness."""
LineStyle = str | tuple[int, tuple[float, ...]]  # as in matplotlib
LINES: Final[tuple[LineStyle, ...]] = (
    *("-", "--", "-.", ":"),
    *((0, (9, 2)), (0, (6, 1, 1, 1, 1, 1)), (0, (1.5, 0.8)), (0, (9, 1, 3, 1))),
)
MARKERS: Final = ("o", "s", "^", "D", "v", "P", "X", "*")
INK: Final = "#222222"
WIDTH: Final = 7.2  # text width of a page, inches
DPI: Final = 150
LETTERS: Final = 110  # characters of a line in a legend
COLUMNS: Final = 2  # panels in a row
HEIGHT: Final = 2.6  # of a panel, inches
THOUSANDS: Final = "{x:,.0f}"  # formats of ticks: 30,000
PERCENT: Final = "{x:.0%}"


@dataclass(frozen=True, slots=True)
class Picture:
    """A finished figure."""

    key: str  # file name without extension
    title: str
    caption: str
    svg: str
    png: bytes

    def save(self, folder: Path) -> list[Path]:
        """Writes KEY.svg and KEY.png into a folder. Returns their paths."""
        folder.mkdir(parents=True, exist_ok=True)
        files = {"svg": self.svg.encode(), "png": self.png}
        paths = {folder / f"{self.key}.{ending}": data for ending, data in files.items()}
        for path, data in paths.items():
            path.write_bytes(data)
        return list(paths)


@dataclass(frozen=True, slots=True)
class Style:
    """Style of an arm in all figures."""

    colour: str
    line: LineStyle
    marker: str


def nth_style(i: int) -> Style:
    """The style of the i-th arm; 64 styles are distinct."""
    repetition = i // len(PALETTE)  # number of earlier styles with the same colour
    return Style(
        PALETTE[i % len(PALETTE)],
        LINES[(i + repetition) % len(LINES)],
        MARKERS[(i + 3 * repetition) % len(MARKERS)],
    )


def picture(
    key: str,
    title: str,
    caption: str,
    draw: Callable[[Figure], None],
    *,
    height: float = HEIGHT,
    width: float = WIDTH,
) -> Picture:
    """Draws a figure of `width` x `height` inches, and renders it as SVG and PNG."""
    from matplotlib import rc_context
    from matplotlib.figure import Figure

    with rc_context(fname=Path(__file__).with_name("report.mplstyle")):
        figure = Figure(figsize=(width, height), layout="constrained")
        draw(figure)
        svg, png = io.StringIO(), io.BytesIO()
        figure.savefig(svg, format="svg", metadata={"Date": None, "Creator": None})
        figure.savefig(png, format="png", dpi=DPI, metadata={"Software": None})
    return Picture(key, title, caption, svg.getvalue(), png.getvalue())


def grid(figure: Figure, n: int, columns: int = COLUMNS, *, sharey: bool = False) -> list[Axes]:
    """The axes of n panels, in rows of at most `columns`."""
    cells = figure.subplots(-(-n // columns), min(n, columns), sharey=sharey, squeeze=False).flat
    for blank in cells[n:]:
        blank.axis("off")
    return list(cells[:n])


def plain(name: str) -> str:
    """A name escaped for matplotlib: `$` would begin a formula, `_` would hide a legend entry."""
    return (" " if name.startswith("_") else "") + name.replace("$", r"\$")


def legend(figure: Figure, axes: Axes) -> None:
    """A legend below the axes, with the number of columns that the labels' widths allow."""
    handles, labels = axes.get_legend_handles_labels()
    columns = max(1, min(4, LETTERS // (max(map(len, labels), default=1) + 5)))
    figure.legend(handles, labels, loc="outside lower center", ncols=columns)


def _arms(study: Comparison) -> Iterator[tuple[Arm, str, dict[str, Any]]]:
    """The arms with their label and the properties of their lines."""
    for i, arm in enumerate(study.arms):
        style = nth_style(i)
        look = {"color": style.colour, "linestyle": style.line, "marker": style.marker}
        yield arm, f"{plain(arm.name)} (n = {len(arm.runs)})", {**look, "markersize": 4}


def _height(panels: int, arms: int) -> float:
    return HEIGHT * -(-panels // COLUMNS) + 0.3 + 0.1 * arms


def curves(study: Comparison) -> Picture:
    """Best fitness by generation and by episodes, diversity and mutation rate by generation."""
    own = "" if study.same_training else ", own scales"

    def draw(figure: Figure) -> None:
        by_generation, by_episodes, other, rates = grid(figure, 4)
        every: list[tuple[Axes, Value, str, str]] = [
            (by_generation, best, f"Figure 4. Best fitness{own}", "points"),
            (by_episodes, best, "Best fitness by episodes", "points"),
            (other, diversity, "Behavioural diversity", "Eq. (3)"),
            (rates, rate, "Figure 7. Mutation rate", "rate"),
        ]
        for axes, value, title, label in every:
            for arm, name, look in _arms(study):
                x: Sequence[float] = range(study.generations)
                rows = [[value(s) for s in run.snapshots] for run in arm.runs]
                if axes is by_episodes:
                    x, rows = at_episodes(arm, value)
                _band(axes, x, rows, name, look)
            if axes is not by_episodes:
                _stages(axes, study)
            axes.set(title=title, ylabel=label)
            axes.set_xlabel("Episodes" if axes is by_episodes else "Generation", loc="right")
        for axes in (by_generation, by_episodes):
            axes.yaxis.set_major_formatter(THOUSANDS)
        by_episodes.xaxis.set_major_formatter(THOUSANDS)
        legend(figure, by_generation)

    return picture(
        "curves",
        "Progress",
        "Means over runs, bands of ±1 standard deviation. Dashed lines end a stage of the"
        " curriculum. Episodes of validation and of the search for a library are not counted.",
        draw,
        height=_height(4, len(study.arms)),
    )


def _band(
    axes: Axes, x: Sequence[float], rows: Sequence[Sequence[float]], name: str, look: dict[str, Any]
) -> None:
    """A mean with a band of ±1 SD over runs; `rows` has a row per run."""
    values = np.asarray(rows, float)  # runs x places
    mean = values.mean(axis=0)
    if len(values) > 1:
        sd = values.std(axis=0, ddof=1)
        axes.fill_between(x, mean - sd, mean + sd, color=look["color"], alpha=0.16, linewidth=0)
    axes.plot(x, mean, label=name, markevery=(0.05, 0.2), **look)


def at_episodes(arm: Arm, of: Value) -> tuple[Sequence[float], list[list[float]]]:
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


def _stages(axes: Axes, study: Comparison) -> None:
    """Dashed lines at the ends of stages, if all arms have the same curriculum."""
    if not study.same_training:
        return
    plan = Curriculum(**study.arms[0].runs[0].config["curriculum"])
    for g in range(1, study.generations):
        if plan.stage(g) != plan.stage(g - 1):
            axes.axvline(g - 0.5, color="#7d7d7d", linestyle=(0, (4, 3)), linewidth=0.8, zorder=0.5)


def first_robots(study: Comparison) -> Picture:
    """Share of runs in which a tier has emerged, by generation, as in the log-rank test."""
    tiers = study.classes.milestones

    def draw(figure: Figure) -> None:
        panels = grid(figure, len(tiers), sharey=True)
        for axes, tier in zip(panels, tiers, strict=True):
            for arm, name, look in _arms(study):
                firsts = [first(run, tier) for run in arm.runs]
                share = [
                    np.mean([f is not None and f <= g for f in firsts])
                    for g in range(study.generations)
                ]
                look |= {"drawstyle": "steps-post", "markevery": (0.05, 0.2)}
                axes.plot(range(study.generations), share, label=name, **look)
            axes.set(title=study.classes.tier_title(tier), ylim=(-0.03, 1.03))
            axes.set_xlabel("Generation", loc="right")
            axes.yaxis.set_major_formatter(PERCENT)
        panels[0].set_ylabel("Runs that have had one")
        legend(figure, panels[0])

    return picture(
        "first-robots",
        "Figure 6. First robots",
        "Share of runs with a robot of the tier so far: one minus the Kaplan-Meier estimate. The"
        " log-rank test compares these curves.",
        draw,
        height=_height(len(tiers), len(study.arms)),
    )


def best_robots(study: Comparison, results: Sequence[TreeResult]) -> Picture:
    """Each run's best robot in unseen worlds, by arm: a panel per task."""

    def draw(figure: Figure) -> None:
        panels = grid(figure, len(study.tasks))
        for axes, task in zip(panels, study.tasks, strict=True):
            for place, (arm, name, look) in enumerate(_arms(study)):
                points = [
                    r.mean for r in results if r.run and (r.arm, r.task) == (arm.name, task.label)
                ]
                at = place + np.linspace(-0.25, 0.25, len(points) + 2)[1:-1]
                axes.plot(at, points, label=name, **{**look, "linestyle": ""}, alpha=0.8)
                mean = mean_interval(points)
                whisker: dict[str, Any] = {"color": INK, "marker": "_", "capsize": 4}
                axes.errorbar(place, mean.estimate, yerr=mean.high - mean.estimate, **whisker)
            axes.set_xticks([])
            axes.yaxis.set_major_formatter(THOUSANDS)
            if len(study.tasks) > 1:
                axes.set_title(plain(textwrap.fill(f"under {task.label}", LETTERS // COLUMNS)))
        legend(figure, panels[0])
        panels[0].set_ylabel("Mean in unseen worlds (points)")

    return picture(
        "best-robots",
        "Best robots in unseen worlds",
        "A point is a run's best robot; bars: mean over runs with Student's t 95 % interval."
        " Panels have different scales of points if rewards or curricula differ.",
        draw,
        height=_height(len(study.tasks), len(study.arms)) + 0.3,
    )
