"""Load the classes and functions that the configuration names."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager
from functools import cache
from importlib import import_module
from inspect import findsource, getfile, unwrap
from itertools import takewhile
from pathlib import Path
from sysconfig import get_path
from traceback import walk_stack, walk_tb
from types import FrameType
from typing import Any, ClassVar, Final, TypeVar, cast

from pydantic import (
    BaseModel,
    Field,
    ImportString,
    TypeAdapter,
    ValidationError,
    ValidationInfo,
    ValidatorFunctionWrapHandler,
    field_validator,
)

from islandgp.errors import DomainError, IslandError, PartError

Function = TypeVar("Function", bound=Callable[..., Any])


class ImportedClass(BaseModel, frozen=True, extra="forbid"):
    """A class named in the configuration."""

    needs: ClassVar[tuple[str, ...]] = ("make",)  # methods of the class
    models: ClassVar[tuple[str, ...]] = ("Settings",)  # pydantic models of the class

    factory: ImportString[Any]  # "package.module:Class"

    @field_validator("factory", mode="wrap")
    @classmethod
    def _imported(cls, path: Any, proceed: ValidatorFunctionWrapHandler) -> Any:
        with plugin_errors(str(path)):
            _load(path)
            return proceed(path)

    @field_validator("factory")
    @classmethod
    def _can_make(cls, factory: Any) -> Any:
        if not all(hasattr(factory, name) for name in (*cls.models, *cls.needs)):
            *first, last = (*cls.models, *cls.needs)
            raise ValueError(
                f"expected a class with {', '.join(first)} and {last}, found {factory!r}"
            )
        for model in cls.models:
            member = getattr(factory, model)
            if not (isinstance(member, type) and issubclass(member, BaseModel)):
                reason = f"expected {model} to be a pydantic model, found {member!r}"
                raise ValueError(reason)  # noqa: TRY004 -- pydantic takes no TypeError for an answer
        return factory


def switched_numbers(values: Any, parsed: Any, path: str = "") -> Iterator[str]:
    """A line for each `true` or `false` in plain values that a model has parsed as a number."""
    if isinstance(values, bool) and isinstance(parsed, int | float) and type(parsed) is not bool:
        yield f"{path.lstrip('.')}: expected a number, found {str(values).lower()}"
    elif isinstance(values, Mapping) and isinstance(parsed, Mapping):
        for key, value in values.items():
            yield from switched_numbers(value, parsed.get(key), f"{path}.{key}")
    elif isinstance(values, list) and isinstance(parsed, list | tuple):
        for i, (value, inner) in enumerate(zip(values, parsed, strict=False)):
            yield from switched_numbers(value, inner, f"{path}.{i}")


class ComponentConfig(ImportedClass, frozen=True, extra="forbid"):
    """A class named in the configuration, with its settings.

    The class has a pydantic model `Settings` and a class method `make(settings, ...)`.
    """

    policy: dict[str, Any] = Field(default_factory=dict, validate_default=True)

    @field_validator("policy")
    @classmethod
    def _fits_factory(cls, policy: dict[str, Any], info: ValidationInfo) -> dict[str, Any]:
        if (factory := info.data.get("factory")) is not None:
            with plugin_errors(path_of(factory)):
                settings = factory.Settings.model_validate(policy)  # its errors become this field's
            if wrong := next(switched_numbers(policy, settings.model_dump()), ""):
                raise ValueError(wrong)
        return policy

    def settings(self) -> Any:
        """`policy` as an instance of the class's Settings."""
        return self.factory.Settings.model_validate(self.policy)


def _load(path: object) -> None:
    """Imports the module of a path. Raises ImportError if the module itself needs a missing one.

    A missing module at `path` is reported later, when the name is imported.
    """
    try:
        if isinstance(path, str):
            import_module(path.partition(":")[0])
    except (ImportError, ValueError) as error:
        if raised_in(error):
            raise


def imported(path: str) -> Any:
    """Import an object by its path, "package.module:name". Raises ValidationError, PartError."""
    with plugin_errors(path):
        _load(path)
        return TypeAdapter(ImportString[Any]).validate_python(path)


def function(
    name: str, table: Mapping[str, Function], check: Callable[..., None] | None = None
) -> Function:
    """Looks up an entry of a table, or imports a user's function "module:function".

    Args:
        name: of the entry, or path of the function.
        table: functions by name.
        check: called with the result and the arguments of a user's function; its exceptions are
            reported as errors of that function.

    Raises:
        ValueError: there is no such entry or function.
        PartError: the user's module cannot be imported.
    """
    if name in table:
        return table[name]
    custom = _user_function(name, check) if ":" in name else None
    if custom is None:
        raise ValueError(f"expected one of {', '.join(table)} or MODULE:FUNCTION, found {name!r}")
    return cast(Function, custom)


@cache
def _user_function(path: str, check: Callable[..., None] | None) -> Callable[..., Any] | None:
    """Imports a user's function; its exceptions become PartError. None if it cannot be imported."""
    try:
        function = imported(path)
    except ValidationError:
        return None
    if not callable(function):
        return None

    def call(*arguments: Any) -> Any:
        with plugin_errors(path):
            if (result := function(*arguments)) is None:
                raise TypeError("expected it to return something, found None")
            if check is not None:
                check(result, *arguments)
            return result

    return call


def path_of(kind: Any) -> str:
    """The path of a class in the configuration, "package.module:Class"; a module's name."""
    name = getattr(kind, "__qualname__", None)
    return f"{kind.__module__}:{name}" if name else str(getattr(kind, "__name__", kind))


KNOWN: Final = (
    Path(__file__).parent,
    *(Path(get_path(name)) for name in ("stdlib", "purelib", "platlib")),
)
"""Folders of code that is not the user's."""


def raised_in(error: BaseException) -> str:
    """The place in the user's code that raised an error, ", in FILE, line N", or ""."""
    if isinstance(error, SyntaxError) and error.filename:
        return f", in {error.filename}, line {error.lineno}"
    return _innermost(walk_tb(error.__traceback__))


def place_of_frame(frame: FrameType | None, outer: FrameType | None) -> str:
    """The place of a frame in the user's code, as `raised_in`; callers of `outer` are ignored."""
    return _innermost(reversed([*takewhile(lambda f: f[0] is not outer, walk_stack(frame))]))


def _innermost(frames: Iterable[tuple[FrameType, int]]) -> str:
    """The place of the last frame that is in the user's code."""
    places = [_place(frame.f_code.co_filename, line) for frame, line in frames]
    return next(filter(None, reversed(places)), "")


def _place(file: str, line: int) -> str:
    known = file.startswith("<") or any(Path(file).is_relative_to(folder) for folder in KNOWN)
    return "" if known else f", in {file}, line {line}"


def defined_in(thing: Any) -> str:
    """The place of a user's function, method or class, as `raised_in`."""
    try:
        thing = unwrap(thing)
        return _place(getfile(thing), findsource(thing)[1] + 1)
    except (OSError, TypeError):  # of an object, or of a class that was made at run time
        return ""


def short_repr(value: object) -> str:
    """The `repr` of a value for a message: shortened, without memory addresses."""
    return re.sub(r" at 0x[0-9a-fA-F]+", "", f"{value!r:.200}")[:80]


@contextmanager
def plugin_errors(path: str) -> Iterator[None]:
    """Turn exceptions of a class that the configuration names into PartError.

    Raises:
        PartError: the class at `path` raised an exception and is not part of this package.
    """
    try:
        yield
    except DomainError as error:
        place = raised_in(error)
        if type(error) is not DomainError or not place or place in str(error):
            raise
        raise DomainError(f"{str(error).rstrip('.')}{place}.") from error
    except (IslandError, ValidationError):  # their messages are complete
        raise
    except Exception as error:
        if path.startswith("islandgp."):
            raise
        reason = " ".join(f"{type(error).__name__}: {error}{raised_in(error)}".split())
        raise PartError(
            f"{path} failed ({reason}): this is a bug in that class, not in islandgp;"
            " correct it, and the same command continues the run."
        ) from error
