"""Common parts of figures: colours and lines of arms and categories, curves, bars, legends.

Arms have strong colours and differ in line and marker as well; categories (classes,
components, patterns) have pale colours and hatching, and never an arm's colour. So a
figure reads in grey, and for colour-blind readers.
"""

from __future__ import annotations

import io
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


# Arms: Okabe and Ito's palette, from dark to light enough to differ in grey.
PALETTE: Final = (
    *("#0072B2", "#D55E00", "#009E73", "#CC79A7"),
    *("#E69F00", "#56B4E9", "#555555", "#BBBBBB"),
)
# Categories: Paul Tol's light scheme, ordered so that neighbours differ.
PALE: Final = (
    *("#99DDFF", "#FFAABB", "#BBCC33", "#EEDD88"),
    *("#77AADD", "#EE8866", "#44BB99", "#AAAA00"),
)
NEUTRAL: Final = "#dddddd"  # of a category that is the rest
LineStyle = str | tuple[int, tuple[float, ...]]  # as matplotlib takes it
LINES: Final[tuple[LineStyle, ...]] = (
    *("-", "--", "-.", ":"),
    *((0, (9, 2)), (0, (6, 1, 1, 1, 1, 1)), (0, (1.5, 0.8)), (0, (9, 1, 3, 1))),
)
MARKERS: Final = ("o", "s", "^", "D", "v", "P", "X", "*")
# Lines only: dots are curves, and make an SVG ten times as large.
HATCHES: Final = ("", "////", "\\\\\\\\", "xxxx", "----", "||||", "++++", "//")
INK: Final = "#222222"
FAINT: Final = "#8a8a8a"
WIDTH: Final = 7.2  # inches: the text width of a page
DPI: Final = 150
LETTERS: Final = 110  # of a line of a legend
ACROSS: Final = 4  # most panels of arms side by side
ROW: Final = 2.2  # inches, of each further row of them
THOUSANDS: Final = "{x:,.0f}"  # formats of ticks: 30,000
PERCENT: Final = "{x:.0%}"


@dataclass(frozen=True, slots=True)
class Picture:
    """A finished figure."""

    key: str  # file name without its ending
    title: str
    caption: str
    svg: str
    png: bytes = b""  # empty for a tree

    def save(self, folder: Path) -> list[Path]:
        """Writes KEY.svg and, if there is one, KEY.png into a folder. Returns their paths."""
        folder.mkdir(parents=True, exist_ok=True)
        files = {"svg": self.svg.encode(), "png": self.png}
        paths = {folder / f"{self.key}.{ending}": data for ending, data in files.items() if data}
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
    """The arms in order, each with its look."""
    for i, arm in enumerate(study.arms):
        yield arm, nth_style(i)


def nth_style(i: int, palette: tuple[str, ...] = PALETTE) -> Style:
    """The look of the i-th arm, or with PALE of the i-th category; 64 of them differ."""
    again = i // len(palette)  # how often its colour was taken before
    return Style(
        palette[i % len(palette)],
        LINES[(i + again) % len(LINES)],
        MARKERS[(i + 3 * again) % len(MARKERS)],
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
    """Draws on a figure of `width` x `height` inches and saves it both ways.

    Its title and caption are those of `key` in texts.yaml, with `values` in them.
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
    """A number by generation: each arm's mean with a band of ±1 SD over its runs.

    `of` is the number, `label` that of the y axis, and `dress` sets what else there is to set;
    the others as in `picture`.
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
    """An arm's mean with a band of ±1 SD over its runs; `rows` are runs, each with a value an x."""
    a = np.asarray(rows, float)  # runs x places
    mean = a.mean(axis=0)
    if len(a) > 1:
        sd = a.std(axis=0, ddof=1)
        axes.fill_between(x, mean - sd, mean + sd, color=style.colour, alpha=0.16, linewidth=0)
        for edge in (mean - sd, mean + sd):
            axes.plot(x, edge, color=style.colour, alpha=0.45, linewidth=0.6, linestyle=style.line)
    axes.plot(x, mean, color=style.colour, linestyle=style.line, label=named(arm), **marks(style))


def marks(style: Style) -> dict[str, Any]:
    """The marker of a line: every fifth point has one."""
    return {"marker": style.marker, "markevery": 5, "markersize": 4}


def dots(style: Style) -> dict[str, Any]:
    """The look of an arm's points."""
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
    """A panel an arm over generations; `fill` draws into one of them.

    They share the y axis, with its label, and a legend of so many columns. `height` is that of
    a single row; the others as in `picture`.
    """

    def draw(figure: Figure) -> None:
        panels = grid(figure, len(study.arms), ACROSS, sharey=True)
        for axes, arm in zip(panels, study.arms, strict=True):
            fill(axes, arm)
            epoch_lines(axes, study)
            axes.set_title(plain(arm.name))
        for axes in panels[-ACROSS:]:  # none is below them
            axes.set_xlabel("Generation")
        for axes in panels[::ACROSS]:
            axes.set_ylabel(label)
        legend(figure, panels[0], columns)

    rows = -(-len(study.arms) // ACROSS)
    return picture(key, draw, height=height + ROW * (rows - 1), **values)


def stack(axes: Axes, rows: Any, labels: Sequence[str] = (), *, neutral: int | None = None) -> None:
    """Areas upon each other by generation, a row of `rows` each; `neutral` is that of the rest."""
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
    """A name as matplotlib shows it: `$` begins no formula, `_` hides no line of a legend."""
    return (" " if name.startswith("_") else "") + name.replace("$", r"\$")


def groups(study: Comparison, n: int) -> Iterator[tuple[Arm, Style, int, float, float]]:
    """The arms side by side in each of `n` groups: arm, look, group, place on the x axis, width."""
    width = 0.8 / len(study.arms)
    for i, (arm, style) in enumerate(arm_styles(study)):
        for k in range(n):
            yield arm, style, k, k + (i - (len(study.arms) - 1) / 2) * width, width


def sideways(at: float, n: int, width: float) -> list[float]:
    """Places for `n` points around `at`, in their order, so that they do not hide each other."""
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
    """Dashed lines where an epoch ends; with `stages`, the curriculum's stages by name on top."""
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
    """The legend of a figure's axes below them, where it hides no data.

    `columns` is by default as many as the labels have room for, at most four.
    """
    handles, labels = axes.get_legend_handles_labels()
    columns = columns or max(1, min(4, LETTERS // (max(map(len, labels), default=1) + 5)))
    figure.legend(handles, labels, loc="outside lower center", ncols=columns)
