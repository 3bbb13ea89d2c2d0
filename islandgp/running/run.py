"""One run from settings to summary: connects the components, and has all side effects."""

from __future__ import annotations

import sys
from collections.abc import Callable, Mapping, Sequence
from contextlib import closing
from itertools import islice
from pathlib import Path
from typing import Any, Final

import yaml

from islandgp.config.settings import Settings
from islandgp.errors import RunError
from islandgp.evolution.loop import evolve
from islandgp.evolution.search_calls import findings
from islandgp.gp.archive import archive_record
from islandgp.gp.plan import Plan
from islandgp.gp.record import GenerationRecord
from islandgp.plugin import path_of, plugin_errors
from islandgp.records.archive_file import ArchiveFile
from islandgp.records.files import PAGE
from islandgp.records.folder import RunFolder, Status
from islandgp.records.parameters import redacted
from islandgp.running.best_robot import best_robot
from islandgp.running.parts import (
    make_evaluator,
    make_library,
    make_search,
    make_supervisor,
    plan_of,
    searched_library,
)
from islandgp.running.report import Progress, proposals, report, summary
from islandgp.running.resume import about_run, choose
from islandgp.supervision.base import GenerationListener, Supervisor, SupervisorLifecycle
from islandgp.supervision.library import Library
from islandgp.tracking.base import Tracker
from islandgp.viewer.history import RunRecords, read_history
from islandgp.viewer.run_page import write_page

_DUMPER: Final = getattr(yaml, "CSafeDumper", yaml.SafeDumper)
"""The dumper of the C library, unless PyYAML was built without it; it is four times as fast."""


OnGeneration = Callable[[GenerationRecord], object]
"""A callback of each generation; an exception that it raises stops the run."""


class _CallbackError(Exception):
    """Holds the exception of an OnGeneration."""

    def __init__(self, error: Exception) -> None:
        self.error = error


def run(
    settings: Settings,
    config: Mapping[str, Any],
    folder: Path,
    *,
    home: Path,
    command: str = "",
    on_generation: OnGeneration | None = None,
) -> tuple[RunFolder, str]:
    """Runs an experiment, or continues an interrupted run.

    Args:
        settings: of the run.
        config: the resolved configuration of the settings.
        folder: of the run.
        home: working folder of the command.
        command: that repeats the run, for its metadata.
        on_generation: called with each generation's record, those of a resumed run included.

    Returns:
        The folder of the finished run, and its result as text.

    Raises:
        Exception: as `on_generation` raised it; the run is stopped, and can be resumed.
        RunError: the folder belongs to another configuration or another process.
        EvaluationError, SupervisionError: the run cannot continue; its records are kept.
    """
    config = redacted(config)
    target = choose(RunFolder(folder), settings, config)
    tracker: Tracker = settings.tracking.factory.make(settings.tracking.settings(), home)
    if target.finished():
        return _complete(target, tracker, settings)
    domain = settings.make_domain()
    library = make_library(settings, domain) if searched_library(settings) else None
    supervisor = make_supervisor(settings, target.path, library)
    plan = plan_of(settings, domain, library, _warn)
    about = about_run(settings, config, target, home, command)
    status, history = Status.FAILED, None
    try:
        target.open(yaml.dump(config, Dumper=_DUMPER, sort_keys=False), about)
        if target.finished():  # another process may have finished it before the folder was locked
            return _complete(target, tracker, settings)
        tracker.start(target)
        try:
            history = _evolve(settings, plan, target, supervisor, tracker, library, on_generation)
            status = Status.FINISHED
        except (KeyboardInterrupt, _CallbackError):
            status = Status.KILLED
            raise
        except Exception as error:
            target.fail(error)
            raise
        finally:
            try:
                _write_page(settings, target, status, history)
            finally:
                where = tracker.finish(status)
        return _result(target, history.costs, where, *proposals(settings, target.summary()))
    except _CallbackError as stop:
        raise stop.error from None
    finally:
        target.close()


def _complete(target: RunFolder, tracker: Tracker, settings: Settings) -> tuple[RunFolder, str]:
    """The result of a run that was finished before; the tracker sends missing records.

    Raises:
        RunError: a file of the run is damaged.
    """
    target.must_be_sound()
    _write_page(settings, target, Status.FINISHED)
    tracker.start(target)
    where = tracker.finish(Status.FINISHED)
    note = "This run was complete already; resume=never runs it again."
    return _result(target, list(target.costs()), note, where)


def _result(
    target: RunFolder, costs: Sequence[Mapping[str, Any]], *notes: str
) -> tuple[RunFolder, str]:
    return target, "\n".join((report(target, costs), *filter(None, notes))).rstrip()


def _write_page(
    settings: Settings, folder: RunFolder, status: Status, history: RunRecords | None = None
) -> None:
    """Writes the page of a run at its end; an error is printed."""
    try:
        if folder.begun():
            write_page(folder, status, history, settings.problem)
    except RunError as error:
        _warn(f"no new {PAGE}: {error}")


def _warn(line: str) -> None:
    print(f"islandgp: {line}", file=sys.stderr)


def _evolve(
    settings: Settings,
    plan: Plan,
    target: RunFolder,
    supervisor: Supervisor,
    tracker: Tracker,
    library: Library | None,
    on_generation: OnGeneration | None,
) -> RunRecords:
    """The generations, the best robot, the archive and the summary, all written to the folder."""
    if isinstance(supervisor, SupervisorLifecycle):
        with plugin_errors(path_of(type(supervisor))):
            line = supervisor.start()
        if line:
            print(line, file=sys.stderr)
    start = target.resume()
    done = 0 if start is None else start.generation
    if on_generation is not None:
        for record in islice(target.generations(), done):
            _call(on_generation, record)
    history = read_history(target)
    needs_past = isinstance(supervisor, GenerationListener) or plan.switches.edits
    evaluator, search, state = make_evaluator(settings), make_search(settings, plan), start
    steps = evolve(
        plan,
        settings.seed,
        supervisor,
        evaluator,
        search=search,
        start=start,
        past=target.generations() if done and needs_past else (),
        library_episodes=library.episodes if library else 0,
    )

    with closing(evaluator), closing(steps):
        progress = Progress(
            settings.progress,
            plan.left,
            f"{settings.name}: {settings.supervisor.name}, seed {settings.seed}",
            settings.classes.milestones,
            rate="rate" in settings.search.factory.uses,
            done=done,
            spent=history.episodes,
        )
        for step in steps:
            state = step.state or state
            history.add(*target.append(step))
            tracker.generation()
            progress.show(step)
            if on_generation is not None:
                _call(on_generation, step.record)
        best = best_robot(settings, target, history, evaluator, plan.founders)
    axes, floor = plan.archive.axes(plan.classes), plan.archive.floor
    counts = archive_record(step.archive, axes, floor=floor)
    domain = plan.vocabulary.domain
    target.finish(
        summary(settings, history, step, best, findings(search, state, plan.vocabulary)),
        ArchiveFile(domain, dict(axes), floor, counts.coverage, counts.qd_score, step.archive),
    )
    return history


def _call(on_generation: OnGeneration, record: GenerationRecord) -> None:
    try:
        on_generation(record)
    except Exception as error:
        raise _CallbackError(error) from error
