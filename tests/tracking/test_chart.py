"""Curves as SVG."""

from __future__ import annotations

from xml.etree import ElementTree

import pytest

from islandgp.tracking.chart import Line, Panel, svg, ticks

SVG = "{http://www.w3.org/2000/svg}"


def test_each_line_is_drawn_in_its_axes() -> None:
    """Two generations, from the lowest value at the bottom left to the highest at the top right."""
    root = ElementTree.fromstring(svg([Panel("A", (Line("up", (0.0, 10.0)),))]))
    (line,) = root.iter(f"{SVG}polyline")
    assert line.get("points") == "62.0,216.0 446.0,42.0"


def test_a_spread_is_a_band_inside_the_axes() -> None:
    """The axes reach as far as the band does."""
    root = ElementTree.fromstring(svg([Panel("A", (Line("x", (0.0, 0.0), (1.0, 2.0)),))]))
    (band,) = root.iter(f"{SVG}polygon")
    heights = {float(point.split(",")[1]) for point in (band.get("points") or "").split()}
    assert (min(heights), max(heights)) == (42.0, 216.0)


def test_degenerate_curves_are_drawn_too() -> None:
    """One generation, a constant, nothing at all: each gives a picture, without an error."""
    panels = [
        Panel("one", (Line("x", (3.0,)),)),
        Panel("constant", (Line("x", (3.0, 3.0)),)),
        Panel("empty", ()),
    ]
    root = ElementTree.fromstring(svg(panels))
    assert len(list(root.iter(f"{SVG}polyline"))) == 2


def test_names_are_text_and_no_markup() -> None:
    """A name with a bracket leaves the picture well-formed."""
    root = ElementTree.fromstring(svg([Panel("a<b & c", (Line("<x>", (1.0, 2.0)),))]))
    texts = {text.text for text in root.iter(f"{SVG}text")}
    assert {"a<b & c", "<x>"} <= texts


@pytest.mark.parametrize(
    ("low", "high", "expected"),
    [
        (0, 10, [0, 2, 4, 6, 8, 10]),
        (-2.7, 14.4, [0, 5, 10]),
        (-3537, 56313, [0, 20000, 40000]),
        (0.5, 0.52, [0.5, 0.505, 0.51, 0.515, 0.52]),
    ],
)
def test_ticks_are_round_numbers(low: float, high: float, expected: list[float]) -> None:
    """Inside the range, at steps of 1, 2 or 5 times a power of ten."""
    assert ticks(low, high) == pytest.approx(expected)
