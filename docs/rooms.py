"""Draws docs/img/rooms.svg, the layers of the package and the lines of code of their rooms.

python -m docs.rooms
"""

from __future__ import annotations

from html import escape
from itertools import chain
from math import ceil
from pathlib import Path
from typing import Final

from tests.architecture.code_lines import code_lines
from tests.architecture.sources import PACKAGE, ROOT, module_name, modules
from tests.architecture.test_imports import LAYERS, NAMES_ONLY, package

PICTURE: Final = Path(__file__).parent / "img" / "rooms.svg"
OUTSIDE: Final = {
    "plugins": "packages of their own, found by entry points",
    "studies": "use the public interface only",
    "examples": "domains by --config-dir",
}
WIDTH, ROW, GAP, LEFT = 1000, 40, 10, 10  # px
LINES_A_PX: Final = 7.0
SMALLEST: Final = 74  # px of a box, which has to have its name


def lines_by_room() -> dict[str, int]:
    """The lines of code of each entry of LAYERS, in order."""
    lines = dict.fromkeys(chain(*LAYERS), 0)
    for path in modules():
        if (name := module_name(path)) not in NAMES_ONLY:
            lines[package(name)] += code_lines(path.read_text(encoding="utf-8"))
    return lines


def rows() -> list[list[tuple[str, str, int]]]:
    """Rows of boxes: name, second line, width in px. The modules of the first layer are one box."""
    lines = lines_by_room()
    first = sum(lines[name] for name in LAYERS[0])
    leaves = f"{first:,} lines: {', '.join(LAYERS[0])}"
    drawn = [[("no trees", leaves, WIDTH - 2 * LEFT)]]
    for layer in LAYERS[1:]:
        widths = {name: max(SMALLEST, ceil(lines[name] / LINES_A_PX)) for name in layer}
        drawn.append([(name, f"{lines[name]:,}", widths[name]) for name in layer])
    third = (WIDTH - 2 * LEFT - (len(OUTSIDE) - 1) * GAP) // len(OUTSIDE)
    return [*drawn, [(name, text, third) for name, text in OUTSIDE.items()]]


def svg() -> str:
    """The picture: a row for each layer, in the order of imports."""
    parts, y = [], 10
    for number, row in enumerate(rows()):
        x, last = LEFT, number == len(LAYERS)
        y += 12 if last else 0
        fill, line = ("#fbf3e2", "#a07b2c") if last else ("#eef3fa", "#4a6fa5")
        for name, text, width in row:
            middle = x + width / 2
            parts.append(
                f'<rect x="{x}" y="{y}" width="{width}" height="{ROW}" rx="5"'
                f' fill="{fill}" stroke="{line}"/>'
                f'<text x="{middle}" y="{y + 17}" class="room">{escape(name)}</text>'
                f'<text x="{middle}" y="{y + 32}" fill="#4b5560">{escape(text)}</text>'
            )
            x += width + GAP
        y += ROW + GAP
    total = sum(lines_by_room().values())
    parts.append(
        f'<text x="{WIDTH / 2}" y="{y + 12}">islandgp: {total:,} lines of code; a box is as wide as'
        " its share. A row imports from itself and from the rows above it.</text>"
    )
    style = "text{font:12px Helvetica,Arial,sans-serif;text-anchor:middle}.room{font-weight:bold}"
    size = f'viewBox="0 0 {WIDTH} {y + 24}" width="{WIDTH}" height="{y + 24}"'
    head = f'<svg xmlns="http://www.w3.org/2000/svg" {size}><style>{style}</style>'
    return "\n".join([head, '<rect width="100%" height="100%" fill="white"/>', *parts, "</svg>\n"])


if __name__ == "__main__":
    PICTURE.write_text(svg(), encoding="utf-8")
    print(PICTURE.relative_to(ROOT), "of", PACKAGE.name)
