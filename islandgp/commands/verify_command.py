"""`islandgp verify`: compares runs with their checksums."""

from __future__ import annotations

import sys
from pathlib import Path

import click

from islandgp.errors import RunError
from islandgp.records.verify import Verdict, verify
from islandgp.tracking.sync import run_folders


@click.command()
@click.argument("folders", nargs=-1, type=click.Path(path_type=Path))
def command(folders: tuple[Path, ...]) -> None:
    """Compare the runs in FOLDERS (default: runs) with their checksums.

    A folder is a run's, a sweep's, or one that holds them. Exit code 1 when a run is
    damaged.
    """
    damaged = False
    for root in folders or (Path("runs"),):
        runs = list(run_folders(root)) if root.is_dir() else []
        if not runs:
            raise RunError(f"Expected runs in {root}, found none; give the folder of a run.")
        for run in runs:
            found = verify(run)
            click.echo(f"{run.path}: {found.verdict}: {found.words}")
            damaged |= found.verdict is Verdict.DAMAGED
    sys.exit(1 if damaged else 0)
