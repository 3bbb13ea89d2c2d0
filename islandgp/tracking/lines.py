"""A file of JSON values, one a line, that grows by whole lines."""

from __future__ import annotations

import json
import os
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import islice
from pathlib import Path
from typing import Any

from islandgp.errors import RunError
from islandgp.evolution.checkpoint import dump, write_atomic


@dataclass(frozen=True, slots=True)
class Lines:
    """The file; it may not be there yet."""

    path: Path

    def append(self, value: dict[str, Any]) -> None:
        """Adds a line, which is on the disk when this returns."""
        with self.path.open("ab") as file:
            file.write(dump(value).encode() + b"\n")
            file.flush()
            os.fsync(file.fileno())

    def read(self, first: int = 0) -> Iterator[dict[str, Any]]:
        """The values from the `first` line on; a line that is being written is left out."""
        if not self.path.exists():
            return
        with self.path.open(encoding="utf-8") as lines:
            for line in islice(lines, first, None):
                if line.endswith("\n"):
                    yield json.loads(line)

    def cut(self, n: int) -> None:
        """Keeps the first `n` lines. Raises RunError where there are fewer."""
        lines = self.path.read_bytes().splitlines(keepends=True) if self.path.exists() else []
        keep = lines[:n]
        if len(keep) < n:
            raise RunError(
                f"Expected {n} generations in {self.path}, found {len(keep)};"
                " delete the run's folder or use resume=never."
            )
        if keep != lines or not self.path.exists():
            write_atomic(self.path, b"".join(keep))
