"""A file of JSON values, one a line, that grows by whole lines."""

from __future__ import annotations

import os
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import islice
from pathlib import Path
from typing import Any

from islandgp.errors import RunError
from islandgp.plain import must_fit, read_json
from islandgp.records.checkpoint import dump, reading, write_atomic


@dataclass(frozen=True, slots=True)
class Lines:
    """The file; it may not be there yet."""

    path: Path
    what: str  # a line is, in the plural
    kind: type  # the dataclass of which a line holds the fields, perhaps with others

    def append(self, value: dict[str, Any]) -> bytes:
        """Adds a line, which is on the disk when this returns; returns it with its end."""
        line = dump(value).encode() + b"\n"
        with self.path.open("ab") as file:
            file.write(line)
            file.flush()
            os.fsync(file.fileno())
        return line

    def read(self, first: int = 0) -> Iterator[dict[str, Any]]:
        """The values from the `first` line on; a line that is being written is left out.

        Raises:
            RunError: a line holds other values.
        """
        for i, line in enumerate(islice(self.whole(), first, None), first):
            yield self.value(line, i)

    def value(self, line: bytes, i: int) -> dict[str, Any]:
        """What line `i` holds. Raises RunError."""
        with reading(f"{self.what} in line {i + 1}", self.path):
            must_fit(self.kind, line)
            return dict(read_json(line))

    def whole(self) -> Iterator[bytes]:
        """The lines that have an end, with it."""
        if not self.path.exists():
            return
        with self.path.open("rb") as lines:
            for line in lines:
                if line.endswith(b"\n"):
                    yield line

    def head(self, n: int) -> list[bytes]:
        """The first `n` whole lines. Raises RunError where there are fewer."""
        lines = list(islice(self.whole(), n))
        if len(lines) < n:
            raise RunError(
                f"Expected {n} generations in {self.path}, found {len(lines)};"
                " delete the run's folder or use resume=never."
            )
        return lines

    def cut(self, n: int) -> None:
        """Keeps the first `n` lines. Raises RunError where there are fewer."""
        keep = b"".join(self.head(n))
        if not self.path.exists() or self.path.stat().st_size != len(keep):
            write_atomic(self.path, keep)
