"""`archive.json`: the elites of a finished run, from which another run can start."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterable
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Final

from islandgp.atomic_files import reading
from islandgp.errors import RunError
from islandgp.gate import check_folder, read_bytes
from islandgp.gp.archive import Elite
from islandgp.plain import from_json, read_json, without_controls
from islandgp.records.manifest import must_be_as_written

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

    def to_bytes(self) -> bytes:
        """JSON, one elite per line."""
        head = asdict(self)
        elites = ",\n".join(json.dumps(e, allow_nan=False) for e in head.pop("elites"))
        return f'{json.dumps(head, allow_nan=False)[:-1]}, "elites": [\n{elites}\n]}}\n'.encode()


def best_first(elites: Iterable[Elite]) -> list[Elite]:
    """Elites by stage, the last first, and then by mean, the highest first."""
    return sorted(elites, key=lambda e: (-e.stage, -e.mean, e.cell))


def read_archive(path: Path) -> tuple[ArchiveFile, str]:
    """Read an archive.

    Args:
        path: a run's folder, or its archive.json.

    Returns:
        The archive, and a digest of its content.

    Raises:
        RunError: the file is missing, unreadable or damaged.
    """
    file = path / NAME if path.is_dir() else path
    if path.is_dir():
        check_folder(path)
        must_be_as_written(path, NAME)
    try:
        data = read_bytes(file)
    except OSError as error:
        raise RunError(
            f"Expected the archive of a finished run in {file}, found: {error.strerror or error};"
            f" give the folder of a run that has ended, or its {NAME}."
        ) from error
    with reading("an archive", file, "give the archive of another run"):
        archive = from_json(ArchiveFile, read_json(without_controls(data)))
        sizes = [len(edges) for edges in archive.cells.values()]
        for e in archive.elites:
            in_grid = (0 <= place < size for place, size in zip(e.cell, sizes, strict=False))
            if len(e.cell) != len(sizes) or not all(in_grid):
                raise ValueError(f"the elite {e.id} is in no cell of its grid")
        return archive, hashlib.sha256(data).hexdigest()[:12]
