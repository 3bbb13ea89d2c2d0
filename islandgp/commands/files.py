"""Files that commands read and write, and their errors."""

from __future__ import annotations

import os
import sys
from errno import EACCES, ENOENT
from pathlib import Path
from typing import Any, Final, NamedTuple

import click

from islandgp.atomic_files import must_take_files, write_atomic
from islandgp.bt.core.language import parse
from islandgp.bt.core.node import Node
from islandgp.bt.core.vocabulary import Vocabulary
from islandgp.errors import IslandError
from islandgp.gate import check_file
from islandgp.records.manifest import must_be_sound
from islandgp.text_files import MAX_BYTES, decoded, read_text_file

STDIN: Final = "-"


class _Input(click.Path):
    """A file to read, or a run's folder: its best tree."""

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        """The path, as from `click.Path`."""
        best = os.path.join(os.fsdecode(value), "best.bt")
        if os.path.isfile(best):  # False for a name that is too long
            check_file(Path(best))
            if os.path.exists(os.path.join(value, "summary.json")):  # of a finished run
                must_be_sound(Path(os.fsdecode(value)), "best.bt")
            value = best
        elif os.path.isdir(value):
            self.fail(f"{value!r} is a folder without best.bt; name a tree or a run's folder")
        return super().convert(value, param, ctx)


FILE: Final = _Input(exists=True, dir_okay=False, allow_dash=True)
"""An argument that names a file; `-` is the standard input."""


class _Output(click.Path):
    """A path to be written. Raises IslandError if it cannot be written, before any work."""

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        """The path, as from `click.Path`. Raises click.BadParameter for an empty one."""
        if value == "":
            self.fail(f"{self.name.title()} '' does not exist.", param, ctx)
        path = super().convert(value, param, ctx)
        if path != STDIN:
            check_place(Path(os.fsdecode(path)), is_folder=self.dir_okay)
        return path


OUTPUT: Final = _Output(dir_okay=False, allow_dash=True)
"""An option that names a file to be written; `-` is the standard output."""

FOLDER: Final = _Output(path_type=Path)
"""An option that names an output folder, which is created if it is missing."""


def check_place(path: Path, *, is_folder: bool) -> None:
    """Raises IslandError if a file, or files of a folder, cannot be written."""
    try:
        if not is_folder and not path.parent.exists():
            raise FileNotFoundError(ENOENT, f"no folder {path.parent}")
        if path.exists() and not os.access(path, os.W_OK):
            raise PermissionError(EACCES, os.strerror(EACCES))
        if is_folder or path.is_file() or not path.exists():  # else it is a device or a pipe
            must_take_files(path if is_folder else path.resolve().parent)
    except OSError as error:
        raise unusable(path, error) from None


def unusable(path: Path, error: OSError) -> IslandError:
    """The error for a place where nothing can be written."""
    above = [*reversed(path.absolute().parents)]
    file = next((place for place in above if place.exists() and not place.is_dir()), None)
    found = f"the file {file}" if file else error.strerror or str(error)
    return IslandError(f"Expected a place to write {path}, found: {found}; give another with -o.")


def display_name(file: str) -> str:
    """The name of a file in messages."""
    return "<stdin>" if file == STDIN else file


def read_text(file: str) -> str:
    """The text of a file. Raises IslandError if it cannot be read as UTF-8, or is too long."""
    if file != STDIN:
        return read_text_file(Path(file))
    try:
        return decoded(sys.stdin.buffer.read(MAX_BYTES + 1), display_name(file))
    except (AttributeError, OSError, ValueError) as error:  # it is closed
        raise IslandError(
            f"Expected to read the standard input, found: {error}; pipe a file into it or name one."
        ) from None


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
    """Writes a file atomically and says so, or prints the text if `file` is `-`.

    Raises IslandError.
    """
    if file == STDIN:
        click.echo(text.encode(), nl=False)  # UTF-8, like a file, on all terminals
        return
    path = Path(file)
    check_place(path, is_folder=False)  # a read-only file is not replaced
    try:
        if path.exists() and not path.is_file():  # a device or a pipe
            path.write_bytes(text.encode())
        else:
            write_atomic(path.resolve(), text.encode())  # where a link leads: the link stays
    except OSError as error:
        raise unusable(path, error) from None
    click.echo(f"wrote {file}", err=True)
