"""A part of a run that configuration chooses: a supervisor, an evaluator, a tracker."""

from __future__ import annotations

from typing import Any, ClassVar

from pydantic import BaseModel, Field, ImportString, ValidationInfo, field_validator


class Part(BaseModel, frozen=True, extra="forbid"):
    """A part that configuration chooses: a class, and the settings for it.

    The class carries a pydantic model `Settings` and is made by `make(settings, ...)`.
    """

    needs: ClassVar[tuple[str, ...]] = ("make",)  # methods of the class

    factory: ImportString[Any]  # "package.module:Class"
    policy: dict[str, Any] = Field(default_factory=dict, validate_default=True)

    @field_validator("factory")
    @classmethod
    def _can_make(cls, factory: Any) -> Any:
        has = [callable(getattr(factory, method, None)) for method in cls.needs]
        if not (hasattr(factory, "Settings") and all(has)):
            *first, last = ("Settings", *cls.needs)
            raise ValueError(
                f"expected a class with {', '.join(first)} and {last}, found {factory!r}"
            )
        return factory

    @field_validator("policy")
    @classmethod
    def _fits_factory(cls, policy: dict[str, Any], found: ValidationInfo) -> dict[str, Any]:
        if (factory := found.data.get("factory")) is not None:
            factory.Settings.model_validate(policy)  # its errors become errors of this field
        return policy

    def settings(self) -> Any:
        """`policy` as the class's own Settings."""
        return self.factory.Settings.model_validate(self.policy)


def path_of(kind: type) -> str:
    """A class as configuration names it: "package.module:Class"."""
    return f"{kind.__module__}:{kind.__qualname__}"
