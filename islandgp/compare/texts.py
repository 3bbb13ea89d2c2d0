"""Notes below the tables of a report, from `texts.yaml`."""

from __future__ import annotations

from functools import cache
from pathlib import Path
from typing import Any

import yaml


def note(key: str, **values: object) -> str:
    """A note below a table, or a paragraph, filled in with `values`."""
    return str(_texts()[key]).format(**values)


@cache
def _texts() -> Any:
    return yaml.safe_load(Path(__file__).with_name("texts.yaml").read_text(encoding="utf-8"))
