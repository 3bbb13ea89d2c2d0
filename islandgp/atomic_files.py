"""Files that are written in one piece or not at all, and errors for those that cannot be read."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from shutil import copymode
from tempfile import TemporaryFile

from islandgp.errors import RunError, TreeError, brief
from islandgp.plain import DECODE_ERRORS


@contextmanager
def usable(folder: Path) -> Iterator[None]:
    """Raises RunError where a folder cannot be made, read or written, or its disk is full."""
    try:
        yield
    except OSError as error:
        raise RunError(
            f"Expected a folder to read and write in {folder}, found: {error.strerror or error};"
            " correct that and repeat the command, or choose another place with runs=... ."
        ) from error


def write_atomic(path: Path, data: bytes, *, previous: Path | None = None) -> None:
    """Replaces a file atomically and keeps its permissions; the old file is kept as `previous`."""
    temporary = path.with_name(f".{path.name}.{os.getpid()}.tmp")
    try:
        with temporary.open("wb") as file:
            file.write(data)
            file.flush()
            os.fsync(file.fileno())
        if path.exists():
            copymode(path, temporary)
            if previous is not None:
                path.replace(previous)
        temporary.replace(path)
    except BaseException:
        temporary.unlink(missing_ok=True)
        raise


def must_take_files(folder: Path) -> None:
    """Makes a file in a folder, or where it would be made, and removes it. Raises OSError."""
    existing = next(place for place in (folder, *folder.absolute().parents) if place.exists())
    with TemporaryFile(dir=existing, prefix=".islandgp-"):
        pass


def remove_leftovers(folder: Path, pattern: str = "*") -> None:
    """Removes what `write_atomic` left of files when the machine stopped in the middle of it.

    Only for the one process that may write them.
    """
    for file in folder.glob(f".{pattern}.tmp"):
        file.unlink(missing_ok=True)


@contextmanager
def reading(what: str, file: Path) -> Iterator[None]:
    """Around what makes something of a file: raises RunError where it does not hold `what`."""
    try:
        yield
    except (*DECODE_ERRORS, TreeError) as error:
        raise damaged(what, file, brief(error)) from error


def damaged(what: str, file: Path, why: str) -> RunError:
    """The error for a file that was expected to hold `what`."""
    return RunError(
        f"Expected {what} in {file}, found a damaged file ({why});"
        " delete the run's folder or use resume=never."
    )
