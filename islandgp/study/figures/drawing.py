"""Common parts of figures: colours and lines of arms and categories, curves, bars, legends.

Arms have strong colours, and also differ in line style and marker. Categories (classes, components,
patterns) have pale colours with hatching. So figures are readable in grey and by colour-blind
readers.
"""

from __future__ import annotations

import io
import textwrap
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from islandgp.scoring.curriculum import Curriculum
from islandgp.scoring.generation_stats import GenerationStats
from islandgp.study.arms import Arm, Comparison
from islandgp.study.texts import title_and_caption

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


# Arms: Okabe and Ito's palette, ordered by lightness.
PALETTE: Final = (
    *("#0072B2", "#D55E00", "#009E73", "#CC79A7"),
    *("#E69F00", "#56B4E9", "#555555", "#BBBBBB"),
)
# Categories: Paul Tol's light scheme, ordered so that neighbours differ.
PALE: Final = (
    *("#99DDFF", "#FFAABB", "#BBCC33", "#EEDD88"),
    *("#77AADD", "#EE8866", "#44BB99", "#AAAA00"),
)
NEUTRAL: Final = "#dddddd"  # of a residual category
LineStyle = str | tuple[int, tuple[float, ...]]  # as in matplotlib
LINES: Final[tuple[LineStyle, ...]] = (
    *("-", "--", "-.", ":"),
    *((0, (9, 2)), (0, (6, 1, 1, 1, 1, 1)), (0, (1.5, 0.8)), (0, (9, 1, 3, 1))),
)
MARKERS: Final = ("o", "s", "^", "D", "v", "P", "X", "*")
# Markers without circles, which make an SVG ten times as large.
HATCHES: Final = ("", "////", "\\\\\\\\", "xxxx", "----", "||||", "++++", "//")
INK: Final = "#222222"
FAINT: Final = "#8a8a8a"
WIDTH: Final = 7.2  # text width of a page, inches
DPI: Final = 150
LETTERS: Final = 110  # characters of a line in a legend
MAX_COLUMNS: Final = 4  # most panels in a row
ROW: Final = 2.2  # height of a further row of panels, inches
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
    hatch: str


def arm_styles(study: Comparison) -> Iterator[tuple[Arm, Style]]:
    """The arms in order, each with its style."""
    for i, arm in enumerate(study.arms):
        yield arm, nth_style(i)


def nth_style(i: int, palette: tuple[str, ...] = PALETTE) -> Style:
    """The style of the i-th arm, or with PALE of the i-th category; 64 styles are distinct."""
    repetition = i // len(palette)  # number of earlier styles with the same colour
    return Style(
        palette[i % len(palette)],
        LINES[(i + repetition) % len(LINES)],
        MARKERS[(i + 3 * repetition) % len(MARKERS)],
        HATCHES[i % len(HATCHES)],
    )


def picture(
    key: str,
    draw: Callable[[Figure], None],
    *,
    height: float = 3.6,
    width: float = WIDTH,
    **values: object,
) -> Picture:
    """Draws a figure of `width` x `height` inches, and renders it as SVG and PNG.

    Title and caption are those of `key` in texts.yaml, filled in with `values`.
    """
    from matplotlib import rc_context
    from matplotlib.figure import Figure

    with rc_context(fname=Path(__file__).with_name("report.mplstyle")):
        figure = Figure(figsize=(width, height), layout="constrained")
        draw(figure)
        svg, png = io.StringIO(), io.BytesIO()
        figure.savefig(svg, format="svg", metadata={"Date": None, "Creator": None})
        figure.savefig(png, format="png", dpi=DPI, metadata={"Software": None})
    return Picture(key, *title_and_caption(key, **values), svg.getvalue(), png.getvalue())


def curve_picture(
    key: str,
    study: Comparison,
    of: Callable[[GenerationStats], float],
    label: str,
    dress: Callable[[Axes], object],
    *,
    height: float = 3.6,
    **values: Any,
) -> Picture:
    """A curve per arm over generations: the mean over runs with a band of ±1 SD.

    `of` returns the value of a generation, `label` is that of the y axis, and `dress` sets further
    properties of the axes; the other arguments are those of `picture`.
    """

    def draw(figure: Figure) -> None:
        axes = figure.subplots()
        for arm, style in arm_styles(study):
            rows = [[of(s) for s in run.snapshots[: study.generations]] for run in arm.runs]
            band(axes, arm, style, range(study.generations), rows)
        epoch_lines(axes, study, stages=True)
        axes.set(xlabel="Generation", ylabel=label)
        dress(axes)
        legend(figure, axes)

    return picture(key, draw, height=height, **values)


def band(
    axes: Axes, arm: Arm, style: Style, x: Sequence[float], rows: Sequence[Sequence[float]]
) -> None:
    """An arm's mean with a band of ±1 SD over its runs; `rows` has a row per run."""
    a = np.asarray(rows, float)  # runs x places
    mean = a.mean(axis=0)
    if len(a) > 1:
        sd = a.std(axis=0, ddof=1)
        axes.fill_between(x, mean - sd, mean + sd, color=style.colour, alpha=0.16, linewidth=0)
        for edge in (mean - sd, mean + sd):
            axes.plot(x, edge, color=style.colour, alpha=0.45, linewidth=0.6, linestyle=style.line)
    axes.plot(x, mean, color=style.colour, linestyle=style.line, label=named(arm), **marks(style))


def marks(style: Style) -> dict[str, Any]:
    """The marker of a line, at every fifth point."""
    return {"marker": style.marker, "markevery": 5, "markersize": 4}


def dots(style: Style) -> dict[str, Any]:
    """The style of an arm's points."""
    return {"color": style.colour, "marker": style.marker, "edgecolor": "white", "linewidth": 0.4}


def grid(figure: Figure, n: int, columns: int, *, sharey: bool = False) -> list[Axes]:
    """The axes of n panels, in rows of at most `columns`."""
    cells = figure.subplots(-(-n // columns), min(n, columns), sharey=sharey, squeeze=False).flat
    for blank in cells[n:]:
        blank.axis("off")
    return list(cells[:n])


def panel_picture(
    key: str,
    study: Comparison,
    fill: Callable[[Axes, Arm], None],
    label: str,
    *,
    height: float,
    columns: int,
    **values: Any,
) -> Picture:
    """A panel per arm over generations; `fill` draws one of them.

    Panels share the y axis and a legend with `columns` columns. `height` is that of a row; the
    other arguments are those of `picture`.
    """

    def draw(figure: Figure) -> None:
        panels = grid(figure, len(study.arms), MAX_COLUMNS, sharey=True)
        for axes, arm in zip(panels, study.arms, strict=True):
            fill(axes, arm)
            epoch_lines(axes, study)
            axes.set_title(heading(arm.name, min(len(study.arms), MAX_COLUMNS)))
        for axes in panels[-MAX_COLUMNS:]:  # the lowest panel of each column
            axes.set_xlabel("Generation")
        for axes in panels[::MAX_COLUMNS]:
            axes.set_ylabel(label)
        legend(figure, panels[0], columns)

    rows = -(-len(study.arms) // MAX_COLUMNS)
    return picture(key, draw, height=height + ROW * (rows - 1), **values)


def stack(axes: Axes, rows: Any, labels: Sequence[str] = (), *, neutral: int | None = None) -> None:
    """Stacked areas over generations, one per row of `rows`; `neutral` is the residual one."""
    styles = [nth_style(k, PALE) for k in range(len(rows))]
    axes.stackplot(
        range(len(rows[0])),
        rows,
        labels=labels,
        colors=[NEUTRAL if k == neutral else style.colour for k, style in enumerate(styles)],
        hatch=[style.hatch for style in styles],
        edgecolor="white",
        linewidth=0.3,
    )


def named(arm: Arm) -> str:
    """An arm's label in a legend."""
    return f"{plain(arm.name)} (n = {len(arm.runs)})"


def plain(name: str) -> str:
    """A name escaped for matplotlib: `$` would begin a formula, `_` would hide a legend entry."""
    return (" " if name.startswith("_") else "") + name.replace("$", r"\$")


def heading(text: str, columns: int) -> str:
    """The title of one of `columns` panels in a row, broken into lines that fit."""
    return plain(textwrap.fill(text, 68 // columns))


def groups(study: Comparison, n: int) -> Iterator[tuple[Arm, Style, int, float, float]]:
    """The bars of arms in each of `n` groups: (arm, style, group, x, width)."""
    width = 0.8 / len(study.arms)
    for i, (arm, style) in enumerate(arm_styles(study)):
        for k in range(n):
            yield arm, style, k, k + (i - (len(study.arms) - 1) / 2) * width, width


def sideways(at: float, n: int, width: float) -> list[float]:
    """x positions of `n` points around `at`, side by side."""
    return [at + ((i + 0.5) / n - 0.5) * width * 0.6 for i in range(n)]


def bar(
    axes: Axes,
    at: float,
    height: float,
    width: float,
    error: float | list[list[float]],
    style: Style,
    label: str | None = None,
) -> None:
    """A bar with whiskers: `error` is their length, or [[down], [up]]."""
    axes.bar(
        at,
        height,
        width * 0.92,
        yerr=error,
        color=style.colour,
        alpha=0.75,
        hatch=style.hatch,
        edgecolor="white",
        error_kw={"ecolor": INK, "capsize": 3, "elinewidth": 1},
        label=label,
    )


def epoch_lines(axes: Axes, study: Comparison, *, stages: bool = False) -> None:
    """Dashed lines at the ends of epochs; with `stages`, also the names of the stages."""
    plan = Curriculum(**study.arms[0].runs[0].config["curriculum"])
    n = study.generations
    starts = [0]
    for g in range(1, n):
        if plan.epoch(g) != plan.epoch(g - 1):
            new_stage = plan.stage(g) != plan.stage(g - 1)
            axes.axvline(
                g - 0.5,
                color="#7d7d7d" if new_stage else "#bdbdbd",
                linestyle=(0, (4, 3)),
                linewidth=0.9 if new_stage else 0.6,
                zorder=0.5,
            )
            if new_stage:
                starts.append(g)
    axes.set_xlim(-0.5, n - 0.5)
    if stages and len(starts) > 1:
        for i, (start, end) in enumerate(zip(starts, [*starts[1:], n], strict=True), 1):
            axes.text(
                (start + end - 1) / 2,
                1.01,
                f"stage {i}",
                transform=axes.get_xaxis_transform(),
                ha="center",
                va="bottom",
                fontsize=8,
                color="#555555",
            )


def legend(figure: Figure, axes: Axes, columns: int | None = None) -> None:
    """A legend below the axes of a figure.

    `columns` is by default the number that the labels' widths allow, at most four.
    """
    handles, labels = axes.get_legend_handles_labels()
    columns = columns or max(1, min(4, LETTERS // (max(map(len, labels), default=1) + 5)))
    figure.legend(handles, labels, loc="outside lower center", ncols=columns)
