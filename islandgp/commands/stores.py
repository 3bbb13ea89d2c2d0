"""Commands for tracking stores: `sync` and `ui`."""

from __future__ import annotations

import threading
from pathlib import Path

import click

from islandgp.commands.options import with_config_dir_option
from islandgp.commands.setting import configured
from islandgp.config.sources import ConfigSource
from islandgp.errors import TrackingError, brief
from islandgp.gate import cleaned, configuration_folder
from islandgp.resources import resource
from islandgp.running.console import as_ctrl_c
from islandgp.tracking.store import MLflowSettings, TrackingStore
from islandgp.tracking.sync import place_from, sync
from islandgp.tracking.ui import served


def configured_stores() -> list[TrackingStore]:
    """The MLflow stores that configuration names, those of the user's folder first.

    Raises ConfigError for a wrong file.
    """
    ours, folder = resource("conf"), configuration_folder()
    options = ConfigSource("config", folder).options("tracking")
    places = []
    for option in sorted(options, key=lambda name: (ours / f"tracking/{name}.yaml").is_file()):
        part = configured([f"tracking={option}"], folder).tracking
        if isinstance(settings := part.settings(), MLflowSettings):
            places.append(TrackingStore.of(settings, Path.cwd()))
    return places


with_experiment_option = click.option(
    "--experiment", default="islandgp", help="MLflow experiment, with --uri."
)


@click.command()
@click.argument("folders", nargs=-1, type=click.Path(path_type=Path))
@click.option("--uri", help="Store to send to, instead of each run's: sqlite:///FILE or http://...")
@with_experiment_option
@with_config_dir_option
def sync_command(folders: tuple[Path, ...], uri: str | None, experiment: str) -> None:
    """Send missing records of the runs in FOLDERS (default: runs) to their store.

    Each folder is a run's, a sweep's, or one above them. Records are sent only once.
    """
    place = None if uri is None else place_from(uri, experiment)
    places = configured_stores() if place is None else []
    roots = folders or (Path("runs"),)
    for root in roots:
        if not root.is_dir():
            raise TrackingError(f"Expected a folder of runs, found no folder {root}.")
    failed: dict[Path, Exception] = {}
    for root in roots:
        done = sync(root, place, places=places)
        failed |= done.failed
        for path in done.sent:
            click.echo(cleaned(f"sent       {path}"))
        click.echo(
            f"{root}: {len(done.sent)} sent, {len(done.known)} already there,"
            f" {len(done.untracked)} without tracking, {len(done.failed)} not sent"
        )
    if failed:
        lines = "\n".join(f"  {path}: {brief(error)}" for path, error in failed.items())
        raise TrackingError(
            f"Expected to send all runs, found {len(failed)} that could not be sent; correct what"
            f" each line names and repeat the command:\n{lines}"
        )


@click.command()
@click.option(
    "--uri", help="The store: sqlite:///FILE or http://...; default: that of the configuration."
)
@with_experiment_option
@click.option("--port", type=click.IntRange(1, 65535), default=5000, help="Port of the server.")
@with_config_dir_option
def ui_command(uri: str | None, experiment: str, port: int) -> None:
    """Serve the MLflow pages and print the address of the runs page."""
    place = place_from(uri, experiment) if uri else configured_stores()[0]
    if place.file is not None:
        click.echo(f"Starting the MLflow server for {place.uri}; it prints lines ...", err=True)
    try:
        # The server runs in another session, so signals to this command do not reach it.
        with as_ctrl_c("SIGTERM", "SIGHUP"), served(place, port) as pages:
            of = f" of sweep {pages.sweep}" if pages.sweep else ""
            click.echo(f"charts{of}, a curve for each arm:  {pages.arms}")
            click.echo(f"all runs, in a table:  {pages.runs}")
            if place.file is None:  # its server runs already
                return
            click.echo("Only this machine reaches the server. Ctrl-C stops it.", err=True)
            threading.Event().wait()
    except KeyboardInterrupt:
        click.echo("stopped", err=True)
