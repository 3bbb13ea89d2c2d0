"""`islandgp verify`: compares the files of runs with their checksums."""

from __future__ import annotations

import sys
from pathlib import Path

import click

from islandgp.errors import RunError
from islandgp.gate import check_folder, cleaned
from islandgp.records.files import TimedCost
from islandgp.records.folder import RunFolder, run_folders
from islandgp.records.lines import Lines, digests, generation_lines, read_digests, wrong_record
from islandgp.records.manifest import Damage, DamagedFile, damaged_files


def verify(folder: RunFolder) -> str:
    """Compares a finished run's files, or an unfinished run's records, with their checksums.

    Args:
        folder: of the run.

    Returns:
        A short text about the run.

    Raises:
        RunError: a file is damaged.
    """
    _check_files(folder)
    if folder.finished():
        return f"{folder.summary()['generations']} generations, finished"
    generations, expected = folder.last_record()
    _check_records(folder, generations, expected)
    return f"{generations} generations, unfinished"


def _check_files(folder: RunFolder) -> None:
    """Raises RunError if a file is a link, or is not as the run wrote it."""
    check_folder(folder.path)
    if folder.finished() and (wrong := damaged_files(folder.path)):
        raise RunError("; ".join(f"{file}{_first_change(folder, file)}" for file in wrong))
    folder.configuration()
    if not folder.about():
        raise RunError("about.json: missing")


def _first_change(folder: RunFolder, file: DamagedFile) -> str:
    """A text on the first record that differs from its checksum."""
    if (file.name, file.damage) != ("generations.jsonl", Damage.CHANGED):
        return ""
    sums = folder.path / "generations.sha256"
    lines, digests = list(generation_lines(folder.path).whole()), read_digests(sums)
    if len(lines) != len(digests):
        return f", {len(lines)} records of {len(digests)}"
    return f", {wrong_record(lines, digests[-1], sums)}" if digests else ""


def _check_records(folder: RunFolder, generations: int, expected: str) -> None:
    """Raises RunError for the first error in the records, costs and best tree."""
    path = folder.path
    lines = (records := generation_lines(path)).head(generations)
    sums = path / "generations.sha256"
    if damage := wrong_record(lines, expected, sums):
        raise RunError(f"generations.jsonl: {damage}")
    if read_digests(sums)[: len(lines)] != list(digests(lines)):
        raise RunError(f"{sums.name}: it differs from the records, which are as they were written")
    costs = Lines(path / "costs.jsonl", "costs of generations", TimedCost)
    if sum(1 for _ in costs.whole()) < generations:
        raise RunError(
            "costs.jsonl: times of generations are missing; the run continues without them"
        )
    for i, line in enumerate(lines):
        records.value(line, i)
    if lines and not (path / "best.bt").exists():
        raise RunError("best.bt: it is missing; the run's command restores it")


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
