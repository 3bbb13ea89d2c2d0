"""How figures look: colours that colour-blind readers and printers keep apart.

Arms have strong colours and differ in line and marker as well; categories (classes,
components, patterns) have pale colours and hatching, and never an arm's colour. So a
figure still reads in grey.
"""

from __future__ import annotations

import io
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Final, Literal

from islandgp.study.arms import Arm, Comparison

if TYPE_CHECKING:
    from matplotlib.figure import Figure

# Arms: Okabe and Ito's palette, from dark to light enough to differ in grey.
PALETTE: Final = (
    "#0072B2",
    "#D55E00",
    "#009E73",
    "#CC79A7",
    "#E69F00",
    "#56B4E9",
    "#555555",
    "#BBBBBB",
)
# Categories: Paul Tol's light scheme, ordered so that neighbours differ.
PALE: Final = (
    "#99DDFF",
    "#FFAABB",
    "#BBCC33",
    "#EEDD88",
    "#77AADD",
    "#EE8866",
    "#44BB99",
    "#AAAA00",
)
NEUTRAL: Final = "#dddddd"  # of a category that is the rest
LINES: Final = ("-", "--", "-.", ":")
MARKERS: Final = ("o", "s", "^", "D", "v", "P", "X", "*")
# Lines only: dots are curves, and make an SVG ten times as large.
HATCHES: Final = ("", "////", "\\\\\\\\", "xxxx", "----", "||||", "++++", "//")
INK: Final = "#222222"
FAINT: Final = "#8a8a8a"
WIDTH: Final = 7.2  # inches: the text width of a page
COLUMN: Final = 3.5  # inches: a column of a page with two
DPI: Final = 150

RC: Final[dict[str, Any]] = {
    "font.family": "DejaVu Sans",
    "font.size": 9,
    "axes.titlesize": 9.5,
    "axes.titleweight": "bold",
    "axes.titlelocation": "left",
    "axes.edgecolor": "#666666",
    "axes.linewidth": 0.8,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.grid": True,
    "axes.axisbelow": True,
    "grid.color": "#e6e6e6",
    "grid.linewidth": 0.6,
    "lines.linewidth": 1.8,
    "legend.frameon": False,
    "legend.fontsize": 8.5,
    "hatch.linewidth": 0.6,
    "text.color": INK,
    "axes.labelcolor": INK,
    "xtick.color": "#444444",
    "ytick.color": "#444444",
    "figure.facecolor": "white",
    "svg.hashsalt": "islandgp",  # the same picture has the same bytes
    "svg.fonttype": "path",
}


@dataclass(frozen=True, slots=True)
class Picture:
    """A finished figure."""

    key: str  # file name without its ending
    title: str
    caption: str
    svg: str
    png: bytes


@dataclass(frozen=True, slots=True)
class Look:
    """How an arm is drawn everywhere."""

    colour: str
    line: str
    marker: str
    hatch: str


def looks(study: Comparison) -> Iterator[tuple[Arm, Look]]:
    """The arms in order, each with its look."""
    for i, arm in enumerate(study.arms):
        yield arm, look(i)


def look(i: int, palette: tuple[str, ...] = PALETTE) -> Look:
    """The look of the i-th arm, or with PALE of the i-th category."""
    return Look(
        palette[i % len(palette)],
        LINES[i % len(LINES)],
        MARKERS[i % len(MARKERS)],
        HATCHES[i % len(HATCHES)],
    )


def picture(
    key: str,
    title: str,
    caption: str,
    draw: Callable[[Figure], None],
    *,
    height: float = 3.6,
    width: float = WIDTH,
    layout: Literal["constrained"] | None = "constrained",
) -> Picture:
    """Draws on a figure of `width` x `height` inches and saves it both ways."""
    import matplotlib as mpl
    from matplotlib.figure import Figure

    with mpl.rc_context(RC):  # type: ignore[arg-type] # its keys are literals there
        figure = Figure(figsize=(width, height), layout=layout)
        draw(figure)
        svg, png = io.StringIO(), io.BytesIO()
        figure.savefig(svg, format="svg", metadata={"Date": None, "Creator": None})
        figure.savefig(png, format="png", dpi=DPI, metadata={"Software": None})
    return Picture(key, title, caption, svg.getvalue(), png.getvalue())
