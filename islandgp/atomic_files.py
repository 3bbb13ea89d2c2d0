"""Atomic writes of files, and errors for files that cannot be read."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from shutil import copymode
from tempfile import TemporaryFile
from typing import Final

from islandgp.errors import RunError, TreeError, brief
from islandgp.plain import DECODE_ERRORS


@contextmanager
def usable(folder: Path) -> Iterator[None]:
    """Raises RunError if a folder cannot be created, read or written, or its disk is full."""
    try:
        yield
    except OSError as error:
        raise RunError(
            f"Expected a folder to read and write in {folder}, found: {error.strerror or error};"
            " correct that and repeat the command, or choose another place with runs=..."
        ) from error


def write_atomic(path: Path, data: bytes) -> None:
    """Replaces a file atomically and keeps its permissions."""
    temporary = path.with_name(f".{path.name}.{os.getpid()}.tmp")
    try:
        with temporary.open("wb") as file:
            file.write(data)
            file.flush()
            os.fsync(file.fileno())
        if path.exists():
            copymode(path, temporary)
        temporary.replace(path)
    except BaseException:
        temporary.unlink(missing_ok=True)
        raise


def must_take_files(folder: Path) -> None:
    """Creates and removes a file in a folder, or in its nearest existing parent. Raises OSError."""
    existing = next(place for place in (folder, *folder.absolute().parents) if place.exists())
    with TemporaryFile(dir=existing, prefix=".islandgp-"):
        pass


def remove_leftovers(folder: Path, pattern: str = "*") -> None:
    """Removes temporary files of `write_atomic` calls that were interrupted.

    Only the process that may write these files calls it.
    """
    for file in folder.glob(f".{pattern}.tmp"):
        file.unlink(missing_ok=True)


OF_A_RUN: Final = "delete the run's folder or use resume=never"
"""What to do about a damaged file of a run."""


@contextmanager
def reading(description: str, file: Path, remedy: str = OF_A_RUN) -> Iterator[None]:
    """Context in which errors of reading a file become RunError.

    Args:
        description: the expected content, for the message.
        file: the file.
        remedy: for the message.
    """
    try:
        yield
    except (*DECODE_ERRORS, TreeError) as error:
        raise damaged(description, file, brief(error), remedy) from error


def damaged(description: str, file: Path, reason: str, remedy: str = OF_A_RUN) -> RunError:
    """The error for a damaged file with the expected content `description`."""
    found = f"found a damaged file ({reason})"
    return RunError(f"Expected {description} in {file}, {found}; {remedy}.")
