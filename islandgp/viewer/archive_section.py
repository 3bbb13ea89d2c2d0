"""The archive's map on a run's page, as data for the page's script."""

from __future__ import annotations

import shlex
from dataclasses import asdict
from typing import Any, Final

from islandgp.errors import RunError
from islandgp.gp.archive import ArchiveSettings, Elite
from islandgp.records.archive_file import NAME, read_archive
from islandgp.records.checkpoint import read_checkpoint
from islandgp.records.folder import Status
from islandgp.resources import program
from islandgp.scoring.classes import Classes
from islandgp.viewer.run_view import RunView, world_flags

TREE_BYTES: Final = 500_000  # of the archive's trees that are part of the page; the best come first


def archive_map(view: RunView) -> dict[str, Any] | None:
    """The map of the archive; None where the run keeps none."""
    if not view.history.archived:
        return None
    settings = ArchiveSettings.model_validate(view.config.get("archive") or {})
    axes = settings.axes(Classes.model_validate(view.config["classes"]))
    cells = _elites(view)
    elites = sorted(cells or (), key=lambda e: (-e.stage, -e.mean, e.cell))
    room, shown = TREE_BYTES, []
    for e in elites:
        room -= len(e.tree.encode())
        shown.append({**asdict(e), "stage": e.stage + 1, "tree": e.tree if room >= 0 else None})
    about = view.folder.about()
    return {
        "axes": [{"name": name, "edges": edges} for name, edges in axes.items()],
        "floor": settings.floor,
        "domain": "" if about is None else about.tags.get("domain", ""),
        "command": " ".join([shlex.quote(program()), "replay", "-"]),
        "flags": world_flags(view),
        "file": NAME,
        "readable": cells is not None,
        "elites": shown,
    }


def _elites(view: RunView) -> tuple[Elite, ...] | None:
    """The archive as far as the run has come; None where none can be read."""
    path = view.folder.path
    try:
        if view.status is Status.FINISHED:
            return read_archive(path)[0].elites
        for name in ("checkpoint.json", "checkpoint.previous.json"):
            if (path / name).exists():
                return read_checkpoint(path / name)[0].archive
    except RunError:  # it is missing or damaged, or being written
        return None
    return ()
