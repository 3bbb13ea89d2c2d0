"""What configuration chooses by a class or a function of ours or of the user's own."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from functools import cache
from typing import Any, ClassVar, TypeVar, cast

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

from islandgp.errors import IslandError, PartError

Function = TypeVar("Function", bound=Callable[..., Any])


class Plugin(BaseModel, frozen=True, extra="forbid"):
    """A class that configuration names."""

    needs: ClassVar[tuple[str, ...]] = ("make",)  # methods of the class
    models: ClassVar[tuple[str, ...]] = ("Settings",)  # pydantic models that it carries

    factory: ImportString[Any]  # "package.module:Class"

    @field_validator("factory", mode="wrap")
    @classmethod
    def _imported(cls, path: Any, proceed: ValidatorFunctionWrapHandler) -> Any:
        top = path.partition(":")[0].partition(".")[0] if isinstance(path, str) else ""
        if top in sys.stdlib_module_names:
            raise ValueError(
                f"expected a module of yours, found {top!r}, which is one of Python's own; give the"
                " file another name"
            )
        with blaming(str(path)):
            return proceed(path)

    @field_validator("factory")
    @classmethod
    def _can_make(cls, factory: Any) -> Any:
        has = [callable(getattr(factory, method, None)) for method in cls.needs]
        if not (all(hasattr(factory, model) for model in cls.models) and all(has)):
            *first, last = (*cls.models, *cls.needs)
            raise ValueError(
                f"expected a class with {', '.join(first)} and {last}, found {factory!r}"
            )
        for model in cls.models:
            found = getattr(factory, model)
            if not (isinstance(found, type) and issubclass(found, BaseModel)):
                what = f"expected {model} to be a pydantic model, found {found!r}"
                raise ValueError(what)  # noqa: TRY004 -- pydantic takes no TypeError for an answer
        return factory


class Part(Plugin, frozen=True, extra="forbid"):
    """A part that configuration chooses: a class, and the settings for it.

    The class carries a pydantic model `Settings` and is made by `make(settings, ...)`.
    """

    policy: dict[str, Any] = Field(default_factory=dict, validate_default=True)

    @field_validator("policy")
    @classmethod
    def _fits_factory(cls, policy: dict[str, Any], found: ValidationInfo) -> dict[str, Any]:
        if (factory := found.data.get("factory")) is not None:
            with blaming(path_of(factory)):
                factory.Settings.model_validate(policy)  # its errors become errors of this field
        return policy

    def settings(self) -> Any:
        """`policy` as the class's own Settings."""
        return self.factory.Settings.model_validate(self.policy)


def imported(path: str) -> Any:
    """What a path names: "package.module:name". Raises ValidationError, PartError."""
    with blaming(path):
        return TypeAdapter(ImportString[Any]).validate_python(path)


def function(
    name: str, table: Mapping[str, Function], check: Callable[..., None] | None = None
) -> Function:
    """An entry of a table, or a function of the user's own: "module:function".

    `check` gets what a function of the user's returned, and what it was called with; an
    exception of it is told as that function's fault.

    Raises:
        ValueError: there is no such entry, or no such function.
        PartError: the user's module cannot be imported.
    """
    if name in table:
        return table[name]
    own = _own(name, check) if ":" in name else None
    if own is None:
        raise ValueError(f"expected one of {', '.join(table)} or MODULE:FUNCTION, found {name!r}")
    return cast(Function, own)


@cache
def _own(path: str, check: Callable[..., None] | None) -> Callable[..., Any] | None:
    """The user's function, whose faults are told as its author's; None: there is none."""
    try:
        found = imported(path)
    except ValidationError:
        return None
    if not callable(found):
        return None

    def call(*arguments: Any) -> Any:
        with blaming(path):
            if (made := found(*arguments)) is None:
                raise TypeError("expected it to return something, found None")
            if check is not None:
                check(made, *arguments)
            return made

    return call


def path_of(kind: Any) -> str:
    """A class as configuration names it: "package.module:Class"; a module by its name."""
    name = getattr(kind, "__qualname__", None)
    return f"{kind.__module__}:{name}" if name else str(getattr(kind, "__name__", kind))


@contextmanager
def blaming(path: str) -> Iterator[None]:
    """Around a call into a class that configuration names: an exception of it is its author's.

    Raises:
        PartError: whatever went wrong inside, unless the class is one of ours.
    """
    try:
        yield
    except (IslandError, ValidationError):  # these are told in words of their own
        raise
    except Exception as error:
        if path.startswith("islandgp."):
            raise
        what = " ".join(f"{type(error).__name__}: {error}".split())
        raise PartError(
            f"{path} failed ({what}): this is a fault of that class, not of the program;"
            " mend it, and the same command goes on with what the run has."
        ) from error
