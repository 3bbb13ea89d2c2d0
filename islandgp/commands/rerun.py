"""`--rerun`: repeats a command whenever one of its files changes."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from functools import wraps
from pathlib import Path
from typing import Any, Final

import click

from islandgp.bt.core.inspection import mentioned
from islandgp.commands.files import STDIN
from islandgp.errors import IslandError

POLL_S: Final = 0.3  # s between two checks of the files


def with_rerun_option(command: Callable[..., None]) -> Callable[..., None]:
    """Adds --rerun to a command with an argument `files`; an error does not end the loop."""

    @wraps(command)
    def runs(*, rerun: bool, **arguments: Any) -> None:
        files = arguments["files"]
        if not rerun:
            command(**arguments)
            return
        if STDIN in files:
            raise click.UsageError("expected files for --rerun, found the standard input")
        for first in changes([Path(file) for file in files], lambda: time.sleep(POLL_S)):
            if not first:
                click.echo(f"\n{time.strftime('%H:%M:%S')}")
            try:
                command(**arguments)
            except IslandError as error:
                click.echo(f"islandgp: {error}", err=True)
            except SystemExit:  # its exit code is that of one run
                pass
            sys.stdout.flush()

    return click.option(
        "--rerun", is_flag=True, help="Run again whenever a file changes, until Ctrl-C."
    )(runs)


def changes(files: Sequence[Path], pause: Callable[[], None]) -> Iterator[bool]:
    """Yields True immediately, and then False whenever a file or an included one has changed.

    `pause` is called between two checks.
    """
    previous = _state(files)
    yield True
    while True:
        pause()
        now = _state(files)
        # A file that is being saved may be missing.
        if now != previous and all(file.is_file() for file in files):
            previous = now
            yield False


def _state(files: Sequence[Path]) -> dict[Path, tuple[int, int]]:
    """Time and size of the files and of those that they include."""
    stamps: dict[Path, tuple[int, int]] = {}
    for file in files:
        text = ""
        with suppress(OSError):
            text = file.read_text(encoding="utf-8", errors="replace")
        for path in (file, *mentioned(text, file.parent)):
            stamps[path] = (0, 0)
            with suppress(OSError):
                status = path.stat()
                stamps[path] = (status.st_mtime_ns, status.st_size)
    return stamps
