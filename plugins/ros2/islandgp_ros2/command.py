"""`islandgp ros2`: runs a tree as a ROS 2 node."""

from __future__ import annotations

import signal
import sys
from contextlib import ExitStack
from importlib.util import find_spec
from math import isnan
from pathlib import Path
from typing import Final

import click

from islandgp.errors import ConfigError, IslandError

MAY_RUN: Final = 4
"""Exit code if a cancelled goal may still run."""

_FILE = click.Path(exists=True, dir_okay=False, path_type=Path)


@click.command(epilog="\b\nExample:\n  islandgp ros2 tree.bt --map robot.yaml")
@click.argument("tree", type=_FILE)
@click.option(
    "--map",
    "map_file",
    type=_FILE,
    required=True,
    help="YAML file with the action server, service or topic of each action and key.",
)
@click.option("--rate", type=click.FloatRange(0.1, 1000), default=10.0, help="Ticks per second.")
@click.option(
    "--vocabulary",
    type=_FILE,
    help="Vocabulary of the robot, as for `islandgp check`; default: the domain named in TREE.",
)
@click.option(
    "--once", is_flag=True, help="Stop when the tree succeeds or fails; exit code 0 or 1."
)
@click.option(
    "--leaves",
    "leaves_file",
    type=_FILE,
    help="Python file with functions for leaves that need no server.",
)
@click.option(
    "--view",
    metavar="PORT",
    type=click.IntRange(1, 65_535),
    help="Show the tree at http://127.0.0.1:PORT, with its last minute.",
)
@click.option(
    "--groot",
    metavar="PORT",
    type=click.IntRange(1, 65_535),
    help="Show the tree in Groot2 on this computer; its own default is 1667.",
)
def command(
    tree: Path,
    map_file: Path,
    rate: float,
    vocabulary: Path | None,
    once: bool,
    leaves_file: Path | None,
    view: int | None,
    groot: int | None,
) -> None:
    """Tick the tree in the file TREE as a node of ROS 2.

    Ctrl-C cancels all goals. Exit code 4: a cancelled goal may still run.
    """
    from islandgp_ros2.robot_map import read_map

    robot_map = read_map(map_file)
    if isnan(rate):
        raise click.BadParameter("'nan' is not a number from 0.1 to 1000.", param_hint="'--rate'")
    if sys.path and sys.path[0] in ("", str(Path.cwd())):
        del sys.path[0]  # interfaces must not be imported from the current folder
    if find_spec("rclpy") is None:
        raise ConfigError(
            "Expected rclpy, found it not installed; pip install 'islandgp-ros2[rclpy]', or source"
            " the setup file of your ROS 2"
        )
    if groot and not (find_spec("zmq") and find_spec("msgpack")):
        raise ConfigError(
            "Expected pyzmq and msgpack for --groot, found one not installed;"
            " pip install 'islandgp-ros2[groot]'"
        )
    from islandgp.binding import NodeStatus
    from islandgp_ros2.groot import Groot, groot_served
    from islandgp_ros2.node import TreeNode, ros_node, run
    from islandgp_ros2.view import LastMinute, viewed

    signals: list[int] = []  # no exception, which could interrupt rclpy
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda number, _: signals.append(number))
    with ros_node(robot_map.node) as (node, spin):
        tree_node = TreeNode(node, tree, robot_map, vocabulary, leaves=leaves_file, step_s=1 / rate)
        try:
            with ExitStack() as views:
                if view:
                    minute = LastMinute(tree_node.robot_tree, 1 / rate)
                    tree_node.watchers.append(minute.add)
                    views.enter_context(viewed(minute, view))
                if groot:
                    state = Groot(tree_node.robot_tree)
                    tree_node.watchers.append(state.add)
                    views.enter_context(groot_served(state, groot))
                status = run(spin, tree_node, rate, lambda: bool(signals), once=once)
        except IslandError as error:
            if not tree_node.may_run:
                raise
            click.echo(f"Error: {error}", err=True)
    if tree_node.may_run:
        sys.exit(MAY_RUN)
    if status is None:
        raise click.Abort
    sys.exit(0 if status is NodeStatus.SUCCESS else 1)
