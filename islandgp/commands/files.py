"""Files that commands read and write, with errors that tell what is wrong with them."""

from __future__ import annotations

import os
import sys
from errno import EACCES
from pathlib import Path
from typing import Final

import click

from islandgp.bt.language import parse
from islandgp.bt.node import Node
from islandgp.errors import IslandError

STDIN: Final = "-"

MAX_BYTES: Final = 2**24
"""Of a file; the largest tree as XML or JSON has less."""

FILE: Final = click.Path(exists=True, dir_okay=False, allow_dash=True)
"""An argument that names a file; `-` is the standard input."""

OUTPUT: Final = click.Path(dir_okay=False, allow_dash=True)
"""An option that names a file to be written; `-` is the standard output."""


def called(file: str) -> str:
    """What messages call a file."""
    return "<stdin>" if file == STDIN else file


def read_text(file: str) -> str:
    """The text of a file. Raises IslandError when it cannot be read as UTF-8, or is too long."""
    if file == STDIN and (sys.stdin is None or sys.stdin.closed):
        raise IslandError(
            "Expected text on the standard input, found that it is closed; pipe a file into it or"
            " name one."
        )
    try:
        if file == STDIN:
            data = sys.stdin.buffer.read(MAX_BYTES + 1)
        else:
            with Path(file).open("rb") as opened:
                data = opened.read(MAX_BYTES + 1)
        if len(data) > MAX_BYTES:
            raise IslandError(
                f"Expected at most {MAX_BYTES:,} bytes in {called(file)}, found more; no tree, and"
                " no form of one, is as long."
            )
        return data.decode("utf-8")
    except UnicodeDecodeError as error:
        raise IslandError(
            f"Expected UTF-8 text in {called(file)}, found the byte 0x{data[error.start]:02x}"
            f" at position {error.start}; save it as UTF-8."
        ) from None
    except OSError as error:
        raise IslandError(f"Expected to read {called(file)}: {error.strerror}.") from None


def folder_of(file: str) -> Path:
    """Where a tree file's includes are; of the standard input, the current folder."""
    return Path.cwd() if file == STDIN else Path(file).parent


def read_tree(file: str) -> Node:
    """The tree in a file, of whatever domain. Raises TreeError, IslandError."""
    return parse(read_text(file), name=called(file), folder=folder_of(file))


def write_text(file: str, text: str) -> None:
    """Writes a file in one piece, or prints the text where `file` is `-`. Raises IslandError."""
    if file == STDIN:
        click.echo(text.encode(), nl=False)  # like a file, whatever the terminal's encoding
        return
    try:
        _write(Path(file), text.encode())
    except OSError as error:
        raise IslandError(f"Expected to write {file}: {error.strerror}.") from None


def _write(path: Path, data: bytes) -> None:
    from islandgp.records.checkpoint import write_atomic

    if path.exists() and not path.is_file():  # a device or a pipe
        path.write_bytes(data)
        return
    if path.exists() and not os.access(path, os.W_OK):  # a new file would take its place
        raise PermissionError(EACCES, os.strerror(EACCES))
    write_atomic(path.resolve(), data)  # where a link leads: the link stays
