"""`islandgp watch`: opens the page of a run, and keeps it up to date during the run."""

from __future__ import annotations

import sys
import webbrowser
from pathlib import Path
from time import monotonic, sleep
from typing import TYPE_CHECKING, Final

import click

from islandgp.commands.options import with_config_dir_option
from islandgp.errors import RunError
from islandgp.gate import check_folder, cleaned

if TYPE_CHECKING:
    from islandgp.records.folder import RunFolder, Status

PERIOD: Final = 5.0  # least s between two pages of an unfinished run
SHARE: Final = 0.1  # largest share of the time for writing them


@click.command()
@click.argument("run", type=click.Path(path_type=Path))
@click.option(
    "--open/--no-open",
    "open_browser",
    default=None,
    help="Open it in a browser.  [default: on a terminal]",
)
@with_config_dir_option
def command(run: Path, open_browser: bool | None) -> None:
    """Open the page of the run in the folder RUN and print its path.

    The page shows the result, the curves, the archive's map, and the best robot with its lineage.
    If the run is active, the command writes a new page every few seconds, which the browser shows,
    until the run ends or Ctrl-C stops the command.
    """
    from islandgp.records.folder import RunFolder, Status

    check_folder(run)
    folder = RunFolder(run)
    if not run.is_dir() or not folder.begun() or folder.about() is None:
        below = next((file.parent for file in run.rglob("about.json")), None)
        inside = "none" if below is None else f"runs below it, as {below}"
        raise RunError(f"Expected a run in {run}, found {inside}; give a run's own folder.")
    status, took = _write(folder)
    page = run / "run.html"
    click.echo(cleaned(str(page)))
    is_opened = sys.stdout.isatty() if open_browser is None else open_browser
    if is_opened and not webbrowser.open(page.absolute().as_uri()):
        click.echo("Found no browser to open: open the file yourself.", err=True)
    while status is Status.RUNNING:
        sleep(max(PERIOD, took / SHARE))
        status, took = _write(folder)


def _write(folder: RunFolder) -> tuple[Status, float]:
    """Write the run's page; return the run's status and the seconds.

    Raises:
        RunError: the run is damaged.
    """
    from islandgp.records.folder import Status
    from islandgp.viewer.page_file import write_page

    status, began = folder.status(), monotonic()
    if status is Status.FINISHED:
        folder.must_be_sound(page=False)
    write_page(folder, status)
    return status, monotonic() - began
