"""One run from settings to summary: wires the parts, and owns every side effect."""

from __future__ import annotations

import sys
from collections.abc import Mapping
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import yaml

from islandgp.about import about_run
from islandgp.bt.language import parse
from islandgp.bt.node import Node
from islandgp.errors import RunError
from islandgp.evaluation.base import Evaluator, Setting
from islandgp.evaluation.cache import Cached
from islandgp.evolution.loop import evolve
from islandgp.evolution.record import Champion, Step
from islandgp.part import blaming, path_of
from islandgp.progress import Progress
from islandgp.report import is_mostly_fallback, report, summary
from islandgp.resources import resource
from islandgp.resume import choose
from islandgp.settings import Settings
from islandgp.supervision.base import Service, Setup, Supervisor
from islandgp.tracking.base import Tracker
from islandgp.tracking.folder import RunFolder, Status
from islandgp.tracking.parameters import redacted


@dataclass(frozen=True, slots=True)
class End:
    """How a finished run ended."""

    text: str  # what it came to, for people
    mostly_fallback: bool  # its fallback gave more of the answers than its settings allow


def example(name: str) -> Node:
    """A tree of `grammar/examples`, by name. Raises TreeError."""
    path = resource("grammar") / "examples" / f"{name}.bt"
    if not path.exists():
        known = ", ".join(sorted(p.stem for p in path.parent.glob("*.bt")))
        raise RunError(f"Expected the name of an example tree, found {name!r}; there are {known}.")
    return parse(path.read_text(encoding="utf-8"), name=str(path))


def setup_of(settings: Settings, folder: Path | None) -> Setup:
    """What a run gives to its supervisor."""
    return Setup(
        seed=settings.seed,
        generations=settings.gp.generations,
        limits=settings.gp.limits,
        folder=folder,
        example=example,
        crisis=settings.gp.crisis,
        adapt_mutation=settings.supervisor.adapt_mutation,
        inject=settings.supervisor.inject,
    )


def make_supervisor(settings: Settings, folder: Path | None) -> Supervisor:
    """The supervisor that the settings choose. Raises SupervisionError when it cannot work."""
    part = settings.supervisor
    with blaming(path_of(part.factory)):
        supervisor: Supervisor = part.factory.make(part.settings(), setup_of(settings, folder))
    return supervisor


def check_ready(settings: Settings, coming: frozenset[Path] = frozenset()) -> None:
    """Raises SupervisionError where the supervisor could not work, e.g. without a key.

    `coming` are the folders of the runs that the same command makes before this one.
    """
    part = settings.supervisor
    if hasattr(part.factory, "ready"):
        with blaming(path_of(part.factory)):
            setup = replace(setup_of(settings, None), coming=coming)
            part.factory.ready(part.settings(), setup)


def make_evaluator(settings: Settings) -> Evaluator:
    """The evaluator that the settings choose."""
    setting = Setting(settings.world, settings.rewards, settings.curriculum)
    part = settings.evaluator
    evaluator: Evaluator = part.factory.make(part.settings(), setting)
    return Cached(evaluator) if part.cache else evaluator


def run(
    settings: Settings,
    config: Mapping[str, Any],
    folder: Path,
    *,
    home: Path,
    command: str = "",
    keep_display: bool = True,
) -> End:
    """Runs an experiment, or what is missing of it, in `folder`.

    `config` is the resolved configuration that `settings` were read from, `home` the
    folder in which the command was given, and `command` does the run again. The live
    display stays on the terminal with `keep_display`.

    Raises:
        RunError: the folder belongs to another configuration or another process.
        EvaluationError, SupervisionError: the run cannot go on; what it has is kept.
    """
    config = redacted(config)
    target = choose(RunFolder(folder), settings.resume, config)
    tracker: Tracker = settings.tracking.factory.make(settings.tracking.settings(), home)
    if target.finished():
        return _complete(target, tracker)
    supervisor = make_supervisor(settings, target.path)
    about = about_run(settings, config, target, home, command)
    try:
        target.open(yaml.safe_dump(config, sort_keys=False), about)
        if target.finished():  # by the process that had the folder until now
            return _complete(target, tracker)
        where = _tracked(settings, target, supervisor, tracker, keep_display)
    finally:
        target.close()
    return _end(target, where)


def _end(target: RunFolder, *more: str) -> End:
    text = "\n".join((report(target), *more)).rstrip()
    return End(text, is_mostly_fallback(target.summary()))


def _complete(target: RunFolder, tracker: Tracker) -> End:
    """A finished run as it is; the tracker sends what is missing of it."""
    tracker.start(target)
    where = tracker.finish(Status.FINISHED)
    again = "This run was complete already; resume=never runs it again."
    return _end(target, again, where)


def _tracked(
    settings: Settings,
    target: RunFolder,
    supervisor: Supervisor,
    tracker: Tracker,
    keep_display: bool,
) -> str:
    """Evolves, and lets the tracker follow; returns where the tracker says to look."""
    status, where = Status.FAILED, ""
    tracker.start(target)
    try:
        _evolve(settings, target, supervisor, tracker, keep_display)
        status = Status.FINISHED
    except KeyboardInterrupt:
        status = Status.KILLED
        raise
    except Exception as error:
        target.fail(error)
        raise
    finally:
        where = tracker.finish(status)
    return where


def _evolve(
    settings: Settings,
    target: RunFolder,
    supervisor: Supervisor,
    tracker: Tracker,
    keep_display: bool,
) -> None:
    if isinstance(supervisor, Service):
        with blaming(path_of(type(supervisor))):
            line = supervisor.start()
        if line:
            print(line, file=sys.stderr)
    start = target.resume()
    done = start.generation if start is not None else 0
    evaluator = make_evaluator(settings)
    champion: Champion | None = None
    steps = evolve(settings.plan, settings.seed, supervisor, evaluator, start=start)
    written: Future[None] = Future()
    written.set_result(None)
    try:
        # A generation is written down while the episodes of the next one run.
        with (
            ThreadPoolExecutor(1, "writer") as writer,
            Progress(
                settings.progress,
                settings.gp.generations,
                _title(settings),
                done=done,
                keep=keep_display,
            ) as progress,
        ):
            for step in steps:
                written.result()
                written = writer.submit(_write, target, step, tracker)
                progress.show(step)
                champion = step.champion
            written.result()
    finally:
        steps.close()  # now, and not when the interpreter ends
        evaluator.close()
    assert champion is not None
    most = settings.supervisor.policy.get("most_fallback")  # None: a supervisor without a fallback
    target.finish(summary(target, champion, most))


def _write(target: RunFolder, step: Step, tracker: Tracker) -> None:
    target.append(step)
    tracker.generation()


def _title(settings: Settings) -> str:
    return f"{settings.name}: {settings.supervisor.name}, seed {settings.seed}"
