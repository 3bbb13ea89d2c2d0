"""Blackboard keys of a tree as fields of topics, of services' responses and of results."""

from __future__ import annotations

from collections.abc import Callable
from math import isfinite
from time import monotonic
from typing import Any

from islandgp.errors import ConfigError
from islandgp_ros2.messages import filled, interface, must_have, value_of
from islandgp_ros2.robot_map import ActionServer, ResultKey, RobotMap, ServiceKey, TopicKey


class RosKey:
    """The last value of one key or condition."""

    def __init__(self, place: str, entry: TopicKey | ServiceKey | ResultKey, message: Any) -> None:
        """Starts without a value.

        Args:
            place: of the entry in the map, for messages of errors.
            entry: of the map.
            message: an empty one of the entry's type.

        Raises:
            ConfigError: the message has no such field.
        """
        must_have(message, entry.field, f"{place}.field")
        self.entry, self.place = entry, place
        self.sample = value_of(message, entry.field)
        """A value of the field's type; None for an element of an empty list."""
        self.look: Callable[[], None] = lambda: None
        """Compares a topic with its publishers; called twice a second. Raises ConfigError."""
        self.is_received = False
        self._value: Any = None
        self._at = 0.0  # s, monotonic; when the value came

    def take(self, message: Any) -> None:
        """Handle a message. NaN and infinity, which sensors send for a missing value, are none."""
        value = value_of(message, self.entry.field)
        self._value = None if isinstance(value, float) and not isfinite(value) else value
        self._at = monotonic()
        self.is_received = True

    def check(self, *, text: bool) -> None:
        """Raises ConfigError if a condition cannot read the field.

        `text`: whether the field can be a text.
        """
        types = (bool, int, float, str) if text else (bool, int, float)
        if "[" not in self.entry.field and not isinstance(self.sample, types):
            expected = "a number, a truth value or a text" if text else "a number or a truth value"
            raise ConfigError(
                f"{self.place}.field: expected {expected}, found {type(self.sample).__name__}; name"
                " a field of it"
            )
        if isinstance(self.entry, ResultKey) and self.entry.default is None:
            raise ConfigError(
                f"{self.place}: expected `default`, found none; a tree that reads the key would"
                f" wait for a result of {self.entry.result} and never start it"
            )

    def read(self) -> Any:
        """The present value; None if there is none or it is too old."""
        if self._value is None:
            return self.entry.default
        if self.entry.max_age is not None and monotonic() - self._at > self.entry.max_age:
            return None
        return self._value


def ros_keys(node: Any, robot_map: RobotMap, part: str = "keys") -> dict[str, RosKey]:
    """The keys of a map, which receive their values from now on.

    Args:
        node: an rclpy Node, whose executor has to spin.
        robot_map: the map.
        part: of it with the entries: "keys" or "conditions".

    Raises:
        ConfigError: an interface is not installed, or a message or a request has no such field.
    """
    keys = {}
    for name, entry in getattr(robot_map, part).items():
        place = f"{part}.{name}"
        if isinstance(entry, TopicKey):
            keys[name] = _subscribed(node, place, entry)
        elif isinstance(entry, ServiceKey):
            keys[name] = _requested(node, place, entry)
        else:
            keys[name] = _result(place, entry, robot_map)
    return keys


def _result(place: str, entry: ResultKey, robot_map: RobotMap) -> RosKey:
    """A key that the leaves of an action set."""
    action = robot_map.actions.get(entry.result)
    if action is None:
        raise ConfigError(
            f"{place}.result: expected an action of the map, found {entry.result!r}"
            f" (actions: {', '.join(robot_map.actions)})"
        )
    kind = interface(action.type)
    return RosKey(
        place, entry, (kind.Result if isinstance(action, ActionServer) else kind.Response)()
    )


def _subscribed(node: Any, place: str, entry: TopicKey) -> RosKey:
    """A key that is a field of a topic. It also gets a message that was published before."""
    from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy

    kind = interface(entry.type)
    key = RosKey(place, entry, kind())
    reliable, latched = ReliabilityPolicy.RELIABLE, DurabilityPolicy.TRANSIENT_LOCAL

    def subscribe(*, keeps: bool) -> Any:
        profile = QoSProfile(
            depth=1,
            reliability=reliable if keeps or entry.reliable else ReliabilityPolicy.BEST_EFFORT,
            durability=latched if keeps else DurabilityPolicy.VOLATILE,
        )
        return node.create_subscription(kind, entry.topic, key.take, profile), keeps

    current = subscribe(keeps=False)

    def look() -> None:
        nonlocal current
        publishers = node.get_publishers_info_by_topic(entry.topic)
        types = {each.topic_type for each in publishers}
        if types and entry.type not in types and not key.is_received:
            raise ConfigError(
                f"{place}.type: expected the type of {entry.topic}, {', '.join(sorted(types))},"
                f" found {entry.type}"
            )
        profiles = [each.qos_profile for each in publishers]
        keeps = all(p.durability == latched and p.reliability == reliable for p in profiles)
        if publishers and keeps != current[1]:
            node.destroy_subscription(current[0])
            current = subscribe(keeps=keeps)

    key.look = look
    return key


def _requested(node: Any, place: str, entry: ServiceKey) -> RosKey:
    kind = interface(entry.type)
    request = filled(kind.Request(), entry.request, f"{place}.request")
    key = RosKey(place, entry, kind.Response())
    client = node.create_client(kind, entry.service)
    waiting: list[Any] = []

    def ask() -> None:
        if waiting and not waiting[0].done() and client.service_is_ready():
            return
        for pending in waiting:
            client.remove_pending_request(pending)
        waiting.clear()
        if client.service_is_ready():
            waiting.append(client.call_async(request))
            waiting[0].add_done_callback(lambda done: key.take(done.result()))

    node.create_timer(entry.every, ask)
    return key
