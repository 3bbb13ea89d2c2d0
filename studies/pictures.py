"""Tables and pictures of studies: content, title and notes, and the files of a picture."""

from __future__ import annotations

import io
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Final

from islandgp.compare.figures import to_svg

if TYPE_CHECKING:
    from matplotlib.figure import Figure
    from pandas import DataFrame  # type: ignore[import-untyped] # its stubs are a package apart

DPI: Final = 150


@dataclass(frozen=True, slots=True)
class Table:
    """A table with formatted cells."""

    key: str  # file name without extension
    title: str
    frame: DataFrame  # of texts
    notes: tuple[str, ...] = ()


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


def picture(
    key: str,
    title: str,
    caption: str,
    draw: Callable[[Figure], None],
    *,
    height: float,
    width: float,
) -> Picture:
    """Draws a figure of `width` x `height` inches, and renders it as SVG and PNG."""
    png = io.BytesIO()

    def draw_both(figure: Figure) -> None:
        draw(figure)
        figure.savefig(png, format="png", dpi=DPI, metadata={"Software": None})

    svg = to_svg(draw_both, height=height, width=width)
    return Picture(key, title, caption, svg, png.getvalue())
