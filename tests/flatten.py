"""Generation records of every version in one flat form, to compare versions.

Version 1 had one domain: components were a list; five counters and two means were fields.
"""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any, Final

COMPONENTS: Final = (
    "garbage",
    "battery",
    "humanoid",
    "delivery",
    "leftover",
    "patrol",
    "idle",
    "collision",
)
COUNTERS: Final = ("pickups", "interactions", "deliveries", "charges", "gathered")
MEANS: Final = ("distance", "inactive")


def version_1(record: Mapping[str, Any]) -> dict[str, Any]:
    """A record of any version in the form of version 1."""
    s = dict(record["snapshot"])
    s.pop("overlapping", None)  # version 1 had one reading of diversity
    means = s.pop("counters", None) or {name: s.pop(name) for name in MEANS}
    rest = {key: value for key, value in record.items() if key != "archive"}  # since version 3
    return {
        **rest,
        "snapshot": {**s, **{name: means[name] for name in MEANS}},
        "individuals": [_individual(i) for i in record["individuals"]],
    }


def _individual(plain: Mapping[str, Any]) -> dict[str, Any]:
    rest = dict(plain)
    counters = rest.pop("counters", None) or {name: rest.pop(name) for name in COUNTERS}
    points = rest.pop("components")
    if isinstance(points, list):
        points = dict(zip(COMPONENTS, points, strict=True))
    return {**rest, "components": points, **{name: counters[name] for name in COUNTERS}}


def records(file: Path) -> Iterator[dict[str, Any]]:
    """The records of a run's generations.jsonl in the form of version 1."""
    for line in file.read_text(encoding="utf-8").splitlines():
        yield version_1(json.loads(line))
