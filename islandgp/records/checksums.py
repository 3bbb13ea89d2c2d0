"""A checksum for each generation record: `generations.sha256`, beside `generations.jsonl`.

Line i holds the index i and the SHA-256 of the digest before it and record i's line. So each
digest vouches for all records up to its own. The last one also stands in the checkpoint,
and at the end of the run in its summary.
"""

from __future__ import annotations

import hashlib
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path

from islandgp.records.checkpoint import write_atomic


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


def write_digests(path: Path, found: Sequence[str]) -> None:
    """Writes the whole file."""
    write_atomic(path, "".join(f"{i} {digest}\n" for i, digest in enumerate(found)).encode())


def read_digests(path: Path) -> list[str]:
    """The digests up to the first line that is not one; none where there is no file."""
    if not path.exists():
        return []
    found: list[str] = []
    for line in path.read_text(encoding="utf-8", errors="replace").splitlines():
        index, _, digest = line.partition(" ")
        if index != str(len(found)):
            break
        found.append(digest)
    return found


def wrong_record(lines: Sequence[bytes], expected: str, path: Path) -> str:
    """What differs where `expected` is not the digest of all these lines; "" where it is.

    `path` is the file of digests, by which the record is found.
    """
    found = list(digests(lines))
    if (found[-1] if found else "") == expected:
        return ""
    pairs = enumerate(zip(found, read_digests(path), strict=False))
    at = next((i for i, (one, other) in pairs if one != other), None)
    which = "a record" if at is None else f"the record of generation {at}"
    return f"{which} differs from its checksum"
