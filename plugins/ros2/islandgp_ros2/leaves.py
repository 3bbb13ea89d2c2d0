"""Actions of a tree as goals of action servers, calls of services, and Python functions."""

from __future__ import annotations

import re
from collections.abc import Callable, Generator, Iterable, Iterator, Mapping
from contextlib import contextmanager
from functools import partial
from inspect import isfunction, isgeneratorfunction, signature
from pathlib import Path
from secrets import token_bytes
from typing import Any

from islandgp.bt.core.parameters import referenced
from islandgp.errors import ConfigError, IslandError, brief
from islandgp.plugin import raised_in
from islandgp.text_files import read_text_file
from islandgp_ros2.keys import RosKeys
from islandgp_ros2.messages import filled, interface, must_have, value_of
from islandgp_ros2.requests import Call, Goal, Request, Server
from islandgp_ros2.robot_map import NAME, ActionServer, RobotMap, ServiceCall

Calls = Iterable[tuple[str, Mapping[str, object]]]
"""The name and the arguments of each leaf of a tree."""


class RosLeaves:
    """The leaves of a map, by action.

    In a tick, cancellations are sent at once. Goals and calls are sent by `send` after it, in the
    order of the leaves, when the cancellations have been answered.
    """

    def __init__(self, node: Any, robot_map: RobotMap, keys: RosKeys) -> None:
        """Checks the interfaces.

        Args:
            node: an rclpy Node.
            robot_map: the actions, and the keys that their results set.
            keys: values for fields of goals and requests.

        Raises:
            ConfigError: an interface or a field does not exist.
        """
        self._node, self._log = node, node.get_logger()
        self._map, self._keys = robot_map.actions, keys
        self._clients: dict[tuple[str, str], Any] = {}  # by server and type
        self._new: list[Goal | Call] = []  # not sent yet
        self._running: list[Goal | Call] = []
        self.ending: list[Goal | Call] = []
        """Cancelled requests without a confirmed end."""
        self._kinds = {name: interface(entry.type) for name, entry in self._map.items()}
        for name, entry in self._map.items():
            for part, fields, message in self._results(name):
                for field in fields:
                    must_have(message, field, f"actions.{name}.{part}")
            if isinstance(entry, ServiceCall) and entry.success is not None:
                must_have(self._kinds[name].Response(), entry.success, f"actions.{name}.success")
        results = (each for name in self._map for _, each, _ in self._results(name))
        written = (key for fields in results for key in fields.values())
        self._names = {*keys.received, *keys.written, *written}
        self.leaves = {name: partial(self._run, name) for name in self._map}

    def sources(self, calls: Calls) -> set[str]:
        """The keys that are values of fields of goals and requests."""
        named = {referenced(value) for _, arguments in calls for value in arguments.values()}
        fields = (self._map[name].fields.values() for name, _ in calls if name in self._map)
        return named | {value for each in fields for value in each if isinstance(value, str)}

    def check(self, calls: Calls) -> dict[str, Any]:
        """Makes the clients.

        Returns:
            A value of its type for each key, as far as that is known.

        Raises:
            ConfigError: the arguments of an action do not fit its goal or request.
        """
        ours = [(name, arguments) for name, arguments in calls if name in self._map]
        samples = {name: key.sample for name, key in self._keys.received.items()}
        for name, arguments in ours:
            for _, fields, message in self._results(name):
                for field, target in fields.items():
                    key = referenced(arguments.get(target)) or target
                    samples[key] = value_of(message, field)
        for name, arguments in ours:
            self._message(name, arguments, samples.get)
            self._client(self._place(name, arguments), name)
        return samples

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

    def _results(self, name: str) -> list[tuple[str, Mapping[str, str], Any]]:
        """The part of an action's entry, its keys by field, and an empty message, of each."""
        entry, kind = self._map[name], self._kinds[name]
        if isinstance(entry, ServiceCall):
            return [("result", entry.result, kind.Response())]
        return [
            ("result", entry.result, kind.Result()),
            ("feedback", entry.feedback, kind.Feedback()),
        ]

    def _place(self, name: str, arguments: Mapping[str, object]) -> str:
        """The name of an action's server, which can be the value of an argument."""
        place = self._map[name].server
        if not place.startswith("{"):
            return place
        found = str(arguments.get(place[1:-1], ""))
        if not re.fullmatch(NAME, found):
            raise ConfigError(
                f"{name}: expected the name of its server as {place[1:-1]}, found {found!r}"
            )
        return found

    def _client(self, place: str, name: str) -> Any:
        """The client of a server, which the actions with it share."""
        entry, kind = self._map[name], self._kinds[name]
        if (place, entry.type) not in self._clients:
            makes = Server if isinstance(entry, ActionServer) else _service_client
            self._clients[place, entry.type] = makes(self._node, place, kind)
        return self._clients[place, entry.type]

    def _message(
        self, name: str, arguments: Mapping[str, object], read: Callable[[str], Any]
    ) -> tuple[Any, list[str]]:
        """The goal or request of an action, and the keys that it lacks.

        `read`: returns the value of a key; None if there is none.
        """
        entry, lacks = self._map[name], []

        def value(given: object) -> Any:
            key = referenced(given)
            if key and read(key) is None:
                lacks.append(key)
            return read(key) if key else given

        def field(given: str) -> Any:
            if given in arguments:
                return value(arguments[given])
            return value(f"{{{given}}}") if given in self._names else given

        server = (arg for arg in arguments if f"{{{arg}}}" == entry.server)
        texts = {path: given for path, given in entry.fields.items() if isinstance(given, str)}
        results = {target for _, fields, _ in self._results(name) for target in fields.values()}
        used = {*texts.values(), *results, *server}
        values = {
            **entry.fields,
            **{path: field(given) for path, given in texts.items()},
            **{path: value(given) for path, given in arguments.items() if path not in used},
        }
        known = {path: each for path, each in values.items() if each is not None}
        kind, part = self._kinds[name], "goal" if isinstance(entry, ActionServer) else "request"
        empty = kind.Goal() if part == "goal" else kind.Request()
        return filled(empty, known, f"actions.{name}.{part}"), lacks

    def _request(self, name: str, message: Any, arguments: Mapping[str, object]) -> Goal | Call:
        entry, place = self._map[name], self._place(name, arguments)
        client, uses = self._client(place, name), self._keys.vocabulary.action(name).uses
        if isinstance(entry, ActionServer):
            limits = entry.timeout, entry.server_timeout
            number = client.prefix + token_bytes(8)
            request: Goal | Call = Goal(name, place, *limits, uses, client, message, id=number)
        else:
            default = "success" if hasattr(self._kinds[name].Response(), "success") else None
            field, limits = entry.success or default, (entry.timeout, entry.timeout)
            request = Call(name, place, *limits, uses, client, message, field=field)
        self._new.append(request)
        return request

    def _run(self, name: str, /, **arguments: object) -> Generator[None, None, Any]:
        """The leaf of an action."""
        entry = self._map[name]
        message, lacks = self._message(name, arguments, self._keys.__getitem__)
        if lacks:
            self._log.warning(f"{name}: failed, the key {lacks[0]} has no value")
            return False
        request, earlier = self._request(name, message, arguments), None
        renews = isinstance(entry, ActionServer) and entry.replace
        try:
            while request.succeeded is None:
                yield
                request.check_time()
                if request.feedback is not None and isinstance(entry, ActionServer):
                    self._keys.write(name, _fields(request.feedback, entry.feedback), arguments)
                if not (renews and request.is_accepted):
                    continue
                if earlier is not None:
                    self._stop(earlier)
                    earlier = None
                elif newer := self._newer(request, arguments):
                    request, earlier = newer, request
        finally:
            for each in (earlier, request):
                self._stop(each)
        ends = True
        if request.result is not None:
            ends = self._keys.write(name, _fields(request.result, entry.result), arguments)
        if request.succeeded:
            self._log.info(f"{name}: succeeded")
            return ends
        self._log.warning(f"{name}: failed, {request.reason}")
        return False

    def _newer(self, request: Goal | Call, arguments: Mapping[str, object]) -> Goal | Call | None:
        """A goal with the present keys, which replaces one; None if they have not changed."""
        message, lacks = self._message(request.name, arguments, self._keys.__getitem__)
        if lacks or message == request.message:
            return None
        newer = self._request(request.name, message, arguments)
        newer.replaces = request
        return newer

    def _stop(self, request: Goal | Call | None) -> None:
        """Cancels a request unless its server has confirmed its end."""
        if request is None or request.is_settled:
            return
        request.cancel()
        if not request.is_settled:
            self._log.info(f"{request.name}: cancelled, its server has to confirm it")
            self.ending.append(request)


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

    def start(arguments: Mapping[str, object]) -> Any:
        values = {name: keys.value(argument) for name, argument in arguments.items()}
        return function(**{**values, **has_keys})

    def end(result: Any, arguments: Mapping[str, object]) -> Any:
        is_mapping = isinstance(result, Mapping)
        return keys.write(function.__name__, result, arguments) if is_mapping else result

    def call(**arguments: object) -> Any:
        with _named(function):
            return end(start(arguments), arguments)

    def run(**arguments: object) -> Generator[None, None, Any]:
        with _named(function):
            return end((yield from start(arguments)), arguments)

    return run if isgeneratorfunction(function) else call


@contextmanager
def _named(function: Callable[..., Any]) -> Iterator[None]:
    """Context manager: an exception of a function becomes a ConfigError with its place."""
    try:
        yield
    except IslandError:
        raise
    except Exception as error:
        reason = f"{type(error).__name__}: {brief(error)}{raised_in(error)}"
        raise ConfigError(
            f"Expected no exception of the function {function.__name__}, found {reason}; correct"
            " the file of --leaves"
        ) from error


def _fields(message: Any, fields: Mapping[str, str]) -> dict[str, Any]:
    """Values of a message's fields by key, for the keys by field."""
    return {key: value_of(message, field) for field, key in fields.items()}


def _service_client(node: Any, place: str, kind: Any) -> Any:
    return node.create_client(kind, place)


def _clash(request: Request, others: Iterable[Request], *, same_server: bool = False) -> str:
    """The first of other requests with a resource, or the server, of this one; "" if none."""
    for other in others:
        if other is request.replaces:
            continue
        for resource in other.uses:
            if resource in request.uses:
                return f"{other.name}, which uses {resource}"
        if same_server and other.place == request.place:
            return f"{other.name} of {other.place}"
    return ""
