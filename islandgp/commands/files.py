"""Files that commands read and write, and their errors."""

from __future__ import annotations

import os
import sys
from collections.abc import Callable
from errno import EACCES, ENOENT
from pathlib import Path
from typing import Any, Final, NamedTuple

import click

from islandgp.bt.core.language import parse
from islandgp.bt.core.node import Node
from islandgp.bt.core.vocabulary import Vocabulary
from islandgp.errors import IslandError
from islandgp.gate import check_file
from islandgp.text_files import MAX_BYTES, decoded, read_text_file

STDIN: Final = "-"


class _Input(click.Path):
    """A file to read, or a run's folder: its best tree. `-`, the standard input, is read once."""

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        """The path, as from `click.Path`. Raises click.UsageError for a second `-`."""
        best = os.path.join(os.fsdecode(value), "best.bt")
        if os.path.isfile(best):  # False for a name that is too long
            check_file(Path(best))
            value = best
        path = super().convert(value, param, ctx)
        if path == STDIN and ctx is not None:
            if _STDIN_USED in ctx.meta:
                raise click.UsageError("expected one `-`, the standard input, found more", ctx)
            ctx.meta[_STDIN_USED] = True
        return path


_STDIN_USED: Final = "islandgp.stdin"

FILE: Final = _Input(exists=True, dir_okay=False, allow_dash=True)
"""An argument that names a file; `-` is the standard input."""


class _Checked(click.Path):
    """An output path; `check` raises IslandError if it cannot be written, before any work."""

    def __init__(self, check: Callable[[Path], None], **options: Any) -> None:
        super().__init__(**options)
        self.check = check

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        """The path, as from `click.Path`. Raises click.BadParameter for an empty one."""
        if value == "":
            self.fail(f"{self.name.title()} '' does not exist.", param, ctx)
        path = super().convert(value, param, ctx)
        if path != STDIN:
            self.check(Path(os.fsdecode(path)))
        return path


def _check_file(file: Path) -> None:
    """Raises IslandError if a file cannot be written."""
    from islandgp.atomic_files import must_take_files

    try:
        if file.exists():
            if not os.access(file, os.W_OK):
                raise PermissionError(EACCES, os.strerror(EACCES))
            if not file.is_file():  # a device or a pipe needs no temporary file
                return
        elif not file.parent.exists():
            raise FileNotFoundError(ENOENT, os.strerror(ENOENT))
        must_take_files(file.resolve().parent)
    except OSError as error:
        raise IslandError(
            f"Expected a place for the file {file}, found: {_obstacle(file.parent, error)};"
            " give another with -o."
        ) from None


def check_folder(folder: Path) -> None:
    """Raises IslandError if a folder cannot be created or written."""
    from islandgp.atomic_files import must_take_files

    try:
        must_take_files(folder)
    except OSError as error:
        raise unusable(folder, error) from None


OUTPUT: Final = _Checked(_check_file, dir_okay=False, allow_dash=True)
"""An option that names a file to be written; `-` is the standard output."""

FOLDER: Final = _Checked(check_folder, path_type=Path)
"""An option that names an output folder, which is created if it is missing."""


def unusable(folder: Path, error: OSError) -> IslandError:
    """The error for a folder in which files cannot be written."""
    return IslandError(
        f"Expected a folder for files in {folder}, found: {_obstacle(folder, error)};"
        " give another with -o."
    )


def _obstacle(folder: Path, error: OSError) -> str:
    """The reason why a folder cannot be written, for a message."""
    for place in (*reversed(folder.absolute().parents), folder):
        if place.exists() and not place.is_dir():
            return f"the file {place}"
    if isinstance(error, FileNotFoundError) and not folder.exists():
        return f"no folder {folder}"
    return error.strerror or str(error)


def display_name(file: str) -> str:
    """The name of a file in messages."""
    return "<stdin>" if file == STDIN else file


def read_text(file: str) -> str:
    """The text of a file. Raises IslandError if it cannot be read as UTF-8, or is too long."""
    if file == STDIN and (sys.stdin is None or sys.stdin.closed):
        raise IslandError(
            "Expected text on the standard input, found that it is closed; pipe a file into it or"
            " name one."
        )
    if file != STDIN:
        return read_text_file(Path(file))
    try:
        return decoded(sys.stdin.buffer.read(MAX_BYTES + 1), display_name(file))
    except OSError as error:
        raise IslandError(f"Expected to read {display_name(file)}: {error.strerror}.") from None


class TreeText(NamedTuple):
    """The text of a tree, and its place."""

    text: str
    name: str  # of the file, in messages
    folder: Path | None  # of included files; None: the text cannot include files

    def tree(self, vocabulary: Vocabulary | None = None, *, marked: bool = False) -> Node:
        """The tree, as from `parse`. Raises TreeError."""
        return parse(self.text, vocabulary, name=self.name, folder=self.folder, marked=marked)


def read_tree_text(file: str) -> TreeText:
    """The text of a tree file. Raises IslandError as `read_text`."""
    folder = Path.cwd() if file == STDIN else Path(file).parent
    return TreeText(read_text(file), display_name(file), folder)


def check_other_file(file: str, output: str) -> None:
    """Raises click.UsageError if a command would replace the file that it reads."""
    if STDIN not in (file, output) and Path(output).exists() and os.path.samefile(file, output):
        raise click.UsageError(f"expected another file after -o, found {output} itself")


def write_text(file: str, text: str) -> None:
    """Writes a file atomically, or prints the text if `file` is `-`. Raises IslandError."""
    if file == STDIN:
        click.echo(text.encode(), nl=False)  # UTF-8, like a file, on all terminals
        return
    try:
        _write(Path(file), text.encode())
    except OSError as error:
        raise IslandError(f"Expected to write {file}: {error.strerror}.") from None


def _write(path: Path, data: bytes) -> None:
    from islandgp.atomic_files import write_atomic

    if path.exists() and not path.is_file():  # a device or a pipe
        path.write_bytes(data)
        return
    if path.exists() and not os.access(path, os.W_OK):  # a new file would take its place
        raise PermissionError(EACCES, os.strerror(EACCES))
    write_atomic(path.resolve(), data)  # where a link leads: the link stays
