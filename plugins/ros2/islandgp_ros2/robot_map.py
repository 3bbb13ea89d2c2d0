"""The robot map: a file with the action server, service or topic of each action and key."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Annotated, Any, Final

import yaml
from omegaconf import OmegaConf
from omegaconf.errors import OmegaConfBaseException
from pydantic import BaseModel, Discriminator, Field, FiniteFloat, Tag, ValidationError

from islandgp.errors import ConfigError
from islandgp.text_files import read_text_file

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
    ignore: list[str] = []  # arguments that are no fields
    given: dict[str, dict[str, Any]] = {}  # fields to set for a leaf with an argument


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

    @property
    def server_timeout(self) -> float:
        """Seconds without a service, or without an answer of it, until the action fails."""
        return self.timeout


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


def _kind(*words: str) -> Discriminator:
    """The class of an entry is that of the only one of these keys that it has."""
    forms = " or ".join(f"`{word}: NAME`" for word in words)

    def tag_of(entry: Any) -> str | None:
        found = [word for word in words if isinstance(entry, dict) and word in entry]
        return found[0] if len(found) == 1 else None

    return Discriminator(tag_of, "kind", f"expected {forms}")


class RobotMap(_Entry):
    """The whole file."""

    node: Annotated[str, Field(pattern=r"^[A-Za-z_][A-Za-z0-9_]*$", max_length=200)] = "islandgp"
    actions: dict[
        str,
        Annotated[
            Annotated[ActionServer, Tag("action")] | Annotated[ServiceCall, Tag("service")],
            _kind("action", "service"),
        ],
    ]
    keys: dict[
        str,
        Annotated[
            Annotated[TopicKey, Tag("topic")]
            | Annotated[ServiceKey, Tag("service")]
            | Annotated[WrittenKey, Tag("initial")],
            _kind("topic", "service", "initial"),
        ],
    ] = {}
    """A leaf of the tree with a key's name succeeds while the key is true."""


def read_map(file: Path) -> RobotMap:
    """The map in a YAML file. Raises ConfigError with a line for each error."""
    try:
        plain = OmegaConf.to_container(OmegaConf.create(read_text_file(file)))
    except (yaml.YAMLError, OmegaConfBaseException, RecursionError, AssertionError) as error:
        mark = getattr(error, "problem_mark", None)
        place = f":{mark.line + 1}:{mark.column + 1}" if mark else ""
        found = getattr(error, "problem", "") or str(error) or "a single value"
        raise ConfigError(
            f"{file}{place}: expected YAML with each key once, found: {found[:200]}; correct it"
        ) from None
    if not isinstance(plain, dict) or not {"actions", "keys"} & {*plain}:
        raise ConfigError(f"{file}: expected `actions:` and `keys:`, found {str(plain)[:40]!r}")
    try:
        return RobotMap.model_validate(plain)
    except ValidationError as error:
        raise ConfigError("\n".join(f"{file}: {line}" for line in _lines(error))) from None


def _lines(error: ValidationError) -> Iterator[str]:
    """A line for each error of pydantic's, with the place in the file."""
    for each in error.errors(include_url=False, include_context=False):
        place = [*each["loc"][:2], *each["loc"][3:]]  # without the kind of the entry
        reason = f"{each['msg'][0].lower()}{each['msg'][1:]}"
        yield f"{'.'.join(map(str, place))}: {reason}, found {str(each['input'])[:60]!r}"
