"""A run's page, `run.html`: the best robot, curves, archive and lineage in one file.

It is created from the run's folder, at any time. The page of an active run reloads itself every few
seconds.
"""

from __future__ import annotations

import re
import shlex
import sys
from collections.abc import Callable, Iterator, Mapping
from dataclasses import asdict, dataclass
from itertools import islice
from pathlib import Path
from time import time
from typing import Any, Final

from islandgp.atomic_files import reading, remove_leftovers, usable, write_atomic
from islandgp.bt.core.language import parse
from islandgp.bt.core.node import Node, size
from islandgp.errors import RunError, brief
from islandgp.evaluation.base import Problem
from islandgp.gp.archive import ArchiveSettings, Elite
from islandgp.records.archive_file import NAME as ARCHIVE
from islandgp.records.archive_file import best_first
from islandgp.records.checkpoint import read_checkpoint
from islandgp.records.files import PAGE, RunMetadata
from islandgp.records.folder import RunFolder, Status
from islandgp.records.values import sentences
from islandgp.resources import program
from islandgp.scoring.classes import Classes
from islandgp.scoring.constraints import in_words
from islandgp.text import in_points
from islandgp.viewer.history import RunRecords, lineage, read_history, thinned
from islandgp.viewer.page import filled, page, script_data
from islandgp.viewer.recording import record

RELOAD: Final = 5  # s between two reloads of an active run's page
REPLAY_BYTES: Final = 700_000  # largest replay that is embedded in the page


@dataclass(frozen=True, slots=True)
class RunView:
    """A run as read from its folder, for all parts of its page."""

    folder: RunFolder
    about: RunMetadata
    status: Status
    config: Mapping[str, Any]
    summary: Mapping[str, Any] | None  # of a finished run


def run_page(
    folder: RunFolder,
    status: Status,
    history: RunRecords | None = None,
    *,
    replay: str = "",
    now: int = 0,
) -> str:
    """The page of a run, from the present content of its folder.

    Args:
        folder: of the run; it must have a configuration.
        status: of the run; the page of a RUNNING one reloads itself.
        history: of the generations in the folder; None: it is read from it.
        replay: a replay page of the best robot; "" for none.
        now: ms since 1970.

    Raises:
        RunError: a file of the folder is damaged.
    """
    history = history or read_history(folder)
    champion, summary = history.fittest, None
    if status is Status.FINISHED:
        summary = folder.summary()
        champion = {**summary["champion"]["record"], "tree": summary["champion"]["tree"]}
    about = folder.about() or RunMetadata("", folder.path.name, "/", "", 0, {})
    view = RunView(folder, about, status, folder.configuration(), summary)
    data = {
        "status": status.value,
        "updated": now,
        "reload": RELOAD,
        "curves": thinned(history),
        "archive": archive_map(view) if history.generations else None,
        "front": [] if summary is None else summary["champion"]["front"],
    }
    return filled(
        "run.html",
        about=about,
        best=champion,
        config=view.config,
        constraints=in_words(history.constraints),
        data=script_data(data),
        history=history,
        reason=folder.reason(),
        reload=RELOAD,
        replay=script_data(replay if len(replay.encode()) <= REPLAY_BYTES else ""),
        sentences=() if summary is None else tuple(sentences(summary)),
        status=status.value,
        warning="" if summary is None else summary.get("nothing_works", ""),
        **(_best(view, champion) if champion else {}),
    )


TREE_BYTES: Final = 500_000  # most bytes of embedded trees of the archive, the best first


def archive_map(view: RunView) -> dict[str, Any]:
    """The map of the archive, after the first generation."""
    settings = ArchiveSettings.model_validate(view.config["archive"])
    axes = settings.axes(Classes.model_validate(view.config["classes"]))
    cells = _elites(view)
    elites = best_first(cells or ())
    room, entries = TREE_BYTES, []
    for e in elites:
        room -= len(e.tree.encode())
        entries.append({**asdict(e), "stage": e.stage + 1, "tree": e.tree if room >= 0 else None})
    return {
        "axes": [{"name": name, "edges": edges} for name, edges in axes.items()],
        "floor": settings.floor,
        "domain": view.about.tags.get("domain", ""),
        "command": _replay_command(view, "- --run {}"),
        "file": ARCHIVE,
        "readable": cells is not None,
        "elites": entries,
    }


def _replay_command(view: RunView, words: str) -> str:
    """The command that replays a tree in the run's worlds; `words` has {} for the run's folder."""
    folder, home = view.folder.path, Path(view.about.home)
    run = shlex.quote(str(folder.relative_to(home) if folder.is_relative_to(home) else folder))
    own = re.search(r"--config-dir[= ]('[^']*'|\S+)", view.about.command)
    command = f"{shlex.quote(program())} replay {words.format(run)}"
    return f"{command} --config-dir {own[1]}" if own else command


def _elites(view: RunView) -> tuple[Elite, ...] | None:
    """The present archive; None if it cannot be read."""
    checkpoint = view.folder.path / "checkpoint.json"
    try:
        if view.status is Status.FINISHED:
            return view.folder.archive().elites
        if checkpoint.exists():
            return read_checkpoint(checkpoint)[0].archive
    except RunError:  # the file is missing, damaged, or being written
        return None
    return ()


def _best(view: RunView, best: Mapping[str, Any]) -> dict[str, Any]:
    """The values of the template on the best robot, with its tree and lineage."""
    champion = {} if view.summary is None else view.summary["champion"]
    tree, usage = parse(best["tree"]), champion.get("usage", ())
    seed, stage = first_episode(view.folder, best["id"])
    parts = sorted(best["components"].items(), key=lambda part: -abs(part[1]))
    points = [(name, in_points(value, "+")) for name, value in parts if value]
    return {
        "nodes": size(tree),
        "usage": usage,
        "tree": _branch(tree, iter(usage if len(usage) == size(tree) else ())),
        "most_loss": max((abs(u["loss"]["mean"]) for u in usage if u["loss"]), default=0) or 1,
        "text": champion.get("text", best["tree"]),
        "command": _replay_command(view, f"{{}} --seed {seed} --stage {stage + 1}"),
        "points": [*points, ("fitness", in_points(best["fitness"]))],
        "lineage": lineage(view.folder, best["id"]),
    }


def _branch(node: Node, usages: Iterator[Mapping[str, Any]]) -> dict[str, Any]:
    """A node with its usage and its children, for the template."""
    usage = next(usages, None)
    children = [_branch(child, usages) for child in node.children]
    return {"node": node, "usage": usage, "children": children}


def first_episode(folder: RunFolder, name: str) -> tuple[int, int]:
    """World seed and stage index of the first episode of the individual with this id.

    Raises RunError without a record.
    """
    config = folder.configuration()
    generation, slot = (int(part) for part in name.split("."))
    for recorded in islice(folder.records(generation), 1):
        place = 0 if config["gp"]["shared_seed"] else slot * config["gp"]["episodes"]
        return recorded["worlds"][place], recorded["snapshot"]["stage"]
    raise RunError(f"Expected generation {generation} in {folder.path}, found none.")


def write_page(
    folder: RunFolder,
    status: Status,
    history: RunRecords | None = None,
    problem: Callable[[], Problem] | None = None,
) -> None:
    """Writes the page of a run; that of a finished run has the replay of its best robot.

    An existing page is replaced.

    Args:
        folder: of the run.
        status: of the run.
        history: of the run, as in `run_page`.
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
            remove_leftovers(folder.path, f"{PAGE}.*")  # of a process that was killed here
            replay, now = _replay(folder, problem), summary.stat().st_mtime
        text = run_page(folder, status, history, replay=replay, now=int(1000 * now))
        if _content(summary) == before:  # else the run has ended, or another one has begun
            write_atomic(folder.path / PAGE, text.encode())


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
