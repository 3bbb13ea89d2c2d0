"""Blackboard keys of a tree as fields of topics and of responses of services."""

from __future__ import annotations

from collections.abc import Mapping
from math import isfinite
from time import monotonic
from typing import Any

from islandgp.errors import ConfigError
from islandgp_ros2.messages import filled, interface, must_have, value_of
from islandgp_ros2.robot_map import ServiceKey, TopicKey


class RosKey:
    """The last value of one key or condition."""

    def __init__(self, place: str, entry: TopicKey | ServiceKey, sample: Any) -> None:
        """Starts without a value.

        Args:
            place: of the entry in the map, for messages of errors.
            entry: of the map.
            sample: a message of the entry's type.
        """
        self.entry = entry
        self._place, self._sample = f"{place}.field", sample
        self._value: Any = None
        self._at = 0.0  # s, monotonic; when the value came

    def take(self, message: Any) -> None:
        """Handle a message. NaN and infinity, which sensors send for a missing value, are none."""
        value = value_of(message, self.entry.field)
        self._value = None if isinstance(value, float) and not isfinite(value) else value
        self._at = monotonic()

    def check(self, *, text: bool) -> None:
        """Raises ConfigError if the messages have no such field, or one of another type.

        `text`: whether the field can be a text.
        """
        must_have(self._sample, self.entry.field, self._place)
        value = value_of(self._sample, self.entry.field)
        types = (bool, int, float, str) if text else (bool, int, float)
        if "[" not in self.entry.field and not isinstance(value, types):
            expected = "a number, a truth value or a text" if text else "a number or a truth value"
            raise ConfigError(
                f"{self._place}: expected {expected}, found {type(value).__name__}; name a field of"
                " it"
            )

    def read(self) -> Any:
        """The present value; None if there is none or it is too old."""
        if self._value is None:
            return self.entry.default
        if self.entry.max_age is not None and monotonic() - self._at > self.entry.max_age:
            return None
        return self._value


def ros_keys(
    node: Any, entries: Mapping[str, TopicKey | ServiceKey], part: str = "keys"
) -> dict[str, RosKey]:
    """The keys of entries of a map, which receive their values from now on.

    Args:
        node: an rclpy Node, whose executor has to spin.
        entries: the topic or service of each key.
        part: of the map with the entries, for messages of errors.

    Raises:
        ConfigError: an interface is not installed, or a request has no such field.
    """
    return {
        name: _subscribed(node, f"{part}.{name}", entry)
        if isinstance(entry, TopicKey)
        else _requested(node, f"{part}.{name}", entry)
        for name, entry in entries.items()
    }


def _subscribed(node: Any, place: str, entry: TopicKey) -> RosKey:
    from rclpy.qos import QoSProfile, ReliabilityPolicy

    kind = interface(entry.type)
    key = RosKey(place, entry, kind())
    policy = ReliabilityPolicy.RELIABLE if entry.reliable else ReliabilityPolicy.BEST_EFFORT
    node.create_subscription(kind, entry.topic, key.take, QoSProfile(depth=1, reliability=policy))
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
