"""`islandgp verify`: compares the files of runs with their checksums."""

from __future__ import annotations

import sys
from enum import StrEnum
from pathlib import Path

import click

from islandgp.errors import RunError
from islandgp.gp.record import Cost
from islandgp.records.checkpoint import read_checkpoint
from islandgp.records.folder import RunFolder, run_folders
from islandgp.records.lines import Lines, digests, generation_lines, read_digests, wrong_record
from islandgp.records.manifest import Damage, DamagedFile, damaged_files, read_manifest
from islandgp.trust import must_have_no_links
from islandgp.viewer.last_page import wait_for_page


class Soundness(StrEnum):
    """The result of verifying a run's files."""

    VERIFIED = "verified"  # all checksums agree
    UNKNOWN = "not verified"  # there is no manifest: written by version 0.2
    DAMAGED = "damaged"


def verify(folder: RunFolder) -> tuple[Soundness, str]:
    """Compares a run's records with their checksums, and its other files with its records.

    Args:
        folder: of the run.

    Returns:
        The result, and a short text about it.
    """
    finished = folder.finished()
    try:
        _check_files(folder)
        generations, expected = _last_record(folder)
        _check_records(folder, generations, expected)
    except RunError as error:
        return Soundness.DAMAGED, str(error)
    if finished and read_manifest(folder.path) is None:
        return Soundness.UNKNOWN, "written by an older version; its records have not changed"
    end = "finished" if finished else "unfinished"
    return Soundness.VERIFIED, f"{generations} generations, {end}"


def _check_files(folder: RunFolder) -> None:
    """Raises RunError if a file is a link, or is not as the run wrote it."""
    must_have_no_links(folder.path)
    wait_for_page(folder)
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


def _last_record(folder: RunFolder) -> tuple[int, str | None]:
    """The expected number of records and the digest of the last; None if none was written.

    Raises:
        RunError: the summary or the checkpoint is damaged, or there is neither.
    """
    if folder.finished():
        summary = folder.summary()
        return summary["generations"], summary["records"]
    checkpoint = folder.path / "checkpoint.json"
    if checkpoint.exists():
        state, expected = read_checkpoint(checkpoint)
        return state.generation, expected
    n = sum(1 for _ in generation_lines(folder.path).whole())
    if n > 1:
        raise RunError(f"there is no {checkpoint.name} beside {n} generations")
    return 0, None


def _check_records(folder: RunFolder, generations: int, expected: str | None) -> None:
    """Raises RunError for the first error in the records and the files made from them."""
    path, finished = folder.path, folder.finished()
    lines = (records := generation_lines(path)).head(generations)
    if expected is not None:
        sums = path / "generations.sha256"
        if damage := wrong_record(lines, expected, sums):
            raise RunError(f"generations.jsonl: {damage}")
        if read_digests(sums)[: len(lines)] != list(digests(lines)):
            raise RunError(
                f"{sums.name}: it differs from the records, which are as they were written"
            )
    if finished and records.path.stat().st_size != sum(map(len, lines)):
        raise RunError("generations.jsonl: it has more lines than the run has generations")
    costs = Lines(path / "costs.jsonl", "costs of generations", Cost)
    if sum(1 for _ in costs.whole()) < generations:
        raise RunError(
            "costs.jsonl: times of generations are missing; the run continues without them"
        )
    values = [records.value(line, i) for i, line in enumerate(lines)]
    if values and not (path / "best.bt").exists():
        raise RunError("best.bt: it is missing; the run's command restores it")
    if not values or not finished:
        return  # the best tree may be of a generation that is being recorded
    champion = folder.summary()["champion"]["record"]
    if not any(champion == one for record in values for one in record["individuals"]):
        raise RunError("summary.json: the champion is not in the records")
    if (path / "best.bt").read_bytes() != folder.best_text(champion["tree"]).encode():
        raise RunError("best.bt: it is not the champion's tree in summary.json")


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
            verdict, message = verify(run)
            click.echo(f"{run.path}: {verdict}: {message}")
            damaged |= verdict is Soundness.DAMAGED
    sys.exit(1 if damaged else 0)
