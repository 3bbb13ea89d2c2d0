"""`archive.json`: the elites of a finished run, from which another run can start."""

from __future__ import annotations

import json
from collections.abc import Iterable
from dataclasses import asdict, dataclass
from typing import Final, Self

from islandgp.gp.archive import Elite
from islandgp.plain import from_json, read_json, without_controls

NAME: Final = "archive.json"


@dataclass(frozen=True, slots=True)
class ArchiveFile:
    """Content of archive.json. Equal archives have equal bytes."""

    domain: str  # name of the vocabulary of its trees
    cells: dict[str, tuple[float, ...]]  # edges by counter
    floor: float  # points
    coverage: float  # in [0, 1]
    qd_score: float  # points
    elites: tuple[Elite, ...]  # by cell

    @classmethod
    def of(cls, data: bytes) -> Self:
        """The archive in a file's content. Raises ValueError if it is none."""
        archive = from_json(cls, read_json(without_controls(data)))
        sizes = [len(edges) for edges in archive.cells.values()]
        for e in archive.elites:
            in_grid = (0 <= place < size for place, size in zip(e.cell, sizes, strict=False))
            if len(e.cell) != len(sizes) or not all(in_grid):
                raise ValueError(f"the elite {e.id} is in no cell of its grid")
        return archive

    def to_bytes(self) -> bytes:
        """JSON, one elite per line."""
        head = asdict(self)
        elites = ",\n".join(json.dumps(e, allow_nan=False) for e in head.pop("elites"))
        return f'{json.dumps(head, allow_nan=False)[:-1]}, "elites": [\n{elites}\n]}}\n'.encode()


def best_first(elites: Iterable[Elite]) -> list[Elite]:
    """Elites by stage, the last first, and then by mean, the highest first."""
    return sorted(elites, key=lambda e: (-e.stage, -e.mean, e.cell))
