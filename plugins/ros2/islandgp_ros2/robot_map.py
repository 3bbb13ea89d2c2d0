"""The robot map: a file with the action server, service or topic of each action and key."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Annotated, Any, Final

import yaml
from pydantic import BaseModel, Field, FiniteFloat, ValidationError

from islandgp.bt.core.source import shown
from islandgp.errors import ConfigError
from islandgp.text_files import read_text_file

_MAX_CHARACTERS: Final = 100_000  # characters
NAME: Final = r"^~?/?[A-Za-z_][A-Za-z0-9_]*(/[A-Za-z_][A-Za-z0-9_]*)*$"
"""Pattern of names of servers and topics."""
_NAME: Final = Field(pattern=NAME, max_length=200)
_PART: Final = r"[a-z][a-z0-9_]*(\[[0-9]{1,6}\])?"
_FIELD: Final = Field(pattern=rf"^{_PART}(\.{_PART})*$")
_Seconds = Annotated[float, Field(gt=0, le=86_400)]
_Value = FiniteFloat | bool | str
_SERVER: Final = Field(pattern=rf"{NAME}|^\{{[a-z][a-z0-9_]*\}}$", max_length=200)
"""The name of a server, or the argument that has it, such as `{service_name}`."""


def _type(kind: str) -> Any:
    return Field(pattern=rf"^[a-z][a-z0-9_]*/{kind}/[A-Z][A-Za-z0-9]*$")


class _Entry(BaseModel, extra="forbid", strict=True):
    """One entry of the file."""


class _Action(_Entry):
    """An action of the tree."""

    result: dict[Annotated[str, _FIELD], str] = {}
    """Keys that fields of the result set: their names, or arguments that name them."""


class ActionServer(_Action):
    """An action of the tree that sends a goal to an action server."""

    server: Annotated[str, _SERVER] = Field(alias="action")
    type: Annotated[str, _type("action")]
    fields: dict[str, Any] = Field({}, alias="goal")
    """Fields of the goal; the others have their defaults. A text that is an argument's or a key's
    name is replaced by its value."""
    feedback: dict[Annotated[str, _FIELD], str] = {}  # keys that the feedback sets, as `result`
    replace: bool = False  # whether a changed key of the goal sends a new one, which replaces it
    timeout: _Seconds | None = None  # s; after that the goal is cancelled and the action fails
    server_timeout: _Seconds = 5.0  # s without an answer of the server until the action fails


class ServiceCall(_Action):
    """An action of the tree that calls a service."""

    server: Annotated[str, _SERVER] = Field(alias="service")
    type: Annotated[str, _type("srv")]
    fields: dict[str, Any] = Field({}, alias="request")  # of the request, as those of a goal
    success: Annotated[str, _FIELD] | None = None
    """Field of the response with the action's result; None: `success` if there is such a field,
    otherwise the action succeeds with any response."""
    timeout: _Seconds = 5.0  # s, including the wait for the service


class TopicKey(_Entry):
    """A key that is a field of the last message of a topic."""

    topic: Annotated[str, _NAME]
    type: Annotated[str, _type("msg")]
    field: Annotated[str, _FIELD] = ""  # e.g. pose.pose.position.x or ranges[0]; "": the message
    default: _Value | None = None  # before the first message; None: the tree waits for it
    max_age: _Seconds | None = None  # s; an older message is ignored
    reliable: bool = False  # whether to ask the publisher for reliable delivery


class ServiceKey(_Entry):
    """A key that is a field of a service's response, requested periodically."""

    service: Annotated[str, _NAME]
    type: Annotated[str, _type("srv")]
    request: dict[str, Any] = {}
    field: Annotated[str, _FIELD] = "success"
    every: _Seconds = 1.0  # s between a response and the next request
    default: _Value | None = None  # before the first response
    max_age: _Seconds | None = None  # s; an older response is ignored


class WrittenKey(_Entry):
    """A key that results of actions set, with its value before the first one."""

    initial: _Value


class TopicCondition(TopicKey):
    """A condition that holds while a field of the last message of a topic is true."""

    default: bool | None = None  # before the first message


class ServiceCondition(ServiceKey):
    """A condition that holds while a field of a service's response is true."""

    default: bool | None = None  # before the first response


class RobotMap(_Entry):
    """The whole file."""

    node: Annotated[str, Field(pattern=r"^[A-Za-z_][A-Za-z0-9_]*$", max_length=200)] = "islandgp"
    actions: dict[str, ActionServer | ServiceCall]
    keys: dict[str, TopicKey | ServiceKey | WrittenKey] = {}
    conditions: dict[str, TopicCondition | ServiceCondition] = {}
    """Leaves that succeed while the field is true."""


_KINDS: Final[dict[str, dict[str, type[_Entry]]]] = {
    "actions": {"action": ActionServer, "service": ServiceCall},
    "keys": {"topic": TopicKey, "service": ServiceKey, "initial": WrittenKey},
    "conditions": {"topic": TopicCondition, "service": ServiceCondition},
}
"""The class of an entry, by its distinguishing key."""


class _Loader(yaml.SafeLoader):
    """Reads YAML, of which each key of a mapping must occur once."""

    def construct_mapping(self, node: Any, deep: bool = False) -> dict[Any, Any]:
        """The mapping of a YAML node. Raises ConfigError."""
        lines: dict[str, int] = {}
        for key, _ in node.value:
            mark = key.start_mark
            if (name := str(key.value)) in lines:
                raise ConfigError(
                    f"{self.name}:{mark.line + 1}:{mark.column + 1}: expected each key once, found"
                    f" {shown(name)} again, as in line {lines[name]}; rename or remove one"
                )
            lines[name] = mark.line + 1
        return super().construct_mapping(node, deep)


def read_map(file: Path) -> RobotMap:
    """The map in a YAML file. Raises ConfigError with a line for each error."""
    text = read_text_file(file)
    if len(text) > _MAX_CHARACTERS or re.search(r"(^|[\s:,\[{-])[&*][A-Za-z0-9_]", text):
        raise ConfigError(
            f"{file}: expected a short file without anchors (&name, *name); write each entry out"
        )
    loader = _Loader(text)
    loader.name = str(file)
    try:
        plain = loader.get_single_data()
    except (yaml.YAMLError, RecursionError, ValueError) as error:
        first = " ".join(str(error).split())[:200]
        raise ConfigError(f"{file}: expected YAML, found: {first}") from None
    finally:
        loader.dispose()
    if not isinstance(plain, dict):
        raise ConfigError(f"{file}: expected `actions:` and `keys:`, found {str(plain)[:40]!r}")
    faults: list[str] = []
    parts = {**plain}
    for part, kinds in _KINDS.items():
        if isinstance(entries := plain.get(part), dict):
            parts[part] = {
                name: _entry(f"{part}.{name}", entry, kinds, faults)
                for name, entry in entries.items()
            }
    if not faults:
        try:
            return RobotMap.model_validate(parts)
        except ValidationError as error:
            faults += _lines("", error)
    raise ConfigError("\n".join(f"{file}: {fault}" for fault in faults))


def _entry(
    place: str, entry: Any, kinds: dict[str, type[_Entry]], faults: list[str]
) -> _Entry | None:
    """Parses an entry by the key of its kind; errors are added to `faults`."""
    matching = [kind for kind in kinds if isinstance(entry, dict) and kind in entry]
    if len(matching) != 1:
        forms = " or ".join(f"`{kind}: NAME`" for kind in kinds)
        faults.append(f"{place}: expected {forms}, found {str(entry)[:60]!r}")
        return None
    try:
        return kinds[matching[0]].model_validate(entry)
    except ValidationError as error:
        faults += _lines(f"{place}.", error)
        return None


def _lines(place: str, error: ValidationError) -> list[str]:
    """A line for each error of pydantic's."""
    return [
        f"{place}{'.'.join(map(str, each['loc']))}: {each['msg'][0].lower()}{each['msg'][1:]},"
        f" found {str(each['input'])[:60]!r}"
        for each in error.errors(include_url=False, include_context=False)
    ]
