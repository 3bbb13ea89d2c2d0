"""Files with results that take long to compute, beside a module or in the user's folder.

A file's name has a digest of all that its content depends on. The content follows its own checksum,
so an incomplete file is not read.
"""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import suppress
from hashlib import sha256
from pathlib import Path
from typing import Final

CHECKSUM: Final = 32  # bytes of SHA-256 before the content


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
            file.parent.mkdir(parents=True, exist_ok=True)
            temporary = file.with_name(f".{file.name}.{os.getpid()}.tmp")
            temporary.write_bytes(sha256(content).digest() + content)
            temporary.replace(file)  # other processes read it complete or not at all
            return
    raise OSError("Expected a folder for results to keep, found none that can be written")


def _places(module: str, name: str) -> Iterator[Path]:
    """The places of a file: beside the module, or in the user's folder."""
    yield Path(module).parent / "__pycache__" / name
    with suppress(RuntimeError):  # no home
        cache = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache")
        if cache.is_absolute():  # the current folder is not trusted
            yield cache / "islandgp" / name
