"""`islandgp watch`: opens the page of a run, which is updated during the run."""

from __future__ import annotations

import re
import sys
import webbrowser
from itertools import chain
from pathlib import Path
from typing import Final

import click

from islandgp.commands.options import with_trust_options
from islandgp.errors import RunError

STATUS: Final = re.compile(rb'<body data-status="([A-Z]+)">')


@click.command()
@click.argument("run", type=click.Path(path_type=Path))
@click.option(
    "--open/--no-open",
    "open_browser",
    default=None,
    help="Open it in a browser.  [default: on a terminal]",
)
@with_trust_options
def command(run: Path, open_browser: bool | None) -> None:
    """Open the page of the run in the folder RUN and print its path.

    The page shows the result, the curves, the archive's map, and the best robot with its lineage.
    During the run it reloads every few seconds.
    """
    path = _page(run)
    click.echo(path)
    is_opened = sys.stdout.isatty() if open_browser is None else open_browser
    if is_opened and not webbrowser.open(path.absolute().as_uri()):
        click.echo("Found no browser to open: open the file yourself.", err=True)


def _page(path: Path) -> Path:
    """The page of a run, written again if it is missing, changed or outdated.

    Raises:
        RunError: there is no run in the folder, or it is damaged.
    """
    from islandgp.records.folder import RunFolder, Status
    from islandgp.viewer.last_page import complete_page, replay_or_message, write_page
    from islandgp.viewer.run_page import NAME_OF_PAGE

    folder = RunFolder(path)
    if not path.is_dir() or not folder.begun() or folder.about() is None:
        below = chain(path.glob("*/about.json"), path.glob("*/*/about.json"))
        one = next((file.parent for file in below), None)
        inside = "none" if one is None else "runs below it"
        example = "as a run's last line names it" if one is None else f"e.g. {one}"
        raise RunError(
            f"Expected a run in {path}, found {inside}; give a run's own folder, {example}."
        )
    status, page = folder.status(), path / NAME_OF_PAGE
    if status is Status.FINISHED:
        folder.must_be_sound(page=False)
        complete_page(folder)
    if not page.exists() or (status is not Status.RUNNING and _status_of(page) != status):
        replay = replay_or_message(folder) if status is Status.FINISHED else ""
        write_page(folder, status, replay=replay)
    return page


def _status_of(page: Path) -> str:
    """The status of the run in its page; "" if the page has none."""
    try:
        match = STATUS.search(page.read_bytes())
    except OSError:
        return ""
    return match[1].decode() if match else ""
