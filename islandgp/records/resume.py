"""The state from which an unfinished run goes on: that of its newest sound checkpoint."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

from islandgp.atomic_files import damaged
from islandgp.errors import RunError
from islandgp.gp.record import RunState
from islandgp.plain import from_plain
from islandgp.records.checkpoint import read_checkpoint
from islandgp.records.lines import Lines, wrong_record
from islandgp.scoring.generation_stats import GenerationStats


def sound_state(
    checkpoints: tuple[Path, Path], generations: Lines, sums: Path, warn: Callable[[str], None]
) -> RunState | None:
    """The state of the newest sound checkpoint, which then takes the newest one's place.

    Args:
        checkpoints: the newest checkpoint and the one before it.
        generations: the records.
        sums: the file of their digests.
        warn: called with one line for each damaged file.

    Returns:
        The state with its history; None if the run starts at generation 0.

    Raises:
        RunError: no checkpoint is sound, or the records before it are damaged or missing.
    """
    newest = checkpoints[0]
    files = [file for file in checkpoints if file.exists()]
    if not files:
        _must_be_new(newest, generations, warn)
        return None
    damage = [] if files[0] == newest else [f"There is no {newest}."]
    for file in files:
        try:
            state, checked = _checked(file, generations, sums)
        except RunError as error:
            damage.append(str(error))
            continue
        if damage:
            why = damage[0].partition(";")[0].rstrip(".")
            warn(f"{why}; going on from the checkpoint of generation {state.generation}.")
            file.replace(newest)
        if not checked:
            warn(f"{generations.path}: not verified: written by an older version.")
        return state
    raise RunError(damage[0])


def _must_be_new(newest: Path, generations: Lines, warn: Callable[[str], None]) -> None:
    """Raises RunError if there are records of several generations but no checkpoint."""
    n = sum(1 for _ in generations.whole())
    if n > 1:
        raise RunError(
            f"Expected a checkpoint beside {n} generations in {newest}, found none;"
            " restore it, or use resume=never for a new folder beside this one."
        )
    if n:
        warn(f"There is no {newest}: the run begins again at generation 0.")


def _checked(file: Path, generations: Lines, sums: Path) -> tuple[RunState, bool]:
    """A checkpoint's state, and True if the checksum of the records before it was compared.

    Raises RunError if the checkpoint or a record before it is damaged or missing.
    """
    state, expected = read_checkpoint(file)
    lines = generations.head(state.generation)
    if expected and (why := wrong_record(lines, expected, sums)):
        raise damaged(generations.what, generations.path, why)
    history = [generations.value(line, i) for i, line in enumerate(lines)]
    snapshots = tuple(from_plain(GenerationStats, record["snapshot"]) for record in history)
    return replace(state, history=snapshots), bool(expected)
