"""One run from settings to summary: connects the components, and has all side effects."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterable, Mapping, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass, replace
from itertools import islice
from pathlib import Path
from typing import Any, Final

import yaml

from islandgp.bt.core.node import Node, within
from islandgp.config.settings import Settings
from islandgp.domain import Domain
from islandgp.evaluation.base import Cached, Evaluator
from islandgp.evolution.loop import evolve
from islandgp.evolution.validation import Best
from islandgp.gp.archive import archive_record
from islandgp.gp.plan import Plan
from islandgp.gp.record import Step
from islandgp.plugin import path_of, plugin_errors
from islandgp.records.archive_file import ArchiveFile
from islandgp.records.folder import RunFolder, Status
from islandgp.records.parameters import redacted
from islandgp.running.best_robot import best_robot, candidates_of
from islandgp.running.page_writer import PageWriter
from islandgp.running.progress import Progress
from islandgp.running.report import is_mostly_fallback, report, summary
from islandgp.running.resume import about_run, choose
from islandgp.running.totals import RunTotals, totals_of
from islandgp.search.base import Search, SearchContext
from islandgp.supervision.base import (
    GenerationListener,
    RunContext,
    Supervisor,
    SupervisorLifecycle,
)
from islandgp.supervision.library import Library, library_folder, read_library
from islandgp.tracking.base import BackgroundTracker, Tracker
from islandgp.trust import is_own_code, names_in, trust
from islandgp.waiting import command_waits

_DUMPER: Final = getattr(yaml, "CSafeDumper", yaml.SafeDumper)
"""The dumper of the C library, unless PyYAML was built without it; it is four times as fast."""


class Pruned(Exception):
    """A run was stopped because other trials of a search are better."""


Judge = Callable[[int, float], None]
"""(generation, highest fitness) -> None; may raise Pruned to stop the run."""


@dataclass(frozen=True, slots=True)
class RunResult:
    """Result of a finished run."""

    text: str  # summary for the console
    mostly_fallback: bool  # the fallback's share exceeds `most_fallback`


@dataclass(slots=True)
class LibraryCost:
    """Episodes of the search for a run's library; 0 until the run loads it."""

    episodes: int = 0

    def of(self, library: Library) -> Library:
        """Stores the cost of a library and returns the library."""
        self.episodes = library.episodes
        return library


def run_context(
    settings: Settings, folder: Path | None = None, cost: LibraryCost | None = None
) -> RunContext:
    """The arguments of a supervisor's `make`; parts that the search does not use are off."""
    cost, uses = cost or LibraryCost(), settings.search.factory.uses
    problem, curriculum = settings.problem(), settings.curriculum
    domain = problem.domain
    return RunContext(
        seed=settings.seed,
        generations=settings.gp.generations,
        limits=settings.gp.limits,
        folder=folder,
        schema=domain.schema,
        domain=domain,
        domain_in=lambda generation: problem.at(curriculum.stage(generation)),
        rewards=settings.rewards,
        classes=settings.classes,
        library=lambda: cost.of(make_library(settings, domain)),
        crisis=settings.gp.crisis,
        gp=settings.gp,
        curriculum=curriculum,
        adapt_mutation=settings.supervisor.adapt_mutation and "rate" in uses,
        inject=settings.supervisor.inject and "tree" in uses,
        edits=settings.supervisor.edits if "edits" in uses else 0,
        constraints=settings.constraints,
    )


def make_library(settings: Settings, domain: Domain) -> Library:
    """Loads the library of trees to inject. Raises ConfigError or TreeError.

    Without a folder a search finds a tree for each behaviour, once for all runs in `runs`.
    """
    library, vocabulary = settings.library, domain.schema.vocabulary
    if library.folder is None:
        from islandgp.running.automatic_library import automatic_library  # only without a folder

        return automatic_library(settings, domain, lambda: make_evaluator(settings))
    folder = library_folder(library.folder, domain)
    return read_library(library, folder, vocabulary, settings.classes)


def plan_of(
    settings: Settings,
    domain: Domain,
    cost: LibraryCost | None = None,
    warn: Callable[[str], None] = lambda _: None,
) -> Plan:
    """The plan of a run, with the first trees of its population from a library or an archive.

    `warn` is called with one line if trees of an archive are left out.

    Raises ConfigError, RunError or TreeError if these cannot be loaded.
    """
    plan = settings.plan(domain)
    if settings.start is not None:
        from islandgp.running.start import start_trees  # only with `start`

        limits, most = plan.gp.limits, plan.gp.population
        trees = start_trees(settings.start, plan.vocabulary, limits, most, warn)
        return replace(plan, founders=trees)
    if not settings.gp.founders:
        return plan
    library = (cost or LibraryCost()).of(make_library(settings, domain))
    names = dict.fromkeys(name for target in library.targets.values() for name in target)
    founders = (library.trees[name] for name in names)
    return replace(plan, founders=tuple(t for t in founders if within(t, plan.gp.limits)))


def make_supervisor(
    settings: Settings, folder: Path | None, cost: LibraryCost | None = None
) -> Supervisor:
    """Makes the configured supervisor. Raises SupervisionError if it cannot work."""
    part = settings.supervisor
    with plugin_errors(path_of(part.factory)):
        context = run_context(settings, folder, cost)
        supervisor: Supervisor = part.factory.make(part.settings(), context)
        if not callable(getattr(supervisor, "advise", None)):
            kind = type(supervisor).__name__
            raise TypeError(f"expected make to return a supervisor, with advise, found {kind}")
    return supervisor


def check_parts(settings: Settings, planned_runs: frozenset[Path] = frozenset()) -> None:
    """Checks the parts of a run before it starts.

    Args:
        settings: of the run.
        planned_runs: folders of the runs that the same command does before this one.

    Raises:
        SupervisionError: the supervisor cannot work, e.g. without a key.
        TrackingError: the tracker cannot store runs.
        ConfigError: the search does not support the settings, or the archive of `start` is of
            another domain.
        RunError: the archive of `start` is missing or damaged.
    """
    if settings.start is not None:
        plan_of(settings, settings.make_domain())
    tracking = settings.tracking
    if hasattr(tracking.factory, "check"):
        with plugin_errors(path_of(tracking.factory)):
            tracking.factory.check(tracking.settings(), Path.cwd())
    make_search(settings, settings.plan(settings.make_domain()))
    part = settings.supervisor
    if hasattr(part.factory, "check"):
        with plugin_errors(path_of(part.factory)):
            context = replace(run_context(settings), planned_runs=planned_runs)
            part.factory.check(part.settings(), context)


def make_search(settings: Settings, plan: Plan) -> Search:
    """Makes the configured search. Raises ConfigError, TreeError or PartError."""
    part = settings.search

    def library() -> Mapping[str, Node]:
        """The trees of the library's folder; {} without a folder, as a search is expensive."""
        if settings.library.folder is None:
            return {}
        return make_library(settings, settings.make_domain()).trees

    with plugin_errors(path_of(part.factory)):
        search: Search = part.factory.make(part.settings(), SearchContext(plan, library))
    return search


def make_evaluator(settings: Settings, *, perturbed: bool | None = None) -> Evaluator:
    """Makes the configured evaluator; `perturbed` as in `Settings.problem`."""
    part, problem = settings.evaluator, settings.problem(perturbed=perturbed)
    evaluator: Evaluator = part.factory.make(part.settings(), problem)
    return Cached(evaluator) if part.cache else evaluator


def run(
    settings: Settings,
    config: Mapping[str, Any],
    folder: Path,
    *,
    home: Path,
    command: str = "",
    keep_display: bool = True,
    judge: Judge | None = None,
    ends_command: bool = False,
) -> RunResult:
    """Runs an experiment, or continues an interrupted run.

    Args:
        settings: of the run.
        config: the resolved configuration of the settings.
        folder: of the run.
        home: working folder of the command.
        command: that repeats the run, for its metadata.
        keep_display: True: the live display stays on the terminal.
        judge: called with each generation and its highest fitness, also for recorded ones.
        ends_command: True: the command ends with this run, so the tracker may send the last records
            afterwards.

    Returns:
        The result of the finished run.

    Raises:
        Pruned: raised by `judge`.
        RunError: the folder belongs to another configuration or another process.
        EvaluationError, SupervisionError: the run cannot continue; its records are kept.
    """
    trust(names_in(config))  # the user's classes; a launcher may have started this process
    config = redacted(config)
    target = choose(RunFolder(folder), settings, config)
    tracker: Tracker = settings.tracking.factory.make(settings.tracking.settings(), home)
    if target.finished():
        return _complete(target, tracker)
    if ends_command and isinstance(tracker, BackgroundTracker):
        tracker.allow_background()
    cost = LibraryCost()
    supervisor = make_supervisor(settings, target.path, cost)
    plan = plan_of(settings, settings.make_domain(), cost, _warn)
    plan.budget.check_library(cost.episodes, plan.gp)
    # Code of the user may take any time to record an episode, or print messages.
    leaves = ends_command and not _waits(settings) and is_own_code(config)
    page = PageWriter(target, leaves=leaves)
    about = about_run(settings, config, target, home, command)
    try:
        target.open(yaml.dump(config, Dumper=_DUMPER, sort_keys=False), about)
        if target.finished():  # another process may have finished it before the folder was locked
            return _complete(target, tracker)
        return _evolve_tracked(
            _OpenRun(settings, plan, cost, target, supervisor, tracker, page, keep_display, judge)
        )
    finally:
        target.close()


def _waits(settings: Settings) -> bool:
    """True if a command waits at its end until all is written and sent."""
    wait = settings.tracking.policy.get("wait")
    return command_waits(wait if isinstance(wait, bool) else "auto")


@dataclass(frozen=True, slots=True)
class _OpenRun:
    """The parts of a run whose folder is open; the arguments of `run` are described there."""

    settings: Settings
    plan: Plan
    library_cost: LibraryCost
    target: RunFolder
    supervisor: Supervisor
    tracker: Tracker
    page: PageWriter
    keep_display: bool
    judge: Judge | None


def _evolve_tracked(run: _OpenRun) -> RunResult:
    """Evolves, with the run's tracker and page."""
    status = Status.FAILED
    run.tracker.start(run.target)
    try:
        totals = _evolve(run)
        status = Status.FINISHED
    except (KeyboardInterrupt, Pruned):
        status = Status.KILLED
        raise
    except Exception as error:
        run.target.fail(error)
        raise
    finally:
        try:
            run.page.end(status)
        finally:
            where = run.tracker.finish(status)
    return _end(run.target, totals.costs, where)


def _end(target: RunFolder, costs: Sequence[Mapping[str, Any]], *notes: str) -> RunResult:
    text = "\n".join((report(target, costs), *notes)).rstrip()
    return RunResult(text, is_mostly_fallback(target.summary()))


def _complete(target: RunFolder, tracker: Tracker) -> RunResult:
    """The result of a run that was finished before; the tracker sends missing records.

    Raises:
        RunError: a file of the run is damaged.
    """
    target.must_be_sound(page=False)
    target.restore()
    PageWriter(target).end(Status.FINISHED)
    tracker.start(target)
    where = tracker.finish(Status.FINISHED)
    note = "This run was complete already; resume=never runs it again."
    return _end(target, list(target.costs()), note, where)


def _evolve(run: _OpenRun) -> RunTotals:
    settings, plan, target, supervisor = run.settings, run.plan, run.target, run.supervisor
    if isinstance(supervisor, SupervisorLifecycle):
        with plugin_errors(path_of(type(supervisor))):
            line = supervisor.start()
        if line:
            print(line, file=sys.stderr)
    start = target.resume(_warn)
    done = 0 if start is None else start.generation
    if run.judge is not None:
        for record in islice(target.records(), done):
            run.judge(record["snapshot"]["generation"], record["snapshot"]["best"])
    evaluator = make_evaluator(settings)
    needed = isinstance(supervisor, GenerationListener) or plan.switches.edits
    steps = evolve(
        plan,
        settings.seed,
        supervisor,
        evaluator,
        search=make_search(settings, plan),
        start=start,
        past=target.generations() if done and needed else (),
        library_episodes=lambda: run.library_cost.episodes,
    )
    progress = Progress(
        settings.progress,
        settings.gp.generations,
        f"{settings.name}: {settings.supervisor.name}, seed {settings.seed}",
        settings.classes.milestones,
        rate="rate" in settings.search.factory.uses,
        done=done,
        keep=run.keep_display,
    )

    totals = totals_of(target, candidates_of(settings))
    run.page.curves = totals.curves

    def write(step: Step) -> None:
        totals.add(*target.append(step))
        run.tracker.generation()
        run.page.generation()

    try:
        last = _keep(steps, write, progress, run.judge)
        best = best_robot(settings, target, totals, evaluator)
    finally:
        steps.close()  # not only when the interpreter ends
        evaluator.close()
    _finish(settings, plan, target, totals, last, best)
    return totals


def _warn(line: str) -> None:
    print(f"islandgp: {line}", file=sys.stderr)


def _keep(
    steps: Iterable[Step], write: Callable[[Step], None], progress: Progress, judge: Judge | None
) -> Step:
    """Writes each step while the episodes of the next one run; returns the last one."""
    step: Step | None = None
    writing: Future[None] = Future()
    writing.set_result(None)
    with ThreadPoolExecutor(1, "writer") as writer, progress:
        for step in steps:
            writing.result()
            writing = writer.submit(write, step)
            progress.show(step)
            if judge is not None:
                writing.result()
                judge(step.record.snapshot.generation, step.record.snapshot.best)
        writing.result()
    assert step is not None
    return step


def _finish(
    settings: Settings, plan: Plan, target: RunFolder, totals: RunTotals, last: Step, best: Best
) -> None:
    """Writes the archive and the summary of a run at its end."""
    axes, floor = plan.archive.axes(plan.classes), plan.archive.floor
    counts = archive_record(last.archive, axes, floor=floor)
    archive = ArchiveFile.of(plan.vocabulary.domain, axes, floor, last.archive, counts)
    end = summary(
        totals,
        last.champion,
        best,
        settings.classes.milestones,
        settings.supervisor.policy.get("most_fallback"),  # None: it has no fallback
        constraints=settings.constraints,
    )
    target.finish({**end, "stopped": last.stopped} if last.stopped else end, archive)
