"""Text files of people: read as UTF-8, and no longer than anything that we could read."""

from __future__ import annotations

from pathlib import Path
from typing import Final

from islandgp.errors import IslandError

MAX_BYTES: Final = 2**24
"""Of a file; the largest tree as XML or JSON has less."""


def read_text_file(file: Path) -> str:
    """The text of a file. Raises IslandError when it cannot be read as UTF-8, or is too long."""
    try:
        with file.open("rb") as opened:
            data = opened.read(MAX_BYTES + 1)
    except OSError as error:
        raise IslandError(f"Expected to read {file}: {error.strerror}.") from None
    return decoded(data, str(file))


def decoded(data: bytes, name: str) -> str:
    """The text of bytes. Raises IslandError when it is no UTF-8, or too long."""
    if len(data) > MAX_BYTES:
        raise IslandError(
            f"Expected at most {MAX_BYTES:,} bytes in {name}, found more; no tree, and"
            " no form of one, is as long."
        )
    try:
        return data.decode("utf-8")
    except UnicodeDecodeError as error:
        raise IslandError(
            f"Expected UTF-8 text in {name}, found the byte 0x{data[error.start]:02x}"
            f" at position {error.start}; save it as UTF-8."
        ) from None
