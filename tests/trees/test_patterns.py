"""The twelve trees of `examples/patterns`: checked, run and exported."""

from __future__ import annotations

from pathlib import Path

import pytest

from islandgp.binding import NodeStatus, load_tree
from islandgp.bt.analysis.lint import warnings
from islandgp.bt.core.format import format_text
from islandgp.bt.core.language import parse
from islandgp.bt.export.behaviortree_cpp import to_xml
from islandgp.bt.export.declared import declared
from islandgp.bt.export.import_cpp import read_tree
from islandgp.bt.export.py_trees import to_python
from islandgp.errors import DomainError
from tests.running.commands import ROOT

FOLDER = ROOT / "examples" / "patterns"
ROBOT = declared((FOLDER / "robot.json").read_text(), "", name="robot.json")
FILES = sorted(FOLDER.glob("*.bt"))
START = {"battery": 50, "distance": 10, "speed": 1, "person_near": False, "mode": "idle",
         "pause": 2, "attempts": 2}  # fmt: skip


def moves(text: str) -> list[str]:
    """The calls of a case, and short names in it: d, s, b and o are places to which it moves."""
    places = {"d": "dock", "s": "shelf", "b": "bay", "o": "door"}
    return [f"MoveTo {places[word]}" if word in places else word for word in text.split()]


CASES: dict[str, tuple[str, list[dict[str, object]], str]] = {
    # leaves that fail, changes of keys before each tick, calls of leaves
    "01": ("", [{}], "d s b"),
    "02": ("", [{}, {"battery": 19}, {"battery": 60}, {"battery": 90}],
           "Patrol d Charge d Charge Patrol"),
    "03": ("Grasp", [{}, {}], "Grasp Grasp Beep"),
    "04": ("", [{}], "d Scan s Scan b Scan"),
    "05": ("Drop", [{}, {}], "s Grasp b Drop b Drop"),
    "06": ("", [{}, {"person_near": True}, {}, {"person_near": False}], "Patrol Stop Stop Patrol"),
    "07": ("", [{}], "o"),
    "08": ("", [{}, {"speed": 2, "distance": 3}], "o o"),
    "09": ("", [{}, {"mode": "docking"}, {"mode": "patrolling"}], "Stop d Charge Patrol"),
    "10": ("", [{}], "Patrol"),
    "11": ("", [{}], "s Grasp d b Grasp d"),
    "12": ("IsPathClear", [{}], "IsPathClear Say"),
}  # fmt: skip


@pytest.mark.parametrize("file", FILES, ids=lambda file: file.stem)
def test_pattern(file: Path) -> None:
    """It has no warnings, calls the expected leaves, and is exported or says what to use."""
    text = file.read_text(encoding="utf-8")
    assert format_text(text) == text
    assert warnings(text, ROBOT) == []
    tree = parse(text, ROBOT)
    assert read_tree(to_xml(tree, ROBOT), ROBOT).tree == tree
    if file.stem[:2] in ("01", "03", "10", "12"):
        with pytest.raises(DomainError, match=r"export it as XML|use "):
            to_python(tree, ROBOT)
    else:
        compile(to_python(tree, ROBOT), file.name, "exec")

    failing, ticks, expected = CASES[file.stem[:2]]
    calls: list[str] = []
    keys = dict(START)

    def act(name: str, goal: str = "", **_: object) -> object:
        calls.append(f"{name} {goal}".strip())
        return NodeStatus.RUNNING if name == "Stop" else name not in failing.split()

    leaves = {name: lambda name=name, **values: act(name, **values) for name in ROBOT.actions}
    read = {name: lambda name=name: keys[name] for name in START}
    with load_tree(file, ROBOT).bind(leaves, read, step_s=1) as robot_tree:
        for changes in ticks:
            keys |= changes
            robot_tree.tick()
    assert calls == moves(expected)
