"""Curves over generations as an SVG picture, drawn without any plotting library.

A run draws its own curves at its end, and loading matplotlib would take longer
than the generations of a small run. Figures for papers are `islandgp.study`'s.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from html import escape
from math import ceil, floor, log10
from typing import Final

COLOURS: Final = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9", "#000000")
"""Okabe and Ito's, told apart by colour-blind people too."""

DASHES: Final = ("", "6 3", "2 2", "8 3 2 3")  # told apart in grey print
WIDTH: Final = 460  # of a panel, pixels
HEIGHT: Final = 250
LEFT: Final = 62  # margins
RIGHT: Final = 14
TOP: Final = 42
BOTTOM: Final = 34

_text = partial(escape, quote=False)


@dataclass(frozen=True, slots=True)
class Line:
    """One curve; values at generations 0, 1, 2, ..."""

    name: str
    values: tuple[float, ...]
    spread: tuple[float, ...] = ()  # half the height of a band around it, or none


@dataclass(frozen=True, slots=True)
class Panel:
    """One pair of axes."""

    title: str
    lines: tuple[Line, ...]


def svg(panels: Sequence[Panel]) -> str:
    """The panels, two side by side."""
    width, height = 2 * WIDTH, -(-len(panels) // 2) * HEIGHT
    body = "".join(
        f'<g transform="translate({i % 2 * WIDTH} {i // 2 * HEIGHT})">{_panel(p)}</g>\n'
        for i, p in enumerate(panels)
    )
    return (
        f'<svg xmlns="http://www.w3.org/2000/svg" width="{width}" height="{height}"'
        f' viewBox="0 0 {width} {height}" font-family="sans-serif" font-size="11">\n'
        f'<rect width="{width}" height="{height}" fill="#fff"/>\n{body}</svg>\n'
    )


def _panel(panel: Panel) -> str:
    values = [v for line in panel.lines for v in _edges(line)] or [0.0]
    low, high = min(values), max(values)
    low, high = (low, high) if high > low else (low - 1, high + 1)
    last = max([len(line.values) for line in panel.lines] or [0]) - 1

    def x(generation: float) -> str:
        return f"{LEFT + generation / max(last, 1) * (WIDTH - LEFT - RIGHT):.1f}"

    def y(value: float) -> str:
        return f"{TOP + (high - value) / (high - low) * (HEIGHT - TOP - BOTTOM):.1f}"

    parts = [
        f'<text x="{LEFT}" y="16" font-size="13" font-weight="bold">{_text(panel.title)}</text>'
    ]
    parts += (
        f'<path d="M{LEFT} {y(value)}H{WIDTH - RIGHT}" stroke="#ddd"/>'
        f'<text x="{LEFT - 6}" y="{y(value)}" dy="4" text-anchor="end">{_number(value)}</text>'
        for value in ticks(low, high)
    )
    parts += (
        f'<text x="{x(generation)}" y="{HEIGHT - 18}" text-anchor="middle">{generation}</text>'
        for generation in sorted({round(i * max(last, 0) / 4) for i in range(5)})
    )
    parts.append(f'<text x="{WIDTH - RIGHT}" y="{HEIGHT - 4}" text-anchor="end">generation</text>')
    at = LEFT
    for i, line in enumerate(panel.lines):
        colour, dash = COLOURS[i % len(COLOURS)], DASHES[i % len(DASHES)]
        if line.spread:
            pairs = list(enumerate(zip(line.values, line.spread, strict=True)))
            up = [f"{x(g)},{y(v + s)}" for g, (v, s) in pairs]
            down = [f"{x(g)},{y(v - s)}" for g, (v, s) in reversed(pairs)]
            band = " ".join(up + down)
            parts.append(f'<polygon points="{band}" fill="{colour}" fill-opacity="0.15"/>')
        points = " ".join(f"{x(g)},{y(v)}" for g, v in enumerate(line.values))
        stroke = f'stroke="{colour}" stroke-width="1.8" stroke-dasharray="{dash}"'
        parts.append(
            f'<polyline points="{points}" fill="none" {stroke}/>'
            f'<path d="M{at} 29h22" {stroke}/>'
            f'<text x="{at + 26}" y="33">{_text(line.name)}</text>'
        )
        at += 44 + 7 * len(line.name)
    return "\n".join(parts)


def ticks(low: float, high: float) -> list[float]:
    """Three to seven round numbers in a range of some extent."""
    rough = (high - low) / 5
    power = 10.0 ** floor(log10(rough))
    step = next(m * power for m in (1, 2, 5, 10) if m * power >= rough)
    return [i * step for i in range(ceil(low / step), floor(high / step) + 1)]


def _edges(line: Line) -> list[float]:
    if not line.spread:
        return list(line.values)
    pairs = list(zip(line.values, line.spread, strict=True))
    return [v - s for v, s in pairs] + [v + s for v, s in pairs]


def _number(value: float) -> str:
    return f"{value:,.0f}" if abs(value) >= 100 else f"{value:.3g}"
