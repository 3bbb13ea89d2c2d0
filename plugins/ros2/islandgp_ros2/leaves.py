"""Actions of a tree as goals of action servers and calls of services."""

from __future__ import annotations

from collections.abc import Callable, Generator, Iterable, Mapping
from secrets import token_bytes
from typing import Any

from islandgp_ros2.keys import RosKey
from islandgp_ros2.messages import filled, interface, must_have
from islandgp_ros2.requests import Call, Goal, Request, Server
from islandgp_ros2.robot_map import ActionServer, RobotMap, ServiceCall

RosLeaf = Callable[..., Generator[None, None, bool]]
MakeRequest = Callable[[Any, tuple[str, ...]], Goal | Call]  # of a message and resources


class RosLeaves:
    """The leaves of a map, by action.

    In a tick, cancellations are sent at once. Goals and calls are sent by `send` after it, in the
    order of the leaves, when the cancellations have been answered.
    """

    def __init__(self, node: Any, robot_map: RobotMap, keys: Mapping[str, RosKey]) -> None:
        """Makes a client for each server.

        Args:
            node: an rclpy Node.
            robot_map: the actions, and the keys that their results set.
            keys: values for fields of goals and requests, by name.

        Raises:
            ConfigError: an interface or a field does not exist.
        """
        self._node, self._log = node, node.get_logger()
        self._map, self._keys = robot_map, keys
        self._servers: dict[tuple[str, str], Server] = {}
        self._new: list[Goal | Call] = []  # not sent yet
        self._running: list[Goal | Call] = []
        self.ending: list[Goal | Call] = []
        """Cancelled requests without a confirmed end."""
        self.uses: dict[str, tuple[str, ...]] = {}
        """Resources of each action; an action without an entry uses none."""
        self._fill: dict[str, Callable[..., Any]] = {}
        """A function for each action that makes its goal or request."""
        self.sources = {
            value
            for entry in robot_map.actions.values()
            for value in entry.fields.values()
            if isinstance(value, str) and value in keys
        }
        """Keys that are values of fields."""
        self.leaves = {name: self._leaf(name) for name in robot_map.actions}

    def check(self, calls: Iterable[tuple[str, Mapping[str, object]]]) -> None:
        """Raises ConfigError if the arguments of an action do not fit its goal or request.

        Args:
            calls: the name and the arguments of each leaf; those of other leaves are ignored.
        """
        samples = {key: self._keys[key].sample for key in self.sources}
        for name, arguments in calls:
            if name in self._fill:
                self._fill[name](arguments, samples)

    def send(self) -> None:
        """Sends the goals and calls that have started, if their resources are free.

        One that uses a resource of an earlier one fails. One that uses a resource or the action
        server of a cancelled one waits until that has ended.
        """
        self._running = [
            each for each in self._running if not each.is_cancelled and not each.is_settled
        ]
        self._drop_ended()
        if any(each.awaits_answer for each in self.ending):
            return
        for request in self._new[:]:
            earlier = [*self._running, *self._new[: self._new.index(request)]]
            if request.is_cancelled or request.succeeded is not None:
                self._new.remove(request)
            elif clash := _clash(request, earlier):
                request.fail(f"not sent, because of {clash} and has not ended")
            elif clash := _clash(request, self.ending, same_server=True):
                request.waits_for = f"waited for the end of {clash}, which was cancelled,"
            elif request.is_ready:
                request.send()
                self._log.info(f"{request.name}: sent to {request.place}")
                self._new.remove(request)
                self._running.append(request)
            else:
                request.waits_for = "no server"

    def _drop_ended(self) -> None:
        for request in self.ending[:]:
            if request.is_settled:
                self._log.info(f"{request.name}: ended after its cancellation")
                self.ending.remove(request)
                continue
            request.give_up()
            if request.is_given_up:
                self._log.warning(f"{request.name} may still run: {request.place} does not answer")
                self.ending.remove(request)

    def _leaf(self, name: str) -> RosLeaf:
        """The leaf of an action, a generator function."""
        entry = self._map.actions[name]
        kind = interface(entry.type)
        if isinstance(entry, ActionServer):
            empty, part, request_of = kind.Goal, "goal", self._goals(name, entry, kind)
        else:
            empty, part, request_of = kind.Request, "request", self._calls(name, entry, kind)
        results = [key for key in self._keys.values() if getattr(key.entry, "result", "") == name]

        def fill(arguments: Mapping[str, object], keys: Mapping[str, object]) -> Any:
            named = {**keys, **arguments}
            texts = {path: text for path, text in entry.fields.items() if isinstance(text, str)}
            by_name = {path: named[text] for path, text in texts.items() if text in named}
            direct = {
                name: value for name, value in arguments.items() if name not in texts.values()
            }
            values = {**entry.fields, **by_name, **direct}
            known = {path: value for path, value in values.items() if value is not None}
            return filled(empty(), known, f"actions.{name}.{part}")

        self._fill[name] = fill

        def run(**arguments: object) -> Generator[None, None, bool]:
            values = {key: self._keys[key].read() for key in self.sources}
            for key in entry.fields.values():
                if isinstance(key, str) and key in values and values[key] is None:
                    self._log.warning(f"{name}: failed, the key {key} has no value")
                    return False
            message, uses = fill(arguments, values), self.uses.get(name, ())
            request = request_of(message, uses)
            self._new.append(request)
            try:
                while request.succeeded is None:
                    yield
                    request.check_time()
            finally:
                self._stop(request)
            if request.succeeded:
                self._log.info(f"{name}: succeeded")
                for result in results:
                    result.take(request.result)
            else:
                self._log.warning(f"{name}: failed, {request.reason}")
            return request.succeeded

        return run

    def _stop(self, request: Goal | Call) -> None:
        """Cancels a request unless its server has confirmed its end."""
        if request.is_settled:
            return
        request.cancel()
        if not request.is_settled:
            self._log.info(f"{request.name}: cancelled, its server has to confirm it")
            self.ending.append(request)

    def _goals(self, name: str, entry: ActionServer, kind: Any) -> MakeRequest:
        """Makes goals of an action. Actions share the clients of one server."""
        if (entry.action, entry.type) not in self._servers:
            self._servers[entry.action, entry.type] = Server(self._node, entry.action, kind)
        server = self._servers[entry.action, entry.type]
        limits = entry.timeout, entry.server_timeout
        return lambda message, uses: Goal(
            name, entry.action, *limits, uses, server, message, id=server.prefix + token_bytes(8)
        )

    def _calls(self, name: str, entry: ServiceCall, kind: Any) -> MakeRequest:
        """Makes calls of an action's service."""
        response, field = kind.Response(), entry.success
        if field is not None:
            must_have(response, field, f"actions.{name}.success")
        elif hasattr(response, "success"):
            field = "success"
        client = self._node.create_client(kind, entry.service)
        limits = entry.timeout, entry.timeout
        return lambda message, uses: Call(
            name, entry.service, *limits, uses, client, message, field=field
        )


def _clash(request: Request, others: Iterable[Request], *, same_server: bool = False) -> str:
    """The first of other requests with a resource, or the server, of this one; "" if none."""
    for other in others:
        for resource in other.uses:
            if resource in request.uses:
                return f"{other.name}, which uses {resource}"
        if same_server and other.place == request.place:
            return f"{other.name} of {other.place}"
    return ""
