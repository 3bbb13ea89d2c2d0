"""`islandgp ros2` against test servers, by the real middleware on this machine."""

from __future__ import annotations

import json
import os
import re
import shlex
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

pytest.importorskip("rclpy", reason="pip install 'islandgp-ros2[rclpy]'")
pytest.importorskip("test_msgs", reason="pip install ros-test-msgs")
pytest.importorskip("nav_msgs", reason="pip install ros-nav-msgs")
os.environ["ROS_AUTOMATIC_DISCOVERY_RANGE"] = "LOCALHOST"
os.environ["ROS_DOMAIN_ID"] = str(1 + os.getpid() % 100)  # without other tests

from rclpy.exceptions import InvalidHandle
from ros2_servers import BRAKES, FAILS, HANGS, REJECTED, SUCCEEDS, Servers
from std_msgs.msg import Float32, String

from islandgp.binding import NodeStatus, Tree
from islandgp.bt.core.language import parse
from islandgp.bt.core.vocabulary import Action, Vocabulary, enumeration, flag, number
from islandgp.errors import ConfigError, IslandError
from islandgp_ros2.messages import filled, interface
from islandgp_ros2.node import TreeNode, ros_node
from islandgp_ros2.robot_map import read_map

pytestmark = [pytest.mark.slow, pytest.mark.process, pytest.mark.filterwarnings("default")]

DRIVE = "{{action: /drive, type: test_msgs/action/Fibonacci, goal: {{order: {}}}{}}}"
NESTED = (
    "{action: /turn, type: test_msgs/action/NestedMessage,"
    " goal: {nested_field: {int32_value: 3}, nested_field.bool_value: true}}"
)
MAP = f"""
node: robot
actions:
  Drive: {DRIVE.format(SUCCEEDS, "")}
  Crash: {DRIVE.format(FAILS, "")}
  Hang: {DRIVE.format(HANGS, ", timeout: 0.6")}
  Wait: {DRIVE.format(HANGS, ", server_timeout: 3")}
  Refused: {DRIVE.format(REJECTED, "")}
  Nowhere: {{action: /nowhere, type: test_msgs/action/Fibonacci, server_timeout: 0.3}}
  Dock: {{service: /dock, type: std_srvs/srv/Trigger}}
  Lost: {{service: /lost, type: std_srvs/srv/Trigger, timeout: 0.3}}
keys:
  battery: {{topic: /battery, type: std_msgs/msg/Float32, field: data, max_age: 60}}
  person: {{service: /near, type: std_srvs/srv/SetBool, every: 0.05, default: false}}
"""


@pytest.fixture
def servers() -> Iterator[Servers]:
    """Servers in threads of this process."""
    instance = Servers()
    yield instance
    instance.close()


def eventually(holds: Callable[[], bool]) -> bool:
    """Whether it holds within 5 s."""
    end = time.monotonic() + 5
    while not holds() and time.monotonic() < end:
        time.sleep(0.02)
    return holds()


class Robot:
    """A tree at work in a folder, with the states that it publishes."""

    def __init__(self, folder: Path, text: str) -> None:
        self.file = folder / "my tree.bt"
        self.file.write_text(text)
        (folder / "robot.yaml").write_text(MAP)
        robot_map = read_map(folder / "robot.yaml")
        self._ros = ros_node(robot_map.node)
        self.node, self.spin = self._ros.__enter__()
        self.states: list[dict[str, Any]] = []
        self.node.create_subscription(
            String, "/robot/status", lambda m: self.states.append(json.loads(m.data)), 10
        )
        words, leaves = folder / "robot.json", folder / "leaves.py"
        self.tree_node = TreeNode(
            self.node,
            self.file,
            robot_map,
            words if words.exists() else None,
            leaves=leaves if leaves.exists() else None,
        )

    def until(self, holds: Callable[[NodeStatus | None], bool], seconds: float = 15) -> bool:
        """Ticks at 50 Hz until it holds of a status."""
        end = time.monotonic() + seconds
        while time.monotonic() < end:
            if holds(self.tree_node.tick()):
                return True
            self.spin(0.02)
        return False

    def ended(self) -> NodeStatus | None:
        """How the tree ended."""
        statuses: list[NodeStatus | None] = []
        self.until(lambda s: statuses.append(s) or s in (NodeStatus.SUCCESS, NodeStatus.FAILURE))  # type: ignore[func-returns-value]
        return statuses[-1]

    def close(self) -> None:
        """Ends the node."""
        self.tree_node.end(self.spin)
        self._ros.__exit__(None, None, None)


@pytest.fixture
def robot(tmp_path: Path) -> Iterator[Callable[[str], Robot]]:
    """Starts a robot with the tree of a text."""
    robots: list[Robot] = []

    def start(text: str) -> Robot:
        robots.append(Robot(tmp_path, text))
        return robots[-1]

    yield start
    for each in robots:
        each.close()


@pytest.mark.parametrize(
    ("text", "status", "cancelled"),
    [
        ("sequence { Drive Dock }", NodeStatus.SUCCESS, []),
        ("Crash", NodeStatus.FAILURE, []),
        ("Hang", NodeStatus.FAILURE, [HANGS]),
        ("Refused", NodeStatus.FAILURE, []),
        ("Nowhere", NodeStatus.FAILURE, []),
        ("Lost", NodeStatus.FAILURE, []),
        ("parallel success one { Drive Wait }", NodeStatus.SUCCESS, [HANGS]),
    ],
)
def test_goals(
    servers: Servers,
    robot: Callable[[str], Robot],
    text: str,
    status: NodeStatus,
    cancelled: list[int],
) -> None:
    """They succeed, fail, take too long, are refused, or have no server; the rest is cancelled."""
    machine = robot(text)
    assert machine.ended() == status
    machine.spin(0.3)
    assert eventually(lambda: servers.cancelled == cancelled)


def test_an_abort_cancels_the_goal(servers: Servers, robot: Callable[[str], Robot]) -> None:
    """A key that changes takes over; the server gets the cancellation; the states are published."""
    machine = robot("selector { when battery < 20 { Dock } Wait }")
    assert machine.tree_node.tick() is None  # no message yet
    servers.battery.publish(Float32(data=80.0))

    def goes(_: object) -> bool:
        servers.battery.publish(Float32(data=80.0))
        return servers.goals == [HANGS]

    assert machine.until(goes)

    def docks(_: object) -> bool:
        servers.battery.publish(Float32(data=10.0))
        return bool(servers.calls)

    assert machine.until(docks)
    machine.spin(0.3)
    assert eventually(lambda: servers.cancelled == [HANGS])
    assert any({"node": "Wait", "status": "ABORTED"} in state["nodes"] for state in machine.states)
    assert machine.states[0]["waits_for"] == ["battery"]


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("std_msgs/msg/Float32", "std_msgs/msg/Flaot32", "Flaot32, found it not installed"),
        ("std_msgs/msg/Float32", "no_msgs/msg/Float32", "install the package no_msgs"),
        ("field: data", "field: dat", "keys.battery.field: expected fields among data"),
        ("std_msgs/msg/Float32", "std_msgs/msg/String", "keys.battery.field: expected a number"),
        ("order: 1", "ordre: 1", "found 'ordre'; perhaps order is meant"),
        ("order: 1", "order: far", "actions.Drive.goal.order: expected a value of int32"),
        ("order: 1", "order: true", "actions.Drive.goal.order: expected a value of int32"),
        ("order: 1", "order: 1.5", "actions.Drive.goal.order: expected a value of int32"),
        ("order: 1", "order: 99999999999", "actions.Drive.goal.order: expected a value of int32"),
        ("Drive:", "Drvie:", "nothing for the action Drive"),
    ],
)
def test_maps_that_do_not_fit(
    robot: Callable[[str], Robot],
    monkeypatch: pytest.MonkeyPatch,
    old: str,
    new: str,
    message: str,
) -> None:
    """A missing interface, field, value or action is one clear error."""
    monkeypatch.setattr("test_ros2.MAP", MAP.replace(old, new))
    with pytest.raises(IslandError) as excinfo:
        robot("selector { when battery < 20 { Dock } Drive }")
    assert message in str(excinfo.value)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("Drive(ordre: 5)", "actions.Drive.goal: expected fields among order, found 'ordre'"),
        ("Drive(order: far)", "actions.Drive.goal.order: expected a value of int32, found 'far'"),
        ("Drive(order: 1.5)", "actions.Drive.goal.order: expected a value of int32, found '1.5'"),
        ("Dock(data: 5)", "actions.Dock.request: expected fields among none, found 'data'"),
    ],
)
def test_arguments_that_do_not_fit(robot: Callable[[str], Robot], text: str, message: str) -> None:
    """They are reported before the robot starts, also in a branch that may never run."""
    with pytest.raises(IslandError, match=re.escape(message)):
        robot(f"selector {{ Wait {text} }}")


def test_arguments_without_a_vocabulary(servers: Servers, robot: Callable[[str], Robot]) -> None:
    """A whole number of the tree fits an integer field of the goal."""
    machine = robot(f"Drive(order: {FAILS})")
    assert machine.until(lambda _: servers.goals == [FAILS])


RESULT = ", result: {'sequence[1]': last}"  # ten times the order


def mapped(monkeypatch: pytest.MonkeyPatch, *actions: str, keys: str = "") -> None:
    """Adds actions and keys to the map."""
    added = MAP.replace("actions:\n", "".join(["actions:\n", *(f"  {each}\n" for each in actions)]))
    monkeypatch.setattr("test_ros2.MAP", added + keys)


def test_values_by_name(
    servers: Servers, robot: Callable[[str], Robot], monkeypatch: pytest.MonkeyPatch
) -> None:
    """A field has the value of an argument, or of a key that a result sets."""
    step = f"Step: {DRIVE.format('n', RESULT)}"
    mapped(monkeypatch, step, f"Next: {DRIVE.format('last', '')}")
    machine = robot(f"sequence {{ Step(n: {SUCCEEDS}) Next }}")
    assert machine.until(lambda _: servers.goals == [SUCCEEDS, 10 * SUCCEEDS])


def test_arguments_that_name_keys(
    servers: Servers, robot: Callable[[str], Robot], monkeypatch: pytest.MonkeyPatch
) -> None:
    """`"{a}"` is the value of `a`; an argument for a result names its key, also after a failure."""
    result = ", result: {'sequence[0]': out}"
    actions = [f"{name}: {DRIVE.format('order', result)}" for name in ("Step", "Last")]
    mapped(monkeypatch, *actions, keys="  seen: {initial: 0}\n")
    machine = robot(
        f'sequence {{ force_success {{ Step(order: {FAILS}, out: "{{seen}}") }}'
        ' when seen == 2 { Last(order: "{seen}", out: "{other}") } }'
    )
    assert machine.until(lambda _: servers.goals == [FAILS, FAILS])


def test_a_changed_key_replaces_a_goal(
    servers: Servers,
    robot: Callable[[str], Robot],
    monkeypatch: pytest.MonkeyPatch,
    tmp_path: Path,
) -> None:
    """The newer goal is sent first; then the old one is cancelled, if its server goes on."""
    follow = f"Follow: {DRIVE.format('n', ', replace: true')}"
    mapped(monkeypatch, follow, keys=f"  n: {{initial: {HANGS}}}\n")
    (tmp_path / "leaves.py").write_text(
        f"def Change():\n  for _ in range(40): yield\n  return {{'n': {BRAKES}}}\n"
    )
    machine = robot("parallel { Follow sequence { Change always running } }")
    assert machine.until(lambda _: servers.cancelled == [HANGS])
    assert servers.goals == [HANGS, BRAKES]
    assert machine.until(lambda _: False, 1) is False
    assert servers.cancelled == [HANGS]


def test_a_key_without_a_value_fails_the_action(
    robot: Callable[[str], Robot], monkeypatch: pytest.MonkeyPatch
) -> None:
    """An action that needs the result of one which has not ended fails; others are not affected."""
    step = f"Step: {DRIVE.format(SUCCEEDS, RESULT)}"
    mapped(monkeypatch, step, f"Next: {DRIVE.format('last', '')}", f"Turn: {NESTED}")
    assert robot("Next").ended() == NodeStatus.FAILURE
    assert robot("parallel success one { Drive Turn }").until(lambda s: s is NodeStatus.RUNNING)


@pytest.mark.parametrize(
    ("result", "keys", "text", "message"),
    [
        ("{series: last}", "", "Drive", "actions.Step.result: expected fields among sequence"),
        (
            "{sequence: last}",
            "  last: {initial: 0}\n",
            "when last > 1 { Step }",
            "keys.last.field: ",
        ),
        ("{sequence: last}", "", "when last > 1 { Step }", "keys.last: expected `initial`"),
    ],
)
def test_results_that_do_not_fit(
    robot: Callable[[str], Robot],
    monkeypatch: pytest.MonkeyPatch,
    result: str,
    keys: str,
    text: str,
    message: str,
) -> None:
    """A wrong field, or a key that a condition cannot read, is one clear error."""
    mapped(monkeypatch, f"Step: {DRIVE.format(SUCCEEDS, f', result: {result}')}", keys=keys)
    with pytest.raises(IslandError, match=re.escape(message)):
        robot(text)


def test_functions_of_python(
    servers: Servers, robot: Callable[[str], Robot], tmp_path: Path
) -> None:
    """Leaves can be Python functions, which read keys and set those that their arguments name."""
    (tmp_path / "leaves.py").write_text(
        "def Choose(low, high, out, keys):\n"
        "    return {'out': high if keys['battery'] else low}\n"
        "def Pause(ticks):\n"
        "    for _ in range(int(ticks)): yield\n"
        "    return True\n"
    )
    choose = 'Choose(low: 1, high: 2, out: "{n}")'
    machine = robot(f'sequence {{ {choose} Pause(ticks: 3) Drive(order: "{{n}}") }}')
    assert machine.until(lambda _: servers.goals == [1])


def test_paths_of_fields() -> None:
    """A path sets a field of a nested message; a value can be a whole message."""
    pose_stamped = interface("geometry_msgs/msg/PoseStamped")
    path = interface("nav_msgs/msg/Path")(poses=[pose_stamped()])
    message = filled(
        pose_stamped(),
        {"header.frame_id": "map", "pose.position.x": 2, "pose.position": {"y": 3.5}},
        "goal",
    )
    assert (message.header.frame_id, message.pose.position.x) == ("map", 2.0)
    assert message.pose.position.y == 3.5
    result = interface("nav_msgs/srv/GetPlan").Response()
    assert filled(result, {"plan": path}, "result").plan == path
    with pytest.raises(ConfigError, match=r"goal\.pose: expected fields .*'z'"):
        filled(pose_stamped(), {"pose.z": 2}, "goal")
    with pytest.raises(ConfigError, match=r"goal\.pose: expected a value of geometry_msgs/Pose"):
        filled(pose_stamped(), {"pose": path}, "goal")


def test_a_service_is_a_key(servers: Servers, robot: Callable[[str], Robot]) -> None:
    """It is asked again and again."""
    machine = robot("selector { when person { Dock } Wait }")
    assert machine.until(lambda _: servers.goals == [HANGS])
    servers.near = True
    assert machine.until(lambda _: bool(servers.calls))


def test_a_changed_file_is_loaded(servers: Servers, robot: Callable[[str], Robot]) -> None:
    """Goals of the old tree are cancelled; a file with errors changes nothing."""
    machine = robot("Wait")
    assert machine.until(lambda _: servers.goals == [HANGS])
    for text in ("selector {", "Fly", ""):
        machine.file.write_text(text)
        assert not machine.until(lambda _: bool(servers.cancelled), 1.2)
    machine.file.write_text("Dock")
    assert machine.until(lambda _: bool(servers.calls))
    machine.spin(0.3)
    assert eventually(lambda: servers.cancelled == [HANGS])


def test_a_file_that_is_replaced_is_not_changed(
    servers: Servers, robot: Callable[[str], Robot]
) -> None:
    """The goal of a tree goes on while its file is missing, and after it is back."""
    machine = robot("Wait")
    assert machine.until(lambda _: servers.goals == [HANGS])
    machine.file.rename(machine.file.with_suffix(".old"))
    assert not machine.until(lambda _: bool(servers.cancelled), 1.2)
    machine.file.with_suffix(".old").rename(machine.file)
    assert not machine.until(lambda _: bool(servers.cancelled), 1.2)
    assert servers.goals == [HANGS]


def test_fields_are_checked_for_the_tree_that_is_loaded(
    servers: Servers, robot: Callable[[str], Robot], monkeypatch: pytest.MonkeyPatch
) -> None:
    """A condition reads a text in a tree whose vocabulary has its words, and in no other."""
    battery = "battery: {topic: /battery, type: std_msgs/msg/Float32"
    mode = "mode: {topic: /mode, type: std_msgs/msg/String, field: data, default: idle}\n  "
    assert battery in MAP
    monkeypatch.setattr("test_ros2.MAP", MAP.replace(battery, mode + battery))
    actions = ("Drive", "Crash", "Hang", "Wait", "Refused", "Nowhere", "Dock", "Lost")
    keys = {
        "mode": enumeration("", ["idle", "busy"]),
        "battery": number("", 0, 100),
        "person": flag(""),
    }
    words = Vocabulary("bot", {action: Action("") for action in actions}, keys)
    tree = parse("selector { when mode == busy { Dock } Wait }", words)
    with_words = Tree(tree, words, "with words")
    monkeypatch.setattr("islandgp_ros2.node.load_tree", lambda *_: with_words)
    machine = robot("Wait")
    assert machine.until(lambda _: servers.goals == [HANGS])
    other = Tree(parse("selector { when mode > 0 { Dock } Dock }"), None, "other")
    monkeypatch.setattr("islandgp_ros2.node.load_tree", lambda *_: other)
    machine.file.write_text("Dock")
    assert not machine.until(lambda _: bool(servers.cancelled), 1.2)


DECLARED = """{"domain": "cart",
"actions": {
  "Echo": {"meaning": "", "sets": ["swift", "pace", "count", "shelf"], "arguments": {
    "fast": {"sort": "flag", "meaning": "", "default": "no"},
    "speed": {"sort": "number", "meaning": "", "default": 0.5, "low": 0, "high": 9},
    "laps": {"sort": "integer", "meaning": "", "default": 1, "low": 0, "high": 9},
    "place": {"sort": "word", "meaning": "", "words": ["dock", "door"], "default": "dock"}}},
  "Say": {"meaning": "", "arguments": {"text": {"sort": "text", "meaning": "", "default": ""}}},
  "Drive": {"meaning": "", "uses": ["base"]}},
"keys": {
  "swift": {"initial": "no"},
  "pace": {"flag": false, "low": 0, "high": 9, "initial": 0},
  "count": {"flag": false, "low": 0, "high": 9, "whole": true, "initial": 0},
  "shelf": {"words": ["dock", "door"], "initial": "dock"}}}"""
ECHO = """node: robot
actions:
  Echo:
    service: /echo
    type: test_msgs/srv/BasicTypes
    request: {bool_value: fast, float64_value: speed, int32_value: laps, string_value: place}
    result: {bool_value: swift, float64_value: pace, int32_value: count, string_value: shelf}
  Say: {service: /echo, type: test_msgs/srv/BasicTypes, request: {string_value: text}}
  Drive: {action: /drive, type: test_msgs/action/Fibonacci, goal: {order: 1}}
"""


def test_every_declaration(
    servers: Servers,
    robot: Callable[[str], Robot],
    monkeypatch: pytest.MonkeyPatch,
    tmp_path: Path,
) -> None:
    """Each sort of argument reaches its field, and each sort of key is set by a result."""
    monkeypatch.setattr("test_ros2.MAP", ECHO)
    (tmp_path / "robot.json").write_text(DECLARED)
    machine = robot("""sequence {
      Echo(fast: yes, speed: 2.5, laps: 3, place: door)
      when swift and pace == 2.5 and count == 3 and shelf == door { Say(text: "{shelf}") }
      Echo when not swift and pace == 0.5 and count == 1 and shelf == dock { Drive }
      Say(text: "an end") }""")
    assert machine.ended() == NodeStatus.SUCCESS
    assert servers.calls == ["door", "door", "dock", "an end"]


def test_an_exception_ends_the_node() -> None:
    """Executor and node are gone afterwards, and the name is free."""
    context = ros_node("brief")
    node, _ = context.__enter__()
    executor = node.executor
    error = ValueError("in the body")
    assert not context.__exit__(ValueError, error, None)
    assert executor.get_nodes() == []
    with pytest.raises(InvalidHandle):
        node.get_name()


def start(*arguments: object, folder: Path) -> subprocess.Popen[str]:
    """A separate process."""
    root = str(Path(__file__).parents[3])
    code = f"import sys; sys.path[:] = {[root, *sys.path]!r}; " + str(arguments[0])
    return subprocess.Popen(
        [sys.executable, "-c", code, *map(str, arguments[1:])],
        cwd=folder,
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
    )


COMMAND = "from islandgp.cli import main; main()"


def test_the_pages_command(tmp_path: Path, servers: Servers) -> None:
    """The command of README.md runs on the files that the page shows."""
    page = (Path(__file__).parents[1] / "README.md").read_text(encoding="utf-8")
    for name, text in re.findall(r"^```(?:bt|yaml) (\S+)\n(.*?)^```$", page, re.S | re.M):
        (tmp_path / name).write_text(text)
    (command,) = re.findall(r"^```sh\n(.*)\n```$", page, re.M)
    process = start(COMMAND, *shlex.split(command)[1:], "--once", folder=tmp_path)
    end = time.monotonic() + 40
    while process.poll() is None and time.monotonic() < end:
        servers.battery.publish(Float32(data=80.0))
        time.sleep(0.1)
    process.kill()
    output, _ = process.communicate()
    assert process.returncode == 0, output
    assert servers.goals == [SUCCEEDS]
