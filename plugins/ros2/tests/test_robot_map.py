"""What `islandgp ros2` reads before ROS 2 is needed."""

from __future__ import annotations

import re
from math import nan
from pathlib import Path

import pytest

from islandgp.bt.core.vocabulary import Action, Vocabulary, number
from islandgp.bt.export.declared import declared
from islandgp.errors import ConfigError
from islandgp_ros2.keys import RosKeys, must_be_plain
from islandgp_ros2.leaves import functions
from islandgp_ros2.node import holds, stamp
from islandgp_ros2.robot_map import (
    ActionServer,
    RobotMap,
    ServiceCall,
    ServiceKey,
    TopicKey,
    read_map,
)
from tests.trees.nav2 import SHAPES, file_of
from tests.trees.shell import Cli

PAGE = (Path(__file__).parents[1] / "README.md").read_text(encoding="utf-8")


@pytest.fixture
def page(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder with the files of README.md, where the test runs."""
    for name, text in re.findall(r"^```(?:bt|yaml) (\S+)\n(.*?)^```$", PAGE, re.S | re.M):
        (tmp_path / name).write_text(text, encoding="utf-8")
    monkeypatch.chdir(tmp_path)
    return tmp_path


@pytest.mark.parametrize("file", ["plan.yaml", Path(__file__).parents[1] / "nav2" / "robot.yaml"])
def test_all_maps_of_the_plug_in_are_read(page: Path, file: str | Path) -> None:
    """The other maps of the page and of the plug-in are read."""
    assert read_map(page / file).actions


def test_the_pages_map(page: Path) -> None:
    """It is read, each entry as its kind."""
    robot_map = read_map(page / "robot.yaml")
    assert isinstance(robot_map.actions["Drive"], ActionServer)
    assert isinstance(robot_map.actions["Dock"], ServiceCall)
    assert isinstance(robot_map.keys["battery"], TopicKey)
    assert isinstance(robot_map.keys["person"], ServiceKey)
    assert robot_map.keys["person"].default is False


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "expected `actions:` and `keys:`, found '{}'"),
        ("5", "expected YAML with each key once, found: a single value"),
        ("[5]", "expected `actions:` and `keys:`, found '[5]'"),
        ("actions: [", "expected YAML"),
        ("actions: []", "actions: "),
        ("keys: {}", "actions: field required"),
        (
            "actions:\n  Go: {action: /a, type: p/action/T}\n  Go: {action: /b, type: p/action/T}",
            ":3:3: expected YAML with each key once, found: found duplicate key Go",
        ),
        (
            "actions: {Go: {action: /a, action: /b, goal: {x: [{y: 1, y: 2}]}}}",
            ":1:28: expected YAML with each key once, found: found duplicate key action",
        ),
        ("actions: {}\nkeys: {}\nactions: {}", "once, found: found duplicate key actions"),
        ("actions: {Go: 5}", "actions.Go: expected `action: NAME` or `service: NAME`, found '5'"),
        ("actions: {Go: {action: /a, service: /b}}", "actions.Go: expected `action: NAME` or"),
        ("actions: {Go: {action: /a}}", "actions.Go.type: field required"),
        ("actions: {Go: {action: /a, type: os/system}}", "actions.Go.type: string should match"),
        ("actions: {Go: {action: /a b, type: p/action/T}}", "actions.Go.action: string should"),
        ("actions: {Go: {action: /a, type: p/action/T, timeout: 0}}", "actions.Go.timeout: "),
        ("actions: {Go: {action: /a, type: p/action/T, timeuot: 1}}", "actions.Go.timeuot: extra"),
        ("actions: {}\nkeys: {k: {topic: /t, type: p/msg/T, field: _x}}", "keys.k.field: "),
        ("actions: {Go: {action: '{a b}', type: p/action/T}}", "actions.Go.action: string should"),
        ("actions: {Go: {server: /a, action: /a, type: p/action/T}}", "actions.Go.server: extra"),
        ("actions: {}\nkeys: {k: {initial: .nan}}", "keys.k.initial"),
        ("actions: &a {Go: 5}\nkeys: *a", "keys.Go: expected `topic: NAME` or `service: NAME`"),
        ("actions: !!python/object/apply:os.system [ls]", "expected YAML"),
    ],
)
def test_mistakes(tmp_path: Path, text: str, message: str) -> None:
    """Each is one line with its place."""
    file = tmp_path / "my robot.yaml"
    file.write_text(text)
    with pytest.raises(ConfigError) as excinfo:
        read_map(file)
    assert message in str(excinfo.value)
    assert str(excinfo.value).startswith(str(file))


def test_a_key_as_a_leaf() -> None:
    """It succeeds while the key is true, and fails without a value."""
    values = iter([None, 0, True])
    assert [holds(lambda: next(values), to="dock") for _ in range(3)] == [False, False, True]


def test_without_rclpy(islandgp: Cli, page: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The error has the remedy, after the map has been read."""
    monkeypatch.setattr("islandgp_ros2.command.find_spec", lambda _: None)
    result = islandgp("ros2", "patrol.bt", "--map", "robot.yaml", "--rate", "10")
    assert result.code == 2
    assert "pip install 'islandgp-ros2[rclpy]'" in result.err
    (page / "robot.yaml").write_text("{")
    assert "expected YAML" in islandgp("ros2", "patrol.bt", "--map", "robot.yaml").err


def test_a_key_can_be_a_text_and_a_condition_cannot() -> None:
    """The field of a key may be a text, one of its words; that of a condition is true or false."""
    must_be_plain("keys.mode.field", "docking", text=True)
    with pytest.raises(
        ConfigError, match=r"keys.mode.field: expected a number or a truth value, found str"
    ):
        must_be_plain("keys.mode.field", "docking", text=False)


def test_a_missing_file_has_no_stamp(tmp_path: Path) -> None:
    """A file that returns with the same text has not changed; a new text or include has."""
    file = tmp_path / "t.bt"
    assert stamp(file) == ()
    file.write_text('include "lib.bt"\nselector { use a Drive }')
    (tmp_path / "lib.bt").write_text("subtree a = Dock")
    first = stamp(file)
    text = file.read_text()
    file.unlink()
    assert stamp(file) == ()
    file.write_text(text)
    assert stamp(file) == first != ()
    (tmp_path / "lib.bt").write_text("subtree a = Wave")
    assert stamp(file) != first


@pytest.fixture
def keys() -> RosKeys:
    """The keys of a map with one that results set."""
    robot_map = RobotMap.model_validate({"actions": {}, "keys": {"n": {"initial": 1}}})
    return RosKeys(None, robot_map.keys)


def test_results_set_keys(keys: RosKeys) -> None:
    """By key, or by argument that names one; NaN is no value; the tree gets its own keys."""
    assert (keys["n"], keys["way"], keys.value("{n}"), keys.value("n")) == (1, None, 1, "n")
    assert keys.write("Go", {"n": 2.5, "path": [7]}, {"path": "{way}"}) is True
    assert (keys["n"], keys["way"]) == (2.5, [7])
    assert keys.write("Go", {"n": nan}, {}) is True
    assert keys["n"] == 1
    gap = number("", 0, 9, initial=0)
    keys.vocabulary = Vocabulary("bot", {"Go": Action("", sets=("gap",))}, {"gap": gap})
    assert keys.write("Go", {"gap": 3, "n": 4}, {}) == {"gap": 3}


def test_python_functions(keys: RosKeys, tmp_path: Path) -> None:
    """They get values of keys, and may yield; a file with an error is named."""
    file = tmp_path / "my leaves.py"
    file.write_text(
        "from math import hypot\ndef Add(a, b, keys, **_): return {'out': a + b + keys['n']}\n"
        "def Twice(a):\n  yield\n  return {'n': 2 * a}\n"
    )
    leaves = functions(file, keys)
    assert [*leaves] == ["Add", "Twice"]
    assert [*leaves["Add"](a="{n}", b=5, out="{sum}")] == []
    assert keys["sum"] == 7
    assert [*leaves["Twice"](a="{sum}")] == [None]
    assert keys["n"] == 14
    with pytest.raises(ConfigError, match=r"function Add, found TypeError: .*my leaves.py, line 2"):
        next(leaves["Add"](a="{none}", b=5))
    file.write_text("def Add(:")
    with pytest.raises(ConfigError, match=r"my leaves.py: expected functions of Python, found"):
        functions(file, keys)


@pytest.mark.parametrize("tree", SHAPES)
def test_leaves_of_navs_trees(keys: RosKeys, tree: str) -> None:
    """The map and the functions have each leaf of the trees that the table of times names."""
    folder = Path(__file__).parents[1] / "nav2"
    known = {*read_map(folder / "robot.yaml").actions, *functions(folder / "leaves.py", keys)}
    xml = file_of(SHAPES[tree])
    actions = {*declared(xml, xml, name="model.xml").actions}
    page = Path(__file__).with_name("README.md").read_text(encoding="utf-8")
    assert (actions <= known) or f"`{tree}`:" not in page
