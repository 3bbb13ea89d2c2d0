"""`islandgp show`: each form of a picture holds every node, and survives any label."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from pathlib import Path

import pytest
from hypothesis import given

from islandgp.bt.core.language import parse
from islandgp.bt.core.node import Node, size, walk
from islandgp.bt.export.render import BOX, label, lay_out, to_rich, to_svg
from islandgp.resources import resource
from tests.profiles import examples
from tests.strategies import nodes
from tests.trees.shell import Cli

POOR = resource("grammar") / "examples" / "poor.bt"


@examples(max_examples=60)
@given(tree=nodes())
def test_every_node_is_in_every_picture(tree: Node) -> None:
    """Text and SVG have a place for each node, in document order."""
    labels = [label(node) for node in walk(tree)]
    for line, text in zip(str(to_rich(tree)).splitlines(), labels, strict=True):
        assert line.endswith(text)
    svg = ET.fromstring(to_svg(tree))
    texts = [e.text for e in svg.iter() if e.tag.endswith("text")]
    assert texts == labels


@examples(max_examples=60)
@given(tree=nodes())
def test_boxes_do_not_touch(tree: Node) -> None:
    """In the layout no two boxes overlap, and all of them are inside the picture."""
    boxes, width, height = lay_out(tree)
    for i, a in enumerate(boxes):
        assert a.x > 0
        assert a.x + a.width < width
        assert BOX / 2 < a.y < height - BOX / 2
        for b in boxes[i + 1 :]:
            beside = a.x + a.width <= b.x or b.x + b.width <= a.x
            assert beside or abs(a.y - b.y) >= BOX


def test_text() -> None:
    """The terminal's drawing of a small tree, as one looks at it."""
    tree = parse(
        "selector { when lap >= 2 abort none { sequence { SeekCharger PatrolWaypoint } }"
        " inverter { MoveToGarbage } }"
    )
    assert str(to_rich(tree)).splitlines() == [
        "? selector",
        "\u251c\u2500 \u25c7 lap >= 2 abort none",
        "\u2502  \u2514\u2500 \u2192 sequence",
        "\u2502     \u251c\u2500 SeekCharger",
        "\u2502     \u2514\u2500 PatrolWaypoint",
        "\u2514\u2500 \u00ac inverter",
        "   \u2514\u2500 MoveToGarbage",
    ]


@pytest.mark.parametrize(
    ("name", "start"),
    [
        ("t.svg", "<svg "),
        ("T.SVG", "<svg "),
        ("t.txt", "? selector"),
        ("svg", "? selector"),
    ],
)
def test_command_knows_the_form_by_its_ending(
    islandgp: Cli, tmp_path: Path, name: str, start: str
) -> None:
    """-o t.svg writes SVG, and so on."""
    assert islandgp("show", POOR, "-o", tmp_path / name).code == 0
    assert (tmp_path / name).read_text().startswith(start)


def test_command_refuses_an_ending_that_it_does_not_know(islandgp: Cli, tmp_path: Path) -> None:
    """Text in a .png helps nobody."""
    result = islandgp("show", POOR, "-o", tmp_path / "a.png")
    assert result.code == 2
    assert "ends in .svg or .txt, found .png" in result.err
    assert not (tmp_path / "a.png").exists()


def test_command_draws_in_the_terminal(islandgp: Cli) -> None:
    """Without more, `show` prints the drawing."""
    result = islandgp("show", POOR)
    assert result.out.startswith("? selector\n")
    assert len(result.out.splitlines()) == size(parse(POOR.read_text()))
