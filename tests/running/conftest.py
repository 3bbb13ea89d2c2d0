"""A folder to give commands in, and a store in it."""

from __future__ import annotations

from tests.tracking.conftest import home, template

__all__ = ["home", "template"]
