"""Actions of a tree as goals of action servers, calls of services, and Python functions."""

from __future__ import annotations

from collections.abc import Callable, Generator, Iterable, Mapping
from functools import partial
from inspect import isfunction, isgenerator, signature
from pathlib import Path
from time import monotonic
from typing import Any

from islandgp.bt.core.node import RUNNING
from islandgp.bt.core.parameters import referenced
from islandgp.errors import ConfigError, IslandError, brief
from islandgp.plugin import raised_in
from islandgp.text_files import read_text_file
from islandgp_ros2.actions import RosAction
from islandgp_ros2.keys import RosKeys
from islandgp_ros2.messages import value_of
from islandgp_ros2.requests import Call, Goal, Request, Server
from islandgp_ros2.robot_map import ActionServer, ServiceCall

Calls = Iterable[tuple[str, Mapping[str, object]]]
"""The name and the arguments of each leaf of a tree."""


class RosLeaves:
    """The leaves of a map, by action.

    In a tick, cancellations are sent at once. Goals and calls are sent by `send` after it, in the
    order of the leaves, when the cancellations have been answered.
    """

    def __init__(
        self, node: Any, entries: Mapping[str, ActionServer | ServiceCall], keys: RosKeys
    ) -> None:
        """Checks the interfaces.

        Args:
            node: an rclpy Node.
            entries: the actions of the map.
            keys: values for fields of goals and requests, and those that results set.

        Raises:
            ConfigError: an interface or a field does not exist.
        """
        self._node, self._log, self._keys = node, node.get_logger(), keys
        self._actions = {name: RosAction(name, entry) for name, entry in entries.items()}
        self._names = {*keys.all, *(key for each in self._actions.values() for key in each.sets)}
        self._clients: dict[tuple[str, str], Any] = {}  # by server and type
        self._open: list[Goal | Call] = []  # without a confirmed end
        self.leaves = {name: partial(self._run, each) for name, each in self._actions.items()}

    def sources(self, calls: Calls) -> set[str]:
        """The keys that are values of fields of goals and requests."""
        named = {referenced(value) for _, arguments in calls for value in arguments.values()}
        actions = (self._actions[name] for name, _ in calls if name in self._actions)
        fields = (value for each in actions for value in each.entry.fields.values())
        return named | {value for value in fields if isinstance(value, str)}

    def check(self, calls: Calls) -> dict[str, Any]:
        """Makes the clients.

        Returns:
            A value of its type for each key, as far as that is known.

        Raises:
            ConfigError: the arguments of an action do not fit its goal or request.
        """
        ours = [(self._actions[name], each) for name, each in calls if name in self._actions]
        samples = {name: key.sample for name, key in self._keys.all.items()}
        for action, arguments in ours:
            for target, sample in action.sets.items():
                samples[referenced(arguments.get(target)) or target] = sample
        for action, arguments in ours:
            action.message(arguments, self._names, samples.get)
            self._client(action, action.server(arguments))
        return samples

    def send(self) -> None:
        """Sends the goals and calls that have started, if their resources are free.

        One that uses a resource of an earlier one fails. One that uses a resource or the action
        server of a cancelled one waits until that has ended.
        """
        self._open = [each for each in self._open if not self._has_ended(each)]
        if any(each.awaits_answer for each in self.ending()):
            return
        for at, request in enumerate(self._open):
            if request.sent_at is not None or request.succeeded is not None:
                continue
            going = [each for each in self._open if each.cancelled_at is None]
            earlier = [each for each in going if each.sent_at or each in self._open[:at]]
            if clash := _clash(request, earlier):
                request.fail(f"not sent, because of {clash} and has not ended")
            elif clash := _clash(request, self.ending(), same_server=True):
                request.waits_for = f"waited for the end of {clash}, which was cancelled,"
            elif request.client.service_is_ready():
                request.send()
                self._log.info(f"{request.action.name}: sent to {request.place}")
            else:
                request.waits_for = "no server"

    def ending(self) -> list[Goal | Call]:
        """Cancelled requests without a confirmed end."""
        return [each for each in self._open if each.cancelled_at and not each.is_settled]

    def _has_ended(self, request: Goal | Call) -> bool:
        """Whether nothing of a request runs, or its server has not said so for too long."""
        name, was_cancelled = request.action.name, request.cancelled_at is not None
        if request.is_settled and was_cancelled and request.sent_at:
            self._log.info(f"{name}: ended after its cancellation")
        if request.is_settled or not (was_cancelled and request.gives_up()):
            return request.is_settled
        self._log.warning(f"{name} may still run: {request.place} does not answer")
        return True

    def _client(self, action: RosAction, place: str) -> Any:
        """The client of a server, which the actions with it share."""
        if (key := (place, action.entry.type)) not in self._clients:
            makes = Server if action.part == "goal" else _service_client
            self._clients[key] = makes(self._node, place, action.kind)
        return self._clients[key]

    def _start(
        self, action: RosAction, message: Any, arguments: Mapping[str, object]
    ) -> Goal | Call:
        place, uses = action.server(arguments), self._keys.vocabulary.action(action.name).uses
        makes = Goal if action.part == "goal" else Call
        request: Goal | Call = makes(action, place, self._client(action, place), message, uses)
        self._open.append(request)
        return request

    def _run(self, action: RosAction, /, **arguments: object) -> Generator[None, None, Any]:
        """The leaf of an action."""

        def write(message: Any, part: str) -> Any:
            fields = getattr(action.entry, part) if message is not None else {}
            values = {key: value_of(message, field) for field, key in fields.items()}
            return self._keys.write(action.name, values, arguments)

        message, lacks = action.message(arguments, self._names, self._keys.__getitem__)
        if lacks:
            self._log.warning(f"{action.name}: failed, {action.part}.{lacks[0]} has no value")
            return False
        request, earlier = self._start(action, message, arguments), None
        try:
            while request.succeeded is None:
                yield
                request.check_time()
                write(request.feedback, "feedback")
                if action.replaces and request.is_accepted:
                    self._stop(earlier)
                    earlier = None
                    message, lacks = action.message(arguments, self._names, self._keys.__getitem__)
                    if not lacks and message != request.message:
                        earlier, request = request, self._start(action, message, arguments)
                        request.replaces = earlier
        finally:
            for each in (earlier, request):
                self._stop(each)
        ends = write(request.result, "result")
        if request.succeeded:
            self._log.info(f"{action.name}: succeeded")
            return ends
        self._log.warning(f"{action.name}: failed, {request.reason}")
        return False

    def _stop(self, request: Goal | Call | None) -> None:
        """Cancels a request unless its server has confirmed its end."""
        if request is None or request.is_settled:
            return
        request.cancelled_at = monotonic()
        if request.sent_at is None:
            request.is_settled = True
            return
        request.cancel()
        self._log.info(f"{request.action.name}: cancelled, its server has to confirm it")


def functions(file: Path, keys: RosKeys) -> dict[str, Callable[..., Any]]:
    """The functions of a Python file as leaves, by name.

    A function is called as `islandgp.leaves` describes. `"{path}"` as an argument is the value of
    the key `path`, and an argument `keys` has all keys. In place of True it can return a mapping,
    the values of keys, or of arguments that name keys.

    Raises:
        ConfigError: the file has an error.
    """
    names: dict[str, Any] = {"__name__": file.stem}
    try:
        exec(compile(read_text_file(file), str(file), "exec"), names)
    except Exception as error:
        raise ConfigError(f"{file}: expected functions of Python, found {brief(error)}") from error
    return {
        name: _function_leaf(function, keys)
        for name, function in names.items()
        if isfunction(function) and function.__module__ == file.stem
    }


def _function_leaf(function: Callable[..., Any], keys: RosKeys) -> Callable[..., Any]:
    has_keys = {"keys": keys} if "keys" in signature(function).parameters else {}

    def run(**arguments: object) -> Generator[None, None, Any]:
        try:
            while True:
                values = {name: keys.value(argument) for name, argument in arguments.items()}
                result = function(**{**values, **has_keys})
                if isgenerator(result):
                    result = yield from result
                if isinstance(result, Mapping):
                    return keys.write(function.__name__, result, arguments)
                if result != RUNNING:
                    return result
                yield
        except IslandError:
            raise
        except Exception as error:
            reason = f"{type(error).__name__}: {brief(error)}{raised_in(error)}"
            raise ConfigError(
                f"Expected no exception of the function {function.__name__}, found {reason};"
                " correct the file of --leaves"
            ) from error

    return run


def _service_client(node: Any, place: str, kind: Any) -> Any:
    return node.create_client(kind, place)


def _clash(request: Request, others: Iterable[Request], *, same_server: bool = False) -> str:
    """The first of other requests with a resource, or the server, of this one; "" if none."""
    for other in others:
        if other is request.replaces:
            continue
        for resource in other.uses:
            if resource in request.uses:
                return f"{other.action.name}, which uses {resource}"
        if same_server and other.place == request.place:
            return f"{other.action.name} of {other.place}"
    return ""
