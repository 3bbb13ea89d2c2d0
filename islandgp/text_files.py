"""Reads text files as UTF-8, with an upper limit of their size."""

from __future__ import annotations

from pathlib import Path
from typing import Final

from islandgp.errors import IslandError

MAX_BYTES: Final = 2**24  # largest size in bytes; the largest tree as XML or JSON is smaller


def read_text_file(file: Path) -> str:
    """The text of a file. Raises IslandError if it cannot be read as UTF-8, or is too long."""
    try:
        with file.open("rb") as stream:
            data = stream.read(MAX_BYTES + 1)
    except OSError as error:
        raise IslandError(f"Expected to read {file}: {error.strerror}.") from None
    return decoded(data, str(file))


def decoded(data: bytes, name: str) -> str:
    """Bytes decoded as UTF-8. Raises IslandError if they are not UTF-8, or too long."""
    if len(data) > MAX_BYTES:
        raise IslandError(
            f"Expected at most {MAX_BYTES:,} bytes in {name}, found more; the largest tree is"
            " smaller."
        )
    try:
        return data.decode("utf-8")
    except UnicodeDecodeError as error:
        raise IslandError(
            f"Expected UTF-8 text in {name}, found the byte 0x{data[error.start]:02x}"
            f" at position {error.start}; save it as UTF-8."
        ) from None
