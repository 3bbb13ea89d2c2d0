"""Blackboard keys of a tree: fields of topics and of services' responses, and results."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from math import isfinite
from time import monotonic
from typing import Any

from islandgp.bt.core.parameters import referenced
from islandgp.bt.core.vocabulary import EMPTY_VOCABULARY
from islandgp.errors import ConfigError
from islandgp_ros2.messages import filled, interface, must_have, value_of
from islandgp_ros2.robot_map import RobotMap, ServiceKey, TopicKey


class RosKey:
    """The last value of one key or condition that a topic or a service sets."""

    def __init__(self, place: str, entry: TopicKey | ServiceKey, message: Any) -> None:
        """Starts without a value.

        Args:
            place: of the entry in the map, for messages of errors.
            entry: of the map.
            message: an empty one of the entry's type.

        Raises:
            ConfigError: the message has no such field.
        """
        must_have(message, entry.field, f"{place}.field")
        self.place, self._entry = place, entry
        self.sample = value_of(message, entry.field)
        """A value of the field's type; None for an element of an empty list."""
        self.look: Callable[[], None] = lambda: None
        """Compares a topic with its publishers; called twice a second. Raises ConfigError."""
        self.is_received = False
        self._value: Any = None
        self._at = 0.0  # s, monotonic; when the value came

    def take(self, message: Any) -> None:
        """Handle a message. NaN and infinity, which sensors send for a missing value, are none."""
        value = value_of(message, self._entry.field)
        self._value = None if isinstance(value, float) and not isfinite(value) else value
        self._at = monotonic()
        self.is_received = True

    def read(self) -> Any:
        """The present value; None if there is none or it is too old."""
        if self._value is None:
            return self._entry.default
        if self._entry.max_age is not None and monotonic() - self._at > self._entry.max_age:
            return None
        return self._value


class RosKeys:
    """The values of all keys, also of those that results set: `keys["battery"]`."""

    def __init__(self, node: Any, robot_map: RobotMap) -> None:
        """Subscribes to the keys of the map. Raises ConfigError as `received`."""
        self.received = received(node, robot_map)
        initial = {name: getattr(key, "initial", None) for name, key in robot_map.keys.items()}
        self.written = {name: value for name, value in initial.items() if value is not None}
        """Values of the keys that results set; any, also whole messages."""
        self.vocabulary = EMPTY_VOCABULARY  # of the tree

    def __getitem__(self, name: str) -> Any:
        """The present value of a key; None if there is none."""
        return self.received[name].read() if name in self.received else self.written.get(name)

    def value(self, argument: object) -> Any:
        """The value of an argument: of `"{path}"`, that of the key `path`."""
        key = referenced(argument)
        return self[key] if key else argument

    def write(self, action: str, values: Mapping[str, Any], arguments: Mapping[str, Any]) -> Any:
        """Sets keys to the results of an action, except to NaN and infinity.

        Args:
            action: its name.
            values: by key, or by argument that names one.
            arguments: of the action, such as `{"path": "{path}"}`.

        Returns:
            What the leaf returns: the keys that the vocabulary lets it set; True if there is none.
        """
        for name, value in values.items():
            if not isinstance(value, float) or isfinite(value):
                self.written[referenced(arguments.get(name)) or name] = value
        sets = self.vocabulary.action(action).sets
        return {key: self.written[key] for key in sets if key in self.written} or True


def must_be_plain(place: str, sample: object, *, text: bool) -> None:
    """Raises ConfigError if a condition cannot read a field.

    Args:
        place: of the field in the map.
        sample: a value of its type; None if that is not known.
        text: whether it can be a text.
    """
    types = (bool, int, float, str) if text else (bool, int, float)
    if sample is not None and not isinstance(sample, types):
        expected = "a number, a truth value or a text" if text else "a number or a truth value"
        raise ConfigError(
            f"{place}: expected {expected}, found {type(sample).__name__}; name a field of it"
        )


def received(node: Any, robot_map: RobotMap, part: str = "keys") -> dict[str, RosKey]:
    """The keys of a map that topics and services set from now on.

    Args:
        node: an rclpy Node, whose executor has to spin.
        robot_map: the map.
        part: of it with the entries: "keys" or "conditions".

    Raises:
        ConfigError: an interface is not installed, or a message or a request has no such field.
    """
    keys = {}
    for name, entry in getattr(robot_map, part).items():
        if isinstance(entry, TopicKey):
            keys[name] = _subscribed(node, f"{part}.{name}", entry)
        elif isinstance(entry, ServiceKey):
            keys[name] = _requested(node, f"{part}.{name}", entry)
    return keys


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
