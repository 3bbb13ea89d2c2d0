"""Append-only files of JSON lines."""

from __future__ import annotations

import json
import os
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import islice
from pathlib import Path
from typing import Any

from islandgp.atomic_files import reading, write_atomic
from islandgp.errors import RunError
from islandgp.gate import MAX_BYTES, check_length, opened
from islandgp.plain import validate_json


def dump(value: Any) -> str:
    """JSON on one line; equal values have equal bytes."""
    return json.dumps(value, separators=(",", ":"), ensure_ascii=False, allow_nan=False)


@dataclass(frozen=True, slots=True)
class Lines:
    """A file of JSON lines, which need not exist yet."""

    path: Path
    description: str  # plural noun for the lines in messages
    kind: type  # the dataclass whose fields a line has; it may have others

    def append(self, value: dict[str, Any]) -> bytes:
        """Appends a line and flushes it to the disk; returns the line with its line break."""
        line = dump(value).encode() + b"\n"
        with self.path.open("ab") as file:
            file.write(line)
            file.flush()
            os.fsync(file.fileno())
        return line

    def read(self, first: int = 0) -> Iterator[dict[str, Any]]:
        """The values from line `first` on, without an incomplete last line. Raises as `value`."""
        for i, line in enumerate(islice(self.whole(), first, None), first):
            yield self.value(line, i)

    def value(self, line: bytes, i: int) -> dict[str, Any]:
        """The value of line `i`. Raises RunError if it is damaged."""
        with reading(f"{self.description} in line {i + 1}", self.path):
            return dict(validate_json(self.kind, line))

    def whole(self) -> Iterator[bytes]:
        """The complete lines, with their line breaks."""
        if not self.path.exists():
            return
        with opened(self.path) as lines:
            while line := lines.readline(MAX_BYTES + 1):
                check_length(self.path, line)
                if line.endswith(b"\n"):
                    yield line

    def head(self, n: int) -> list[bytes]:
        """The first `n` complete lines. Raises RunError if there are fewer."""
        lines = list(islice(self.whole(), n))
        if len(lines) < n:
            raise RunError(
                f"Expected {n} generations in {self.path}, found {len(lines)};"
                " delete the run's folder or use resume=never."
            )
        return lines

    def cut(self, n: int) -> bytes:
        """Truncates the file after `n` lines and returns them. Raises RunError for fewer."""
        keep = b"".join(self.head(n))
        if not self.path.exists() or self.path.stat().st_size != len(keep):
            write_atomic(self.path, keep)
        return keep
