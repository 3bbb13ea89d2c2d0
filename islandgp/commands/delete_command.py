"""`islandgp delete`: deletes a run or a sweep, on disk and in its tracking store."""

from __future__ import annotations

import shutil
from dataclasses import asdict, replace
from pathlib import Path

import click

from islandgp.atomic_files import usable, write_atomic
from islandgp.commands.options import with_config_dir_option
from islandgp.commands.sync_command import configured_stores
from islandgp.errors import IslandError, RunError, TrackingError, brief
from islandgp.gate import check_folder, cleaned
from islandgp.records.files import pretty
from islandgp.records.folder import RunFolder, Status, run_folders
from islandgp.records.sweep import SweepFolder
from islandgp.tracking.store import Store, TrackingStore, run_key
from islandgp.tracking.sync import place_of


@click.command()
@click.argument("run", type=click.Path(exists=True, file_okay=False, path_type=Path))
@click.option("--yes", is_flag=True, help="Do not ask.")
@with_config_dir_option
def command(run: Path, yes: bool) -> None:
    """Delete the run, or all runs of the sweep, in the folder RUN, and their MLflow runs.

    MLflow keeps deleted runs in its trash; `mlflow gc` empties it.
    """
    folder = run.absolute()
    sweep = SweepFolder(folder)
    is_sweep = sweep.read() is not None
    runs = list(run_folders(folder)) if is_sweep else [RunFolder(folder)]
    for each in runs:
        check_folder(each.path)
        if not (each.begun() and each.about()):
            raise RunError(f"Expected a run's folder or a sweep's, found another one: {folder}")
        if each.status() is Status.RUNNING:
            raise RunError(f"Expected a run that has ended, found one at work: {each.path}")
    places = configured_stores()
    stored = [(each, place) for each in runs if (place := place_of(each, places))]
    what = f"{len(runs)} run{'s' * (len(runs) != 1)} in {cleaned(str(run))}"
    where = " and ".join(dict.fromkeys(place.uri for _, place in stored))
    if not yes:
        click.confirm(f"Delete {what}{f', and in {where}' * bool(where)}?", abort=True)
    _delete_stored(stored, sweep if is_sweep else None)
    with usable(folder):
        shutil.rmtree(folder)
    if not is_sweep:
        _forget(SweepFolder(folder.parent), folder.name)
    click.echo(f"deleted {what}")


def _forget(sweep: SweepFolder, folder: str) -> None:
    """Removes the job of a folder from sweep.json, if it has it. Raises RunError."""
    if (file := sweep.read()) is not None:
        jobs = tuple(job for job in file.jobs if job.folder != folder)
        write_atomic(sweep.path / "sweep.json", pretty(asdict(replace(file, jobs=jobs))))


def _delete_stored(
    stored: list[tuple[RunFolder, TrackingStore]], sweep: SweepFolder | None
) -> None:
    """Deletes the MLflow runs. Raises TrackingError if a store cannot be reached."""
    try:
        for place in dict.fromkeys(place for _, place in stored):
            store = Store(place)
            keys = [run_key(about) for each, p in stored if p == place and (about := each.about())]
            file = None if sweep is None else sweep.read()
            for key in (*keys, *([file.id] if file else [])):
                if found := store.find(key):
                    store.client.delete_run(found.info.run_id)
    except IslandError:
        raise
    except Exception as error:  # a store may fail in any way
        raise TrackingError(
            f"Expected to delete the runs in their store, found: {brief(error)}; nothing is deleted"
            " on disk. Repeat the command once the store answers."
        ) from error
