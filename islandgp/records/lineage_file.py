"""`lineage.csv`: the parents of each individual of a run."""

from __future__ import annotations

import csv
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any, Final

LINEAGE: Final = ("id", "origin", "parents", "mutation", "fitness", "specialist", "tiers")
"""The columns of lineage.csv behind the generation."""


def write_lineage(path: Path, records: Iterable[Mapping[str, Any]]) -> None:
    """Writes the table, from the lines of generations.jsonl; lists are separated by spaces."""
    with path.open("w", newline="", encoding="utf-8") as file:
        out = csv.writer(file)
        out.writerow(("generation", *LINEAGE))
        for record in records:
            for i in record["individuals"]:
                row = {**i, "parents": " ".join(i["parents"]), "tiers": " ".join(i["tiers"])}
                out.writerow([record["snapshot"]["generation"], *(row[name] for name in LINEAGE)])
