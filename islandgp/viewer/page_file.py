"""Writes a run's page, `run.html`: at the end of a run, and for `watch` and `sync`."""

from __future__ import annotations

import sys
from collections.abc import Callable
from pathlib import Path
from time import time

from islandgp.atomic_files import reading, remove_leftovers, usable, write_atomic
from islandgp.bt.core.language import parse
from islandgp.errors import brief
from islandgp.evaluation.base import Problem
from islandgp.records.files import PAGE
from islandgp.records.folder import RunFolder, Status
from islandgp.records.manifest import NAME as MANIFEST
from islandgp.records.manifest import add_to_manifest
from islandgp.viewer.history import RunCurves
from islandgp.viewer.page import page
from islandgp.viewer.recording import record
from islandgp.viewer.run_page import first_episode, run_page


def write_page(
    folder: RunFolder,
    status: Status,
    curves: RunCurves | None = None,
    problem: Callable[[], Problem] | None = None,
) -> None:
    """Writes the page of a run; that of a finished run has the replay of its best robot.

    Whatever is in its place is replaced.

    Args:
        folder: of the run.
        status: of the run.
        curves: of the run, as in `run_page`.
        problem: makes the problem of a finished run; None: from the folder's configuration and
            the user's.

    Raises:
        RunError: a file of the folder is damaged, or the page cannot be written.
    """
    summary = folder.path / "summary.json"
    with usable(folder.path), reading("the records of a run", folder.path):
        before, now = _content(summary), time()
        replay = ""
        if status is Status.FINISHED:
            for name in (MANIFEST, PAGE):  # of a process that was killed here
                remove_leftovers(folder.path, f"{name}.*")
            replay, now = _replay(folder, problem), summary.stat().st_mtime
        text = run_page(folder, status, curves, replay=replay, now=int(1000 * now))
        if _content(summary) == before:  # else the run has ended, or another one has begun
            write_atomic(folder.path / PAGE, text.encode())
            if status is Status.FINISHED:
                add_to_manifest(folder.path, PAGE)


def _content(file: Path) -> bytes:
    return file.read_bytes() if file.exists() else b""


def _replay(folder: RunFolder, problem: Callable[[], Problem] | None) -> str:
    """The replay of the best robot; "" and a message if its episode cannot be recorded.

    A domain of the user may raise any exception when it is observed, or no longer exist.
    """
    try:
        made = Problem.recorded(folder.configuration()) if problem is None else problem()
        return champion_replay(folder, made)
    except Exception as error:
        print(f"islandgp: no replay of the best robot: {brief(error)}", file=sys.stderr)
        return ""


def champion_replay(folder: RunFolder, problem: Problem) -> str:
    """The replay page of a finished run's best robot: its first episode, in the run's problem."""
    champion = folder.summary()["champion"]
    seed, stage = first_episode(folder, champion["record"]["id"])
    tree = parse(champion["tree"], problem.domain.schema.vocabulary)
    title = f"{folder.path.name}: the best robot, of generation {champion['generation']}"
    return page(record(tree, problem, seed=seed, stage=stage), title=title)
