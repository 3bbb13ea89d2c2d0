"""Commands that make runs, and those for their folders; each imports what it needs."""

from __future__ import annotations

import shlex
import shutil
import sys
import webbrowser
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from time import monotonic, sleep
from typing import Final

import click

from islandgp.atomic_files import usable
from islandgp.commands.options import with_config_dir_option
from islandgp.errors import IslandError, RunError, SupervisionError, TrackingError, brief
from islandgp.gate import check_folder, cleaned
from islandgp.records.folder import RunFolder, Status, run_folders
from islandgp.records.sweep import read_sweep, write_sweep
from islandgp.tracking.store import Store, TrackingStore

PERIOD: Final = 5.0  # least s between two pages of an unfinished run
SHARE: Final = 0.1  # largest share of the time for writing them


@click.command(
    context_settings={"ignore_unknown_options": True, "help_option_names": []},
    add_help_option=False,
)
@click.argument("overrides", nargs=-1, type=click.UNPROCESSED)
def run_command(overrides: tuple[str, ...]) -> None:
    """The same as `python -m islandgp OVERRIDES...`."""
    from islandgp.running.app import main

    sys.exit(main(overrides))


@click.command(
    context_settings={"ignore_unknown_options": True, "help_option_names": ["-h", "--help"]}
)
@click.argument("overrides", nargs=-1, type=click.UNPROCESSED)
def estimate_command(overrides: tuple[str, ...]) -> None:
    """Estimate the costs of a command's runs, e.g. supervisor=llm 'seed=range(5)' -m.

    Nothing is sent and no key is needed. A sweep prints the same before its first run.
    """
    from islandgp.config.compose import planned
    from islandgp.running.app import parsed_argv
    from islandgp.running.parts import supervised_runs
    from islandgp.supervision.llm.budget import costs

    args, argv = parsed_argv(overrides)
    settings = [job.settings for job in planned(args, argv, Path.cwd())]
    jobs = supervised_runs(settings)
    free = len(settings) - sum(job.number for job in jobs)
    if not jobs:
        click.echo(f"Nothing: none of the {free} runs asks a language model.")
        return
    click.echo(costs(jobs))
    if free:
        click.echo(f"{free} other runs ask no language model.")


@click.command()
@click.argument("run", type=click.Path(path_type=Path))
@click.option(
    "--open/--no-open",
    "open_browser",
    default=None,
    help="Open it in a browser.  [default: on a terminal]",
)
@with_config_dir_option
def watch_command(run: Path, open_browser: bool | None) -> None:
    """Open the page of the run in the folder RUN and print its path.

    The page shows the result, the curves, the archive's map, and the best robot with its lineage.
    If the run is active, the command writes a new page every few seconds, which the browser shows,
    until the run ends or Ctrl-C stops the command.
    """
    check_folder(run)
    folder = RunFolder(run)
    if not run.is_dir() or not folder.begun() or folder.about() is None:
        below = next((each.path for each in run_folders(run)), None)
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
    """Write the run's page; return the run's status and the seconds. Raises RunError."""
    from islandgp.viewer.run_page import write_page

    status, began = folder.status(), monotonic()
    if status is Status.FINISHED:
        folder.must_be_sound()
    write_page(folder, status)
    return status, monotonic() - began


@click.command()
@click.argument("folders", nargs=-1, type=click.Path(path_type=Path))
def verify_command(folders: tuple[Path, ...]) -> None:
    """Compare the runs in FOLDERS (default: runs) with their checksums.

    Each folder is a run's, a sweep's, or one above them. Exit code 1 when a run is
    damaged.
    """
    damaged = False
    for root in folders or (Path("runs"),):
        runs = list(run_folders(root)) if root.is_dir() else []
        if not runs:
            raise RunError(f"Expected runs in {root}, found none; give the folder of a run.")
        for run in runs:
            try:
                verdict = f"verified: {run.verified()}"
            except RunError as error:
                damaged, verdict = True, f"damaged: {error}"
            click.echo(cleaned(f"{run.path}: {verdict}"))
    sys.exit(1 if damaged else 0)


@click.command()
@click.argument("run", type=click.Path(exists=True, file_okay=False, path_type=Path))
@click.option("--yes", is_flag=True, help="Do not ask.")
@with_config_dir_option
def delete_command(run: Path, yes: bool) -> None:
    """Delete the run, or all runs of the sweep, in the folder RUN, and their MLflow runs.

    MLflow keeps deleted runs in its trash; `mlflow gc` empties it.
    """
    from islandgp.commands.stores import configured_stores
    from islandgp.tracking.sync import place_of

    folder = run.absolute()
    sweep = read_sweep(folder)
    runs = [RunFolder(folder)] if sweep is None else list(run_folders(folder))
    stored: dict[TrackingStore, list[str]] = {}  # the keys of MLflow runs
    places = configured_stores()
    for each in runs:
        check_folder(each.path)
        if not (each.begun() and (about := each.about())):
            raise RunError(f"Expected a run's folder or a sweep's, found another one: {folder}")
        if each.status() is Status.RUNNING:
            raise RunError(f"Expected a run that has ended, found one at work: {each.path}")
        if place := place_of(each, places):
            stored.setdefault(place, [] if sweep is None else [sweep.id]).append(about.id)
    what = f"{len(runs)} run{'s' * (len(runs) != 1)} in {cleaned(str(run))}"
    where = " and ".join(place.uri for place in stored)
    if not yes:
        click.confirm(f"Delete {what}{f', and in {where}' * bool(where)}?", abort=True)
    _delete_stored(stored)
    with usable(folder):
        shutil.rmtree(folder)
    if sweep is None and (whole := read_sweep(folder.parent)) is not None:
        jobs = tuple(job for job in whole.jobs if job.folder != folder.name)
        write_sweep(replace(whole, jobs=jobs))
    click.echo(f"deleted {what}")


def _delete_stored(stored: Mapping[TrackingStore, Sequence[str]]) -> None:
    """Deletes the MLflow runs. Raises TrackingError if a store cannot be reached."""
    try:
        for place, keys in stored.items():
            store = Store(place)
            for found in filter(None, map(store.find, keys)):
                store.client.delete_run(found.info.run_id)
    except IslandError:
        raise
    except Exception as error:  # a store may fail in any way
        raise TrackingError(
            f"Expected to delete the runs in their store, found: {brief(error)}; nothing is deleted"
            " on disk. Repeat the command once the store answers."
        ) from error


@click.command()
@click.argument("run", type=click.Path(path_type=Path))
@click.option(
    "--generation",
    type=click.IntRange(-1),
    help="Show the whole prompts and replies of this generation; -1: of the probe.",
)
def transcript_command(run: Path, generation: int | None) -> None:
    """Show the transcript of a language model in the folder RUN.

    In order: each attempt with its tokens, dollars, seconds and answer, and the result of each
    question. RUN can also be a transcript file.
    """
    from islandgp.supervision.llm.message import clean
    from islandgp.supervision.llm.transcript import Transcript, describe, find_transcript

    path = find_transcript(run)
    transcript = Transcript(path, fixed=True)
    texts = list(describe(transcript, generation))
    if not texts:
        raise SupervisionError(
            f"Expected questions to a model in {path} that fit the options, found none;"
            f" `islandgp transcript {shlex.quote(str(run))}` shows all."
        )
    attempts = transcript.attempts
    usd = sum(a.usd or 0 for a in attempts)
    click.echo("\n".join([*map(clean, texts), f"{len(attempts)} attempts, {usd:.4f} dollars"]))
