"""Run folders for the page of a run, on made-up outcomes."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import yaml

from islandgp.evolution.validation import TreeComparison, Validation
from islandgp.gp.archive import archive_record
from islandgp.gp.record import Step
from islandgp.records.archive_file import ArchiveFile
from islandgp.records.files import RunMetadata
from islandgp.records.folder import RunFolder
from islandgp.running.report import summary
from islandgp.viewer.history import read_history
from tests.composed import composed, plain
from tests.evolution.runs import SMALL, plan, run
from tests.records.listed import add_to_manifest
from tests.samples import CLASSES, best_of

VALIDATION = Validation(
    worlds=(1, 2, 3),
    mean=12345.0,
    low=10000.0,
    high=14000.0,
    reached={"excellent": 0.0, "complete": 2 / 3},
    comparisons=(TreeComparison("tree all_rounder", -500.0, -900.0, -100.0),),
)


def about(home: Path, **changes: Any) -> RunMetadata:
    """The metadata of a run."""
    fields: dict[str, Any] = {
        "id": "1",
        "title": "a run",
        "home": str(home),
        "command": "python -m islandgp supervisor=baseline world=dense seed=1",
        "started": 1_700_000_000_000,
        "tags": {"domain": "island", "code": "0"},
    }
    return RunMetadata(**{**fields, **changes})


def closed_run(
    path: Path,
    *,
    steps: list[Step] | None = None,
    complete: bool = True,
    fields: dict[str, Any] | None = None,
) -> RunFolder:
    """A closed folder of a small run.

    Args:
        path: of the folder.
        steps: the generations that it has come to; default: all of them.
        complete: whether the run is finished.
        fields: of about.json.
    """
    steps = run() if steps is None else steps
    folder = RunFolder(path)
    folder.open(
        yaml.safe_dump(plain(*SMALL), sort_keys=False), about(path.parent, **(fields or {}))
    )
    for step in steps:
        folder.append(step)
    if complete:
        settings, elites = composed(*SMALL), steps[-1].archive
        history = read_history(folder)
        best = best_of(steps[-1].champion, VALIDATION)
        axes = plan().archive.axes(CLASSES)
        record = archive_record(elites, axes, floor=0)
        archive = ArchiveFile(
            "island", dict(axes), 0, record.coverage, record.qd_score, tuple(elites)
        )
        folder.finish(summary(settings, history, steps[-1], best, ()), archive)
    folder.close()
    return folder


def changed_record(
    folder: RunFolder, generation: int, change: Callable[[dict[str, Any]], None]
) -> None:
    """Changes a generation's line in place, as nobody but a test does."""
    file = folder.path / "generations.jsonl"
    lines = file.read_text(encoding="utf-8").splitlines()
    record = json.loads(lines[generation])
    change(record)
    lines[generation] = json.dumps(record)
    file.write_text("".join(f"{line}\n" for line in lines), encoding="utf-8")
    if folder.finished():
        add_to_manifest(folder.path, file.name)
