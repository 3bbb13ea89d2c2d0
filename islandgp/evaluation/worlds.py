"""World settings with the changes of a curriculum's stage or of a perturbed world."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from pydantic import BaseModel


def staged(world: BaseModel, changes: Mapping[str, Any]) -> BaseModel:
    """The settings with changes. Raises pydantic.ValidationError if they are invalid."""
    return type(world).model_validate(_merged(world.model_dump(), changes)) if changes else world


def _merged(old: Mapping[str, Any], new: Mapping[str, Any]) -> dict[str, Any]:
    merged = {
        key: _merged(old[key], value)
        if isinstance(value, Mapping) and isinstance(old.get(key), Mapping)
        else value
        for key, value in new.items()
    }
    return {**old, **merged}
