"""A file of JSON values, one a line, that grows by whole lines, and a checksum for each line.

Line i of `generations.sha256` holds the index i and the SHA-256 of the digest before it and
record i's line. So each digest covers all records up to its own. The last one is also
in the checkpoint, and at the end of the run in its summary.
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
        """The values from the `first` line on, without one that is being written. As `value`."""
        for i, line in enumerate(islice(self.whole(), first, None), first):
            yield self.value(line, i)

    def value(self, line: bytes, i: int) -> dict[str, Any]:
        """The value of line `i`. Raises RunError if it is damaged."""
        with reading(f"{self.what} in line {i + 1}", self.path):
            return dict(validate_json(self.kind, line))

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


def generation_lines(folder: Path) -> Lines:
    """A run's generation records."""
    return Lines(folder / "generations.jsonl", "generation records", GenerationRecord)


def chained(before: str, line: bytes) -> str:
    """The digest after `line`, a whole line with its end; `before` is "" at the first one."""
    return hashlib.sha256(before.encode() + line).hexdigest()


def digests(lines: Iterable[bytes]) -> Iterator[str]:
    """The digest after each line."""
    digest = ""
    for line in lines:
        digest = chained(digest, line)
        yield digest


def append_digest(path: Path, index: int, digest: str) -> None:
    """Adds a line. It need not reach the disk at once: it can be made again from the records."""
    with path.open("a", encoding="ascii") as file:
        file.write(f"{index} {digest}\n")


def write_digests(path: Path, checksums: Sequence[str]) -> None:
    """Writes the whole file."""
    write_atomic(path, "".join(f"{i} {digest}\n" for i, digest in enumerate(checksums)).encode())


def read_digests(path: Path) -> list[str]:
    """The digests up to the first line that is not one; none where there is no file."""
    if not path.exists():
        return []
    sums: list[str] = []
    for line in path.read_text(encoding="utf-8", errors="replace").splitlines():
        index, _, digest = line.partition(" ")
        if index != str(len(sums)):
            break
        sums.append(digest)
    return sums


def wrong_record(lines: Sequence[bytes], expected: str, path: Path) -> str:
    """A text on the difference if `expected` is not the digest of all these lines; else "".

    `path` is the file of digests, by which the record is found.
    """
    checksums = list(digests(lines))
    if (checksums[-1] if checksums else "") == expected:
        return ""
    pairs = enumerate(zip(checksums, read_digests(path), strict=False))
    at = next((i for i, (one, other) in pairs if one != other), None)
    which = "a record" if at is None else f"the record of generation {at}"
    return f"{which} differs from its checksum"
