"""The ROS 2 node that ticks a tree, publishes its state, and reloads the tree when it changes."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from functools import partial
from pathlib import Path
from time import monotonic
from typing import Any, Final

from islandgp.binding import NodeStatus, RobotTree, Tree, load_tree
from islandgp.bt.core.includes import find_includes
from islandgp.bt.core.node import walk
from islandgp.bt.core.printer import head
from islandgp.errors import ConfigError, IslandError
from islandgp_ros2.keys import RosKeys, must_be_plain
from islandgp_ros2.leaves import RosLeaves, functions
from islandgp_ros2.requests import Call, Goal
from islandgp_ros2.robot_map import RobotMap

LOOK_S: Final = 0.5  # between two checks of files and topics
STOP_S: Final = 0.02  # most s between two checks whether to stop and which goals can be sent
SILENT: Final = "has not answered the cancellation"
CANCEL_S: Final = 4.0
"""Most s of waiting for cancelled goals at the end; `ros2 launch` sends SIGTERM after 5 s."""


class TreeNode:
    """A tree in a ROS 2 node."""

    def __init__(
        self,
        node: Any,
        file: Path,
        robot_map: RobotMap,
        vocabulary: Path | None = None,
        *,
        leaves: Path | None = None,
        step_s: float | None = None,
    ) -> None:
        """Makes clients and subscriptions of a node.

        Args:
            node: an rclpy Node.
            file: of the tree.
            robot_map: the interfaces of the actions and keys.
            vocabulary: a file with the robot's actions and keys; None: those of the domain that
                the tree names, or any.
            leaves: a Python file with functions for leaves that need no server.
            step_s: seconds between two ticks; needed for a tree that counts time.

        Raises:
            ConfigError: the map names an interface or a field that does not exist, or both files
                have a leaf.
            TreeError, DomainError: the file is not a tree, or the map lacks an action or a key.
        """
        from std_msgs.msg import String

        self._log = node.get_logger()
        self._file, self._vocabulary = file, vocabulary
        self._message, self._step_s = String, step_s
        self._keys = RosKeys(node, robot_map.keys)
        self._actions = RosLeaves(node, robot_map.actions, self._keys)
        self._own = functions(leaves, self._keys) if leaves else {}
        asked = {name: partial(holds, key.read) for name, key in self._keys.all.items()}
        self._leaves = {**asked, **self._actions.leaves}
        if twice := self._own.keys() & self._actions.leaves.keys():
            raise ConfigError(
                f"Expected each leaf in the map or in {leaves}, found {min(twice)} in both; remove"
                " one of them."
            )
        self._stamp = stamp(file)
        self._looked = monotonic()
        self._waits_for: tuple[str, ...] = ()  # keys that topics and services set
        self.robot_tree = self._load()
        self._publisher = node.create_publisher(String, "~/status", 10)
        self._missing: tuple[str, ...] = ()
        self.watchers: list[Callable[[RobotTree, bool], None]] = []
        """Called after each tick; False as the second argument: the tree waits for its keys."""
        self.may_run: list[Goal | Call] = []
        """Goals and calls whose end was not confirmed when the node stopped."""

    def tick(self) -> NodeStatus | None:
        """Ticks the tree once. If a key has no value, stops all actions and returns None.

        Raises:
            ConfigError: a topic has messages of another type.
            DomainError: the value of a key is not a number, a truth value or a declared word.
        """
        if monotonic() - self._looked >= LOOK_S:
            self._looked = monotonic()
            self._reload()
            for key in self._keys.all.values():
                key.look()
        tree = self.robot_tree.tree
        missing = tuple(key for key in self._waits_for if self._keys[key] is None)
        if missing and missing != self._missing:
            self._log.warning(f"waiting for a value of {', '.join(missing)}")
            self.robot_tree.stop()
        self._missing = missing
        status = None if missing else self.robot_tree.tick()
        self._actions.send()
        self._publish(tree, status)
        return status

    def send(self) -> None:
        """Sends the goals of the last tick that waited for a cancellation."""
        self._actions.send()

    def end(self, spin: Callable[[float], None]) -> None:
        """Cancels all goals and waits CANCEL_S seconds for their servers to confirm the end.

        `may_run` then has those without it. `spin`: of `ros_node`.
        """
        self.robot_tree.stop()
        cancelled = self._actions.ending()
        end = monotonic() + CANCEL_S
        while self._actions.ending() and monotonic() < end:
            spin(0.02)
            self._actions.send()
        self.may_run = [each for each in cancelled if not each.is_settled]
        for each in self.may_run:
            self._log.error(
                f"{each.action.name} may still run: {each.place} {each.obstacle or SILENT}"
            )
        self._publish(self.robot_tree.tree, None)

    def _load(self) -> RobotTree:
        tree, keys = load_tree(self._file, self._vocabulary), self._keys
        samples = self._actions.check(tree.calls())
        inputs, sources = {*tree.inputs()}, self._actions.sources(tree.calls())
        for name in {*tree.actions()} & {*keys.all} - {*self._actions.leaves, *self._own}:
            must_be_plain(f"keys.{name}.field", keys.all[name].sample, text=False)
            must_be_plain(f"keys.{name}.default", keys.all[name].default, text=False)
        for name in {*tree.keys()} & {*samples}:
            if name in inputs and name not in keys.all:
                raise ConfigError(
                    f"keys.{name}: expected `initial`, the value before the first result, found"
                    f" no entry; write e.g. `{name}: {{initial: 0}}`"
                )
            words = name in tree.vocabulary.keys and tree.vocabulary.keys[name].words
            must_be_plain(f"keys.{name}.field", samples[name], text=bool(words))
        received = [name for name, key in keys.all.items() if key.is_received]
        known = {*received} - sources | inputs & {*keys.all}
        values = {name: partial(keys.__getitem__, name) for name in known}
        own = {name: leaf for name, leaf in self._own.items() if name in tree.actions()}
        robot_tree = tree.bind({**self._leaves, **own}, values, step_s=self._step_s)
        keys.vocabulary = tree.vocabulary
        self._waits_for = tuple(name for name in received if name in inputs | sources)
        return robot_tree

    def _reload(self) -> None:
        """Reloads the tree if a file has changed; keeps the old tree if the file has errors.

        A file that cannot be read has not changed: an editor may be replacing it.
        """
        new_stamp = stamp(self._file)
        if new_stamp in ((), self._stamp):
            return
        self._stamp = new_stamp
        try:
            changed = self._load()
        except IslandError as error:
            self._log.error(f"the tree stays as it was: {error}")
            return
        self.robot_tree.stop()
        self.robot_tree = changed
        self._log.info(f"{self._file} loaded again")

    def _publish(self, tree: Tree, status: NodeStatus | None) -> None:
        for watch in self.watchers:
            watch(self.robot_tree, status is not None)
        nodes = [
            {"node": head(node), "status": None if end is None else end.name}
            for node, end in zip(walk(tree.node), self.robot_tree.statuses, strict=True)
        ]
        root = None if status is None else status.name
        state = {"tree": tree.name, "status": root, "waits_for": self._missing, "nodes": nodes}
        self._publisher.publish(self._message(data=json.dumps(state)))


def stamp(file: Path) -> tuple[object, ...]:
    """A value that changes when the tree's file or an included one is written.

    Empty if the file cannot be read.
    """
    try:
        text = file.read_text(encoding="utf-8")
        others = find_includes(text, file.parent)
    except (OSError, ValueError):
        return ()
    return (text, *others.items())


def holds(read: Callable[[], object], **_: object) -> bool:
    """True if a key is true; False without a value."""
    return bool(read())


@contextmanager
def ros_node(name: str) -> Iterator[tuple[Any, Callable[[float], None]]]:
    """Context manager: yields a new node and `spin(seconds)`, which runs its callbacks.

    Python keeps handling Ctrl-C, so goals can be cancelled before the end.
    """
    import rclpy
    from rclpy.executors import SingleThreadedExecutor
    from rclpy.signals import SignalHandlerOptions

    context = rclpy.Context()
    rclpy.init(context=context, signal_handler_options=SignalHandlerOptions.NO)
    with ExitStack() as ends:
        ends.callback(rclpy.shutdown, context=context)
        node = rclpy.create_node(name, context=context)
        ends.callback(node.destroy_node)
        executor = SingleThreadedExecutor(context=context)
        executor.add_node(node)
        ends.callback(executor.shutdown)

        def spin(seconds: float) -> None:
            end = monotonic() + seconds
            executor.spin_once(timeout_sec=max(seconds, 0))
            while (remaining := end - monotonic()) > 0:
                executor.spin_once(timeout_sec=remaining)

        yield node, spin


def run(
    spin: Callable[[float], None],
    tree_node: TreeNode,
    rate: float,
    stopping: Callable[[], bool],
    *,
    once: bool = False,
) -> NodeStatus | None:
    """Ticks a tree at a rate (Hz) until `stopping()` or, with `once`, until it has ended.

    All goals are cancelled at the end, also after an exception; `tree_node.may_run` has those
    whose end was not confirmed. `spin`: of `ros_node`.

    Returns:
        The tree's last status; None if it was stopped.
    """
    due = monotonic()
    try:
        while not stopping():
            status = tree_node.tick()
            if once and status in (NodeStatus.SUCCESS, NodeStatus.FAILURE):
                return status
            due = max(due + 1 / rate, monotonic())  # a late tick is not caught up
            spin(0)
            while not stopping() and (remaining := due - monotonic()) > 0:
                spin(min(remaining, STOP_S))
                tree_node.send()
        return None
    finally:
        tree_node.end(spin)
