"""Append-only files of JSON lines, with a chained checksum for each line.

Line i of `generations.sha256` holds the index i and the SHA-256 of the previous digest followed by
record i's line. So each digest covers all records up to its own. The last digest is also in the
checkpoint, and in the summary of a finished run.
"""

from __future__ import annotations

import hashlib
import json
import os
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from itertools import islice
from pathlib import Path
from typing import Any

from islandgp.atomic_files import reading, write_atomic
from islandgp.errors import RunError
from islandgp.gate import MAX_BYTES, check_length, opened, read_text
from islandgp.gp.record import GenerationRecord
from islandgp.plain import validate_json

Stamp = tuple[int, int, int] | None  # bytes, ns of the last change, inode


def dump(value: Any) -> str:
    """JSON on one line; equal values have equal bytes."""
    return json.dumps(value, separators=(",", ":"), ensure_ascii=False, allow_nan=False)


def stamp(file: Path) -> Stamp:
    """A value that changes when a file is written; None if there is no file."""
    try:
        status = file.stat()
    except FileNotFoundError:
        return None
    return status.st_size, status.st_mtime_ns, status.st_ino


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

    def cut(self, n: int) -> None:
        """Truncates the file after `n` lines. Raises RunError if there are fewer."""
        keep = b"".join(self.head(n))
        if not self.path.exists() or self.path.stat().st_size != len(keep):
            write_atomic(self.path, keep)


def generation_lines(folder: Path) -> Lines:
    """The file of a run's generation records."""
    return Lines(folder / "generations.jsonl", "generation records", GenerationRecord)


def chained(before: str, line: bytes) -> str:
    """The digest after `line` (with its line break); `before` is the digest before it, or ""."""
    return hashlib.sha256(before.encode() + line).hexdigest()


def digests(lines: Iterable[bytes]) -> Iterator[str]:
    """The digest after each line."""
    digest = ""
    for line in lines:
        digest = chained(digest, line)
        yield digest


def append_digest(path: Path, index: int, digest: str) -> None:
    """Appends a digest without flushing, as it can be computed again from the records."""
    with path.open("a", encoding="ascii") as file:
        file.write(f"{index} {digest}\n")


def write_digests(path: Path, checksums: Sequence[str]) -> None:
    """Writes a file of digests."""
    write_atomic(path, "".join(f"{i} {digest}\n" for i, digest in enumerate(checksums)).encode())


def read_digests(path: Path) -> list[str]:
    """The digests up to the first invalid line; none if there is no file."""
    if not path.exists():
        return []
    sums: list[str] = []
    for line in read_text(path).splitlines():
        index, _, digest = line.partition(" ")
        if index != str(len(sums)):
            break
        sums.append(digest)
    return sums


def wrong_record(lines: Sequence[bytes], expected: str, path: Path) -> str:
    """ "" if `expected` is the digest of all these lines, else a text on the difference.

    `path` is the file of digests, which shows the damaged record.
    """
    checksums = list(digests(lines))
    if (checksums[-1] if checksums else "") == expected:
        return ""
    pairs = enumerate(zip(checksums, read_digests(path), strict=False))
    at = next((i for i, (one, other) in pairs if one != other), None)
    which = "a record" if at is None else f"the record of generation {at}"
    return f"{which} differs from its checksum"
