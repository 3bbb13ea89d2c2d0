"""Loops, cases, defaults of parameters, and keys as counts and seconds."""

from __future__ import annotations

import pytest

from islandgp.bt.core.format import format_text
from islandgp.bt.core.language import parse, to_text
from islandgp.bt.core.parameters import one_of
from islandgp.bt.core.vocabulary import Action, Vocabulary, enumeration, integer, number
from islandgp.bt.export import behaviortree_cpp
from islandgp.errors import TreeError

ROBOT = Vocabulary(
    "robot",
    {
        "MoveTo": Action(arguments={"goal": one_of("where to", ("dock", "shelf", "bay"))}),
        "Grasp": Action(),
        "switch": Action(),
    },
    {
        "battery": number("charge in %", 0, 100),
        "tries": integer("tries", 0, 9, initial=0),
        "mode": enumeration("mode", ("idle", "work")),
    },
)
FETCH = "subtree fetch(place, times = 3) = retry times { MoveTo(goal: place) }\n"


@pytest.mark.parametrize(
    ("text", "tree"),
    [
        (
            "for place in [shelf, bay] { sequence { MoveTo(goal: place) Grasp } }",
            "sequence {sequence {MoveTo(goal: shelf) Grasp} sequence {MoveTo(goal: bay) Grasp}}",
        ),
        (
            "subtree go(work) = for n in [1, 2] { retry n { work } }\nuse go(Grasp)",
            "sequence { retry 1 { Grasp } retry 2 { Grasp } }",
        ),
        (
            "switch mode { idle { Grasp } work { switch() } else { MoveTo } }",
            "selector { when mode == idle { Grasp } when mode == work { switch() }"
            " when mode != idle and mode != work abort self { MoveTo } }",
        ),
        ("switch battery { 3 { Grasp } }", "selector { when battery == 3 { Grasp } }"),
        (f"{FETCH}use fetch(bay)", "retry 3 { MoveTo(goal: bay) }"),
        (f"{FETCH}use fetch(bay, tries)", "retry tries { MoveTo(goal: bay) }"),
        ("subtree go(n = 2) = repeater n { Grasp }\nuse go", "repeater 2 { Grasp }"),
        ("wait battery { repeater tries { Grasp } }",) * 2,
    ],
)
def test_equal_to(text: str, tree: str) -> None:
    """A short form is the tree for which it is short, also in a formatted file, as JSON."""
    parsed = parse(text, ROBOT)
    assert parsed == parse(tree, ROBOT) == parse(to_text(parsed), ROBOT)
    formatted = format_text(text)
    assert format_text(formatted) == formatted
    assert parse(formatted, ROBOT) == parsed
    assert "<" in behaviortree_cpp.to_xml(parsed, ROBOT)


def test_format_keeps_short_forms() -> None:
    """`fmt` keeps loops, cases and defaults as they are written, with their comments."""
    text = (
        "constant most = 3\n"
        "subtree fetch(place, times = most) = retry times { MoveTo(goal: place) }\n\n"
        "sequence {\n"
        '  for place in [bay, "dock"] { use fetch(place) }  # all of them\n'
        "  switch mode {\n"
        "    # nothing to do\n"
        "    idle { Grasp }\n"
        "    else { use fetch(bay, 2) }  # the rest\n"
        "  }\n"
        "}\n"
    )
    assert format_text(text) == text


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("subtree go(a = 1, b) = Grasp\nGrasp", "Expected ="),
        ("subtree go(a = bay) = retry a { Grasp }\nuse go", "unknown constant 'bay'"),
        (f"{FETCH}use fetch(bay, 2, 3)", "takes 1 to 2 arguments, found 3"),
        ("retry battery { Grasp }", "one of tries"),
        ("wait mode { Grasp }", "one of battery, tries"),
        ("parallel success tries { Grasp }", "unknown constant 'tries'"),
        ("switch mode { idel { Grasp } }", "Did you mean idle"),
        ("for place in [dock, door] { MoveTo(goal: place) }", "parameter place of the `for`"),
        ("for place in [] { Grasp }", "unexpected ']'"),
    ],
)
def test_mistakes(text: str, expected: str) -> None:
    """A mistake in a short form is shown with what is expected."""
    with pytest.raises(TreeError, match=expected.replace("`", ".")):
        parse(text, ROBOT)
