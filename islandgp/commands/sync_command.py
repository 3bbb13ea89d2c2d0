"""`islandgp sync`: sends missing records to the tracking store."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import click

from islandgp.commands.options import with_config_dir_option
from islandgp.commands.stores import stores
from islandgp.errors import TrackingError, brief
from islandgp.gate import cleaned, configuration_folder
from islandgp.tracking.store import TrackingStore
from islandgp.tracking.sync import place_from, sync


@click.command()
@click.argument("folders", nargs=-1, type=click.Path(path_type=Path))
@click.option("--uri", help="Store to send to, instead of each run's: sqlite:///FILE or http://...")
@click.option("--experiment", default="islandgp", help="MLflow experiment, with --uri.")
@with_config_dir_option
def command(folders: tuple[Path, ...], uri: str | None, experiment: str) -> None:
    """Send missing records of the runs in FOLDERS (default: runs) to their store.

    Each folder is a run's, a sweep's, or one above them. Records are sent only once.
    """
    place = None if uri is None else place_from(uri, experiment)
    places = stores(configuration_folder(), Path.cwd()) if place is None else []
    roots = folders or (Path("runs"),)
    for root in roots:
        if not root.is_dir():
            raise TrackingError(f"Expected a folder of runs, found no folder {root}.")
    failed = {path: error for root in roots for path, error in _sync(root, place, places).items()}
    if failed:
        lines = "\n".join(f"  {path}: {brief(error)}" for path, error in failed.items())
        raise TrackingError(
            f"Expected to send all runs, found {len(failed)} that could not be sent; correct what"
            f" each line names and repeat the command:\n{lines}"
        )


def _sync(
    root: Path, place: TrackingStore | None, places: Sequence[TrackingStore]
) -> dict[Path, Exception]:
    """Send the runs below a folder; returns the errors of those that could not be sent."""
    done = sync(root, place, places=places)
    for path in done.sent:
        click.echo(cleaned(f"sent       {path}"))
    click.echo(
        f"{root}: {len(done.sent)} sent, {len(done.known)} already there,"
        f" {len(done.untracked)} without tracking, {len(done.failed)} not sent"
    )
    return dict(done.failed)
