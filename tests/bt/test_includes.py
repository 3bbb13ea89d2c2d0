"""Constants, subtrees with parameters, and files that include others."""

from __future__ import annotations

import os
from pathlib import Path
from time import process_time

import pytest

from islandgp.bt.analysis.lint import warnings
from islandgp.bt.core.format import format_text
from islandgp.bt.core.language import parse, parse_placed, to_text
from islandgp.bt.core.node import size
from islandgp.domains.island.vocabulary import VOCABULARY
from islandgp.errors import IslandError, LimitError, TreeError, UnknownNameError

LIBRARY = """# for any robot
constant low = 20.0  # percent
subtree recharge(level, n) = when batteryLevel < level abort lower {
  repeater n { SeekCharger }
}
subtree never = when lap > 2 { when lap < 1 { PickupGarbage } }
PatrolWaypoint
"""
MAIN = """domain island
include "my lib/charge.bt"  # here

# how low
constant least = low
subtree work(low) = when foundGarbage and not (lap < low) { MoveToGarbage }

selector {
  use recharge(least, 3)  # first
  use work(2.5)
  when lap < low { use recharge(50, 1) }
  PatrolWaypoint
}
"""
MEANT = """selector {
  when batteryLevel < 20 abort lower { repeater 3 { SeekCharger } }
  when foundGarbage and not lap < 2.5 { MoveToGarbage }
  when lap < 20 { when batteryLevel < 50 abort lower { repeater 1 { SeekCharger } } }
  PatrolWaypoint
}
"""


def test_names_of_constants_are_in_no_canonical_text() -> None:
    """Not even if an equal tree, whose numbers have their names, was read before."""
    text = "constant low = 41.5\nwhen batteryLevel < low { SeekCharger }"
    parse_placed(text, VOCABULARY)
    assert to_text(parse(text, VOCABULARY)) == "when batteryLevel < 41.5 { SeekCharger }\n"


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    (tmp_path / "my lib").mkdir()
    (tmp_path / "my lib" / "charge.bt").write_text(LIBRARY, encoding="utf-8")
    return tmp_path


def test_what_a_file_means(folder: Path) -> None:
    """Numbers replace names; a parameter hides a constant of its name."""
    tree = parse(MAIN, VOCABULARY, folder=folder)
    assert tree == parse(MEANT, VOCABULARY)
    placed = parse_placed(MAIN, VOCABULARY, folder=folder)
    assert placed.node == tree
    assert len(placed.places) == size(tree)


def test_fmt_keeps_them(folder: Path) -> None:
    """Names, comments and files stay; formatting again changes nothing; the tree is the same."""
    assert format_text(MAIN, folder=folder) == MAIN.replace(
        "island\ninclude", "island\n\ninclude"
    ).replace("not (lap < low)", "not lap < low")
    messy = MAIN.replace("(least, 3)", "( least,3.0 )").replace("= low", "=\n# why\nlow")
    messy = messy.replace("3.0", "3")
    tidy = format_text(messy, folder=folder)
    assert "# why" in tidy
    assert format_text(tidy, folder=folder) == tidy
    assert parse(tidy, folder=folder) == parse(MAIN, folder=folder)
    assert format_text(LIBRARY).startswith("# for any robot\nconstant low = 20  # percent\n")


def test_warnings_of_included_subtrees(folder: Path) -> None:
    """They are reported where the subtree is used, with the numbers of that use."""
    text = MAIN.replace("  PatrolWaypoint\n", "  use never\n  PatrolWaypoint\n")
    never_run = [w for w in warnings(text, VOCABULARY, folder=folder) if "never run" in w.message]
    assert [(w.line, w.column) for w in never_run] == [(12, 3)]
    assert "lap < 1 can't hold" in never_run[0].message
    doubtful = "subtree s(x) = when lap < x { SeekCharger } sequence { use s(3) use s(0) }"
    never_run = [w for w in warnings(doubtful, VOCABULARY) if "never run" in w.message]
    assert [(w.line, w.column) for w in never_run] == [(1, 65)]


WRONG = {
    'include "nope.bt" A': ("1:9", "can't read 'nope.bt': there is no such file"),
    'include "my lib" A': ("1:9", "there is no such file"),
    'include "../out.bt" A': ("1:9", "it is not in the folder of the tree"),
    'include "link.bt" A': ("1:9", "it is not in the folder of the tree"),
    'include "/etc/hostname" A': ("1:9", "it is not in the folder of the tree"),
    'include "" A': ("1:9", "there is no such file"),
    'include "C:\\\\x.bt" A': ("1:9", "there is no such file"),
    "include lib A": ("1:9", "Expected a text in quotes"),
    'include "bad.bt" A': ("bad.bt:2:1", "unexpected"),
    'include "bytes.bt" A': ("1:9", "can't decode byte"),
    'include "pipe.bt" A': ("1:9", "there is no such file"),
    'include "large.bt" A': ("1:9", "too long"),
    'include "other.bt" A': ("other.bt:1:8", "for the domain 'sea'"),
    'PatrolWaypoint include "a.bt"': ("1:16", "one tree"),
    "constant a = b PatrolWaypoint": ("1:14", "unknown constant 'b'"),
    "constant low = 1 when lap < lov { SeekCharger }": ("1:29", "Did you mean low?"),
    "constant a = 1 constant a = 2 SeekCharger": ("1:25", "constant 'a' is defined twice"),
    "subtree s(x, x) = SeekCharger use s(1, 2)": ("1:14", "parameter 'x' is defined twice"),
    "subtree s(x) = SeekCharger use s": ("1:32", "takes 1 argument, found 0"),
    "subtree s = SeekCharger use s(1)": ("1:29", "takes 0 arguments, found 1"),
    "subtree s(x) = repeater x { SeekCharger } use s(1.5)": (
        "1:49",
        "can't have '1.5' as its count (parameter x of s)",
    ),
    "subtree s(x) = when lap < x { SekCharger } use s(1)": ("1:31", "Did you mean SeekCharger?"),
    "subtree s(x) = sequence { use s(x) } use s(1)": ("1:31", "unknown subtree 's'"),
    "subtree s() = SeekCharger use s": ("1:11", "Expected a name"),
}


@pytest.mark.parametrize("text", WRONG)
def test_wrong(text: str, folder: Path) -> None:
    """Each is one message with a place."""
    inner = folder / "in"
    inner.mkdir()
    (folder / "out.bt").write_text("PatrolWaypoint")
    (inner / "link.bt").symlink_to(folder / "out.bt")
    (inner / "my lib").mkdir()
    (inner / "bad.bt").write_text("constant a = 1\n} ")
    (inner / "bytes.bt").write_bytes(b"\xff")
    (inner / "large.bt").write_text("#" * 100_000)
    (inner / "other.bt").write_text("domain sea")
    os.mkfifo(inner / "pipe.bt")
    place, message = WRONG[text]
    with pytest.raises(IslandError) as excinfo:
        parse(text.replace(" A", " PatrolWaypoint"), VOCABULARY, name="t.bt", folder=inner)
    assert message in str(excinfo.value)
    assert f"{place}:" in str(excinfo.value)


def test_a_text_without_a_file_includes_nothing() -> None:
    """So what a model answers, or a record holds, reads no file."""
    with pytest.raises(TreeError, match="it is not in the folder of the tree"):
        parse('include "a.bt" PatrolWaypoint', VOCABULARY)


def test_a_file_counts_once(folder: Path) -> None:
    """However often it is included, also by itself; and there are at most fifty."""
    for at in range(60):
        (folder / f"f{at}.bt").write_text(f"constant c{at} = {at}")
    (folder / "t.bt").write_text("no tree")
    (folder / "both.bt").write_text('include "f1.bt"\ninclude "f2.bt"\ninclude "both.bt"')
    text = 'include "f1.bt"\ninclude "both.bt"\ninclude "t.bt"\nwhen lap < c2 { PatrolWaypoint }'
    tree = parse(text, name="t.bt", folder=folder)
    assert to_text(tree) == "when lap < 2 { PatrolWaypoint }\n"
    many = "\n".join(f'include "f{at}.bt"' for at in range(60))
    with pytest.raises(LimitError, match="at most 50"):
        parse(f"{many} PatrolWaypoint", folder=folder)


DOUBLING = "".join(
    f" subtree a{i}(x) = sequence {{ use a{i - 1}(x) use a{i - 1}(x) }}" for i in range(1, 90)
)
MANY = "".join(
    f" subtree a{i}(x, y) = sequence {{ use a{i - 1}(y, {i}) use a{i - 1}({i}, x) }}"
    for i in range(1, 60)
)
CHAIN = "".join(f" subtree a{i}(x) = use a{i - 1}(x)" for i in range(1, 2000))
DEEP = "".join(f" subtree a{i}(x) = inverter {{ use a{i - 1}(x) }}" for i in range(1, 2000))


@pytest.mark.parametrize(
    "text",
    [
        f"subtree a0(x) = when lap < x {{ SeekCharger }}{DOUBLING} use a89(1)",
        f"subtree a0(x, y) = when lap < x {{ SeekCharger }}{MANY} use a59(1, 2)",
        f"subtree a0(x) = when lap < x {{ SeekCharger }}{CHAIN} use a1999(1)",
        f"subtree a0(x) = when lap < x {{ SeekCharger }}{DEEP} use a1999(1)",
    ],
    ids=["doubling", "many arguments", "chain", "deep"],
)
def test_hostile_expansion(text: str) -> None:
    """It is refused early, at the place where it becomes too much."""
    begin = process_time()
    with pytest.raises(LimitError, match="at most"):
        parse(text, VOCABULARY)
    assert process_time() - begin < 1


def test_unknown_names_are_of_their_kind(folder: Path) -> None:
    """A subtree of an included file is known to the guess."""
    with pytest.raises(UnknownNameError, match="Did you mean recharge"):
        parse('include "my lib/charge.bt" use rechange(1, 2)', VOCABULARY, folder=folder)
