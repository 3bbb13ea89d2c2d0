"""A run's lineage as a table: every individual with its parents, in order of birth."""

from __future__ import annotations

import csv
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any, Final

COLUMNS: Final = (
    "generation",
    "id",
    "origin",
    "parents",
    "mutation",
    "fitness",
    "specialist",
    "tiers",
)


def write_lineage(path: Path, records: Iterable[Mapping[str, Any]]) -> None:
    """Writes the table, from the lines of generations.jsonl; lists are apart by spaces."""
    with path.open("w", newline="", encoding="utf-8") as file:
        out = csv.writer(file)
        out.writerow(COLUMNS)
        for record in records:
            generation = record["snapshot"]["generation"]
            for i in record["individuals"]:
                row = {**i, "generation": generation}
                row["parents"], row["tiers"] = " ".join(i["parents"]), " ".join(i["tiers"])
                out.writerow([row[name] for name in COLUMNS])
