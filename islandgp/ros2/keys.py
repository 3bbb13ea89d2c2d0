"""Blackboard keys of a tree as fields of topics and of responses of services."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping
from math import isfinite
from time import monotonic
from typing import Any

from islandgp.errors import ConfigError
from islandgp.ros2.messages import filled, interface, must_have, value_of
from islandgp.ros2.robot_map import ServiceKey, TopicKey


class RosKey:
    """The last value of one key."""

    def __init__(self, name: str, entry: TopicKey | ServiceKey, *, texts: bool) -> None:
        self.name, self.entry, self.texts = name, entry, texts
        self._value: Any = None
        self._at = 0.0  # s, monotonic; when the value came

    def take(self, message: Any) -> None:
        """Handle a message. NaN is not used as a value, as sensors send it for a missing one."""
        value = value_of(message, self.entry.field)
        self._value = None if isinstance(value, float) and not isfinite(value) else value
        self._at = monotonic()

    def check(self, message: Any) -> None:
        """Raises ConfigError if the message has no such field, or one of another type."""
        field, place = self.entry.field, f"keys.{self.name}.field"
        must_have(message, field, place)
        value = value_of(message, field)
        types = (bool, int, float, str) if self.texts else (bool, int, float)
        if "[" not in field and not isinstance(value, types):
            expected = (
                "a number, a truth value or a text" if self.texts else "a number or a truth value"
            )
            raise ConfigError(
                f"{place}: expected {expected}, found {type(value).__name__}; name a field of it"
            )

    def read(self) -> Any:
        """The present value; None if there is none or it is too old."""
        if self._value is None:
            return self.entry.default
        if self.entry.max_age is not None and monotonic() - self._at > self.entry.max_age:
            return None
        return self._value


def ros_keys(
    node: Any, entries: Mapping[str, TopicKey | ServiceKey], *, texts: Collection[str] = ()
) -> dict[str, Callable[[], Any]]:
    """A function for each key that returns its value now, or None if it has none.

    Args:
        node: an rclpy Node, whose executor has to spin.
        entries: the topic or service of each key.
        texts: the keys whose field can be a text: those with declared words.

    Raises:
        ConfigError: an interface is not installed, or a field does not fit.
    """
    keys = [RosKey(name, entry, texts=name in texts) for name, entry in entries.items()]
    for key in keys:
        if isinstance(key.entry, TopicKey):
            _subscribe(node, key, key.entry)
        else:
            _ask(node, key, key.entry)
    return {key.name: key.read for key in keys}


def _subscribe(node: Any, key: RosKey, entry: TopicKey) -> None:
    from rclpy.qos import QoSProfile, ReliabilityPolicy

    kind = interface(entry.type)
    key.check(kind())
    policy = ReliabilityPolicy.RELIABLE if entry.reliable else ReliabilityPolicy.BEST_EFFORT
    node.create_subscription(kind, entry.topic, key.take, QoSProfile(depth=1, reliability=policy))


def _ask(node: Any, key: RosKey, entry: ServiceKey) -> None:
    kind = interface(entry.type)
    request = filled(kind.Request(), entry.request, f"keys.{key.name}.request")
    key.check(kind.Response())
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
