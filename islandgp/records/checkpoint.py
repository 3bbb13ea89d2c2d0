"""A run's state on disk: written in one piece or not at all, and checked when read.

Its history is not in it: that stands in the records beside it, a line a generation. The
checkpoint holds their digest, so that it belongs to these records and to no others.
"""

from __future__ import annotations

import hashlib
import json
import os
import re
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from shutil import copymode
from tempfile import TemporaryFile
from typing import Any

from islandgp.errors import RunError, TreeError, brief
from islandgp.evolution.record import RunState
from islandgp.plain import UNREADABLE, made_of, plain, read_json


@contextmanager
def usable(folder: Path) -> Iterator[None]:
    """Raises RunError where a folder cannot be made, read or written, or its disk is full."""
    try:
        yield
    except OSError as error:
        raise RunError(
            f"Expected a folder to read and write in {folder}, found: {error.strerror or error};"
            " mend that and give the command again, or choose another place with runs=... ."
        ) from error


def write_atomic(path: Path, data: bytes, *, previous: Path | None = None) -> None:
    """The whole file or the old one, whatever happens in between; who may read it stays.

    The old file stays as `previous`, if that is given.
    """
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
    there = next(place for place in (folder, *folder.absolute().parents) if place.exists())
    with TemporaryFile(dir=there, prefix=".islandgp-"):
        pass


def remove_leftovers(folder: Path, pattern: str = "*") -> None:
    """Removes what `write_atomic` left of files when the machine stopped in the middle of it.

    Only for the one process that may write them.
    """
    for file in folder.glob(f".{pattern}.tmp"):
        file.unlink(missing_ok=True)


def dump(value: Any) -> str:
    """JSON of dataclasses' plain dicts, the same bytes each time, on one line."""
    return json.dumps(value, separators=(",", ":"), ensure_ascii=False, allow_nan=False)


def save_state(
    path: Path, state: RunState, *, records: str = "", previous: Path | None = None
) -> None:
    """Writes a checkpoint with its checksum: a state without its history.

    Args:
        path: the file.
        state: what it holds.
        records: the digest of the generations' records before it.
        previous: where the checkpoint that stood in `path` is kept.
    """
    kept = plain(replace(state, history=()))
    del kept["history"]
    body = dump({"generation": state.generation, "records": records, **kept})
    digest = hashlib.sha256(body.encode()).hexdigest()
    data = f'{{"sha256":"{digest}","state":{body}}}\n'.encode()
    write_atomic(path, data, previous=previous)


def read_checkpoint(path: Path) -> tuple[RunState, str]:
    """A state without its history, and the digest of the records before it.

    The digest is "" in files of the oldest versions.

    Raises:
        RunError: the file is damaged, or of a version that wrote other fields.
    """
    with reading("a checkpoint", path):
        whole = read_json(path.read_bytes())
        found = whole["state"]
        if hashlib.sha256(dump(found).encode()).hexdigest() != whole["sha256"]:
            raise ValueError("its checksum differs")
        return made_of(RunState, {**found, "history": []}), str(found.get("records", ""))


def generation_of(checkpoint: Path) -> int:
    """The generation that a checkpoint's file goes on with, 0 where none can be read."""
    try:
        with checkpoint.open(encoding="utf-8", errors="replace") as file:
            head = re.search(r'"generation":(\d+)', file.read(200))
    except FileNotFoundError:
        return 0
    return int(head[1]) if head else 0


@contextmanager
def reading(what: str, file: Path) -> Iterator[None]:
    """Around what makes something of a file: raises RunError where it does not hold `what`."""
    try:
        yield
    except (*UNREADABLE, TreeError) as error:
        raise damaged(what, file, brief(error)) from error


def damaged(what: str, file: Path, why: str) -> RunError:
    """The error for a file that was expected to hold `what`."""
    return RunError(
        f"Expected {what} in {file}, found a damaged file ({why});"
        " delete the run's folder or use resume=never."
    )
