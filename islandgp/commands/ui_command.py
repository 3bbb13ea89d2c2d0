"""`islandgp ui`: serves the MLflow pages of the runs."""

from __future__ import annotations

import threading
import webbrowser

import click

from islandgp.commands.options import with_config_dir_option
from islandgp.commands.sync_command import configured_stores
from islandgp.running.console import as_ctrl_c
from islandgp.tracking.sync import place_from
from islandgp.tracking.ui import served


@click.command()
@click.option(
    "--uri", help="The store: sqlite:///FILE or http://...; default: that of the configuration."
)
@click.option("--experiment", default="islandgp", help="MLflow experiment, with --uri.")
@click.option("--port", default=5000, help="Port of the server.")
@click.option("--open", "open_browser", is_flag=True, help="Open the arms page in a browser.")
@with_config_dir_option
def command(uri: str | None, experiment: str, port: int, open_browser: bool) -> None:
    """Serve the MLflow pages and print the address of the runs page."""
    configured = [] if uri else configured_stores()
    place = place_from(uri, experiment) if uri else configured[0]
    click.echo(f"Starting the MLflow server for {place.uri} ...", err=True)
    try:
        # The server runs in another session, so signals to this command do not reach it.
        with as_ctrl_c("SIGTERM", "SIGHUP"), served(place, port) as pages:
            of = f" of sweep {pages.sweep}" if pages.sweep else ""
            click.echo(f"charts{of}, a curve for each arm:  {pages.arms}")
            click.echo(f"all runs, in a table:  {pages.runs}")
            click.echo("Only this machine reaches the server. Ctrl-C stops it.", err=True)
            if open_browser and not webbrowser.open(pages.arms):
                click.echo("Found no browser to open: open the address yourself.", err=True)
            threading.Event().wait()
    except KeyboardInterrupt:
        click.echo("stopped", err=True)
