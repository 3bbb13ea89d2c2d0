"""`islandgp verify`: compares the files of runs with their checksums."""

from __future__ import annotations

import sys
from pathlib import Path

import click

from islandgp.errors import RunError
from islandgp.gate import check_folder, cleaned
from islandgp.records.files import PAGE, cost_lines
from islandgp.records.folder import RunFolder, run_folders
from islandgp.records.manifest import MISSING, RESTORABLE, damaged_files


def verify(folder: RunFolder) -> str:
    """Compares a finished run's files, or an unfinished run's records, with their checksums.

    Args:
        folder: of the run.

    Returns:
        A short text about the run.

    Raises:
        RunError: a file is damaged.
    """
    check_folder(folder.path)
    if folder.finished() and (damage := damaged_files(folder.path)):
        raise RunError("; ".join(_words(name, what) for name, what in damage.items()))
    folder.configuration()
    if not folder.about():
        raise RunError("about.json: missing")
    if folder.finished():
        return f"{folder.summary()['generations']} generations, finished"
    generations, _ = folder.last_record()
    for _ in folder.records():
        pass
    if sum(1 for _ in cost_lines(folder.path).whole()) < generations:
        raise RunError(
            "costs.jsonl: times of generations are missing; the run continues without them"
        )
    if generations and not (folder.path / "best.bt").exists():
        raise RunError("best.bt: it is missing; the run's command restores it")
    return f"{generations} generations, unfinished"


def _words(name: str, damage: str) -> str:
    # After a kill, the page of an unfinished run may be there, without an entry.
    restored = name == PAGE or (damage == MISSING and name in RESTORABLE)
    return f"{name}: {damage}{'; the command of the run restores it' * restored}"


@click.command()
@click.argument("folders", nargs=-1, type=click.Path(path_type=Path))
def command(folders: tuple[Path, ...]) -> None:
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
                verdict = f"verified: {verify(run)}"
            except RunError as error:
                damaged, verdict = True, f"damaged: {error}"
            click.echo(cleaned(f"{run.path}: {verdict}"))
    sys.exit(1 if damaged else 0)
