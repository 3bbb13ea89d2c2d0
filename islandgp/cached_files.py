"""Files with results that take long to compute, beside a module or in the user's folder.

A file's name has a digest of all that its content depends on. The content follows its own checksum,
so an incomplete file is not read.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import suppress
from hashlib import sha256
from pathlib import Path
from time import time
from typing import Final

from islandgp.atomic_files import write_atomic
from islandgp.extension_modules import user_cache

CHECKSUM: Final = 32  # bytes of SHA-256 before the content
LEFTOVER_AGE: Final = 60.0  # s after which a temporary file is that of a killed process


def read_cached(module: str, name: str) -> bytes | None:
    """The content of the first file of this name that is complete, or None.

    Args:
        module: the path of a module (`__file__`), beside which the file may be.
        name: of the file.
    """
    for file in _places(module, name):
        with suppress(OSError):
            data = file.read_bytes()
            if data[:CHECKSUM] == sha256(data[CHECKSUM:]).digest():
                return data[CHECKSUM:]
    return None


def store(module: str, name: str, content: bytes) -> None:
    """Writes a file to the first place that takes it. Raises OSError if none does."""
    for file in _places(module, name):
        with suppress(OSError):
            file.parent.mkdir(mode=0o700, parents=True, exist_ok=True)
            _remove_leftovers(file)
            write_atomic(file, sha256(content).digest() + content)
            return
    raise OSError("Expected a folder for results to keep, found none that can be written")


def _remove_leftovers(file: Path) -> None:
    """Removes temporary files of processes that were killed."""
    for temporary in file.parent.glob(f".{file.name}.*.tmp"):
        if time() - temporary.stat().st_mtime > LEFTOVER_AGE:
            temporary.unlink(missing_ok=True)


def _places(module: str, name: str) -> Iterator[Path]:
    """The places of a file: beside the module, or in the user's folder."""
    yield Path(module).parent / "__pycache__" / name
    if folder := user_cache():
        yield Path(folder, name)
