"""Blackboard keys of a tree: fields of topics and of services' responses, and results."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from math import isfinite
from time import monotonic
from typing import Any, Final

from islandgp.bt.core.parameters import referenced
from islandgp.bt.core.vocabulary import EMPTY_VOCABULARY
from islandgp.errors import ConfigError
from islandgp_ros2.messages import filled, interface, value_of
from islandgp_ros2.robot_map import ServiceKey, TopicKey, WrittenKey

LOST_S: Final = 5.0  # after which a request without an answer is repeated


@dataclass
class RosKey:
    """The last value of a key, which a topic, a service or a result sets."""

    place: str  # of the entry in the map, for messages of errors
    default: Any = None  # before the first value
    max_age: float | None = None  # s; an older value is none
    sample: Any = None  # a value of its type; None if that is not known
    is_received: bool = False  # from a topic or a service; the tree waits for it
    look: Callable[[], None] = lambda: None
    """Compares a topic with its publishers; called twice a second. Raises ConfigError."""
    value: Any = None
    at: float = 0.0  # s, monotonic; when the value came

    def set(self, value: Any) -> None:
        """Changes the value. NaN and infinity, which sensors send for a missing one, are none."""
        self.value = None if isinstance(value, float) and not isfinite(value) else value
        self.at = monotonic()

    def read(self) -> Any:
        """The present value; None if there is none or it is too old."""
        if self.value is None:
            return self.default
        is_old = self.max_age is not None and monotonic() - self.at > self.max_age
        return None if is_old else self.value


class RosKeys:
    """The values of all keys: `keys["battery"]`."""

    def __init__(self, node: Any, entries: Mapping[str, TopicKey | ServiceKey | WrittenKey]):
        """Topics and services set their keys from now on.

        Args:
            node: an rclpy Node, whose executor has to spin.
            entries: of the map.

        Raises:
            ConfigError: an interface is not installed, or a message or a request has no such field.
        """
        self.all = {name: _key(node, f"keys.{name}", entry) for name, entry in entries.items()}
        self.vocabulary = EMPTY_VOCABULARY  # of the tree

    def __getitem__(self, name: str) -> Any:
        """The present value of a key; None if there is none."""
        return self.all[name].read() if name in self.all else None

    def value(self, argument: object) -> Any:
        """The value of an argument: of `"{path}"`, that of the key `path`."""
        key = referenced(argument)
        return self[key] if key else argument

    def write(self, action: str, values: Mapping[str, Any], arguments: Mapping[str, Any]) -> Any:
        """Sets keys to the results of an action; a topic's key until the next message.

        Args:
            action: its name.
            values: by key, or by argument that names one; any, also whole messages.
            arguments: of the action, such as `{"path": "{path}"}`.

        Returns:
            What the leaf returns: the keys that the vocabulary lets it set; True if there is none.
        """
        for name, value in values.items():
            key = referenced(arguments.get(name)) or name
            self.all.setdefault(key, RosKey(f"keys.{key}")).set(value)
        sets = self.vocabulary.action(action).sets
        return {key: self[key] for key in sets if self[key] is not None} or True


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


def _key(node: Any, place: str, entry: TopicKey | ServiceKey | WrittenKey) -> RosKey:
    if isinstance(entry, WrittenKey):
        return RosKey(place, entry.initial, sample=entry.initial)
    kind = interface(entry.type)
    message = kind() if isinstance(entry, TopicKey) else kind.Response()
    sample = value_of(message, entry.field, f"{place}.field")
    key = RosKey(place, entry.default, entry.max_age, sample, is_received=True)
    if isinstance(entry, TopicKey):
        _subscribe(node, key, entry, kind)
    else:
        _request(node, key, entry, kind)
    return key


def _subscribe(node: Any, key: RosKey, entry: TopicKey, kind: Any) -> None:
    from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy

    latched, reliable = DurabilityPolicy.TRANSIENT_LOCAL, ReliabilityPolicy.RELIABLE
    live = reliable if entry.reliable else ReliabilityPolicy.BEST_EFFORT
    profiles = [QoSProfile(depth=1, reliability=live)]

    def take(message: Any) -> None:
        key.set(value_of(message, entry.field))

    def look() -> None:
        publishers = node.get_publishers_info_by_topic(entry.topic)
        types = {each.topic_type for each in publishers}
        if types and entry.type not in types and key.value is None:
            raise ConfigError(
                f"{key.place}.type: expected the type of {entry.topic}, {', '.join(sorted(types))},"
                f" found {entry.type}"
            )
        keeps = [each.qos_profile for each in publishers if each.qos_profile.durability == latched]
        if len(profiles) == 1 and any(each.reliability == reliable for each in keeps):
            profiles.append(QoSProfile(depth=1, durability=latched))  # gets the last message
            node.create_subscription(kind, entry.topic, take, profiles[1])

    key.look = look
    node.create_subscription(kind, entry.topic, take, profiles[0])


def _request(node: Any, key: RosKey, entry: ServiceKey, kind: Any) -> None:
    request = filled(kind.Request(), entry.request, f"{key.place}.request")
    client = node.create_client(kind, entry.service)
    pending: Any = None
    asked = 0.0  # s, monotonic

    def ask() -> None:
        nonlocal pending, asked
        if not client.service_is_ready():
            return
        if pending is not None and not pending.done():
            if monotonic() - asked < LOST_S:
                return
            client.remove_pending_request(pending)
        pending, asked = client.call_async(request), monotonic()
        pending.add_done_callback(lambda done: key.set(value_of(done.result(), entry.field)))

    node.create_timer(entry.every, ask)
