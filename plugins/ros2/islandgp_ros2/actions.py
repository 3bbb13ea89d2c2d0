"""Actions of a robot map: their goals or requests, and the keys that their results set."""

from __future__ import annotations

import re
from collections.abc import Callable, Container, Mapping
from typing import Any

from islandgp.bt.core.parameters import referenced
from islandgp.errors import ConfigError
from islandgp_ros2.messages import filled, interface, value_of
from islandgp_ros2.robot_map import NAME, ActionServer, ServiceCall


class RosAction:
    """An action of the map: its messages and the keys that they set."""

    def __init__(self, name: str, entry: ActionServer | ServiceCall) -> None:
        """Raises ConfigError if its interface or a field does not exist."""
        self.name, self.entry = name, entry
        self.kind = interface(entry.type)
        self.replaces, self.success = False, None
        if isinstance(entry, ActionServer):
            self.part, self.replaces = "goal", entry.replace
            outputs = [("result", self.kind.Result()), ("feedback", self.kind.Feedback())]
        else:
            self.part, response = "request", self.kind.Response()
            outputs = [("result", response)]
            self.success = entry.success or ("success" if hasattr(response, "success") else None)
            value_of(response, entry.success or "", f"actions.{name}.success")
        self.sets = {
            target: value_of(message, field, f"actions.{name}.{part}")
            for part, message in outputs
            for field, target in getattr(entry, part).items()
        }
        """A value of its type for each key that it sets, or argument that names one."""

    def server(self, arguments: Mapping[str, object]) -> str:
        """The name of its server, which can be the value of an argument. Raises ConfigError."""
        place = self.entry.server
        if not place.startswith("{"):
            return place
        found = str(arguments.get(place[1:-1], ""))
        if not re.fullmatch(NAME, found):
            raise ConfigError(
                f"{self.name}: expected the name of its server as {place[1:-1]}, found {found!r}"
            )
        return found

    def message(
        self,
        arguments: Mapping[str, object],
        keys: Container[str],
        read: Callable[[str], Any],
    ) -> tuple[Any, list[str]]:
        """Its goal or request, and the fields whose keys have no value.

        Args:
            arguments: of the leaf.
            keys: names that are keys if they are the values of fields.
            read: returns the value of a key; None if there is none.

        Raises:
            ConfigError: the arguments do not fit.
        """

        def value(given: object) -> Any:
            key = referenced(given)
            return read(key) if key else given

        fields: dict[str, Any] = {**self.entry.fields}
        used = {*self.sets, *self.entry.ignore, self.entry.server.strip("{}")}
        for path, given in self.entry.fields.items():
            if isinstance(given, str):
                used.add(given)
                known = read(given) if given in keys else given
                fields[path] = value(arguments[given]) if given in arguments else known
        fields |= {path: value(each) for path, each in arguments.items() if path not in used}
        for argument in arguments:
            fields |= self.entry.given.get(argument, {})
        lacks = [path for path, each in fields.items() if each is None]
        values = {path: each for path, each in fields.items() if each is not None}
        empty = self.kind.Goal() if self.part == "goal" else self.kind.Request()
        place = f"actions.{self.name}.{self.part}"
        return filled(empty, values, place), lacks
