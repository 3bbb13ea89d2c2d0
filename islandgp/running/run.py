"""One run from settings to summary: wires the parts, and owns every side effect."""

from __future__ import annotations

import hashlib
import json
import sys
from collections.abc import Callable, Mapping
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import closing
from dataclasses import dataclass, replace
from itertools import islice
from pathlib import Path
from typing import Any

import yaml

from islandgp.bt.language import parse, to_text
from islandgp.bt.node import Node, size, within
from islandgp.config.settings import Settings
from islandgp.domain import Domain
from islandgp.errors import ConfigError
from islandgp.evaluation.base import Cached, Evaluator
from islandgp.evolution.loop import evolve
from islandgp.evolution.plan import Plan
from islandgp.evolution.record import Champion, Step
from islandgp.evolution.single_behaviours import single_behaviours
from islandgp.evolution.validation import Best, Validation, candidates, validate
from islandgp.evolution.validation import worlds_of as validation_worlds
from islandgp.plain import must_fit
from islandgp.plugin import blaming, path_of
from islandgp.records.checkpoint import reading, write_atomic
from islandgp.records.folder import RunFolder, Status
from islandgp.records.parameters import redacted
from islandgp.running.progress import Progress
from islandgp.running.report import is_mostly_fallback, report, summary
from islandgp.running.resume import about_run, choose, domain_code
from islandgp.supervision.base import RunContext, Service, Supervisor, Witness
from islandgp.supervision.library import Library, library_folder, read_library, read_tree
from islandgp.tracking.base import Tracker


class Pruned(Exception):
    """A run was stopped because other trials of a search are better."""


Judge = Callable[[int, float], None]
"""Takes a generation and its highest fitness; may raise Pruned."""


@dataclass(frozen=True, slots=True)
class End:
    """How a finished run ended."""

    text: str  # its result, for people
    mostly_fallback: bool  # its fallback gave more of the answers than its settings allow


def run_context(settings: Settings, folder: Path | None = None) -> RunContext:
    """What a run gives to its supervisor."""
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
        library=lambda: make_library(settings, domain),
        crisis=settings.gp.crisis,
        adapt_mutation=settings.supervisor.adapt_mutation,
        inject=settings.supervisor.inject,
    )


def make_library(settings: Settings, domain: Domain) -> Library:
    """The trees that supervisors inject. Raises ConfigError, TreeError.

    Without a folder a tree for each behaviour is searched for, once for all runs in `runs`.
    """
    how, vocabulary = settings.library, domain.schema.vocabulary
    if how.folder is None:
        return automatic_library(settings, domain)
    folder = library_folder(how.folder, domain)
    return read_library(how, folder, vocabulary, settings.classes)


def plan_of(settings: Settings, domain: Domain) -> Plan:
    """What a run is made of, the library's trees included where they open the population."""
    plan = settings.plan(domain)
    if not settings.gp.founders:
        return plan
    library = make_library(settings, domain)
    names = dict.fromkeys(name for target in library.targets.values() for name in target)
    trees = (library.trees[name] for name in names)
    return replace(plan, founders=tuple(t for t in trees if within(t, plan.gp.limits)))


def automatic_library(settings: Settings, domain: Domain) -> Library:
    """A tree for each behaviour, searched for once and kept in `runs` for all runs that are alike.

    Raises ConfigError where no tree shows any behaviour.
    """
    shape = settings.model_dump(
        mode="json",
        include={
            "domain": True,
            "world": True,
            "rewards": True,
            "curriculum": {"stages"},
            "classes": {"behaviours"},
            "gp": {"trees", "mutation", "max_depth", "max_nodes"},
        },
    )
    key = json.dumps([shape, repr(domain.schema), domain_code(settings)])
    digest = hashlib.sha256(key.encode()).hexdigest()[:16]
    file = Path(settings.runs) / ".libraries" / f"{digest}.json"
    if not file.exists():
        behaviours = len(settings.classes.behaviours)
        print("islandgp: searching for a tree of each behaviour, once", file=sys.stderr)
        stages = settings.curriculum.stages
        space = settings.plan(domain).space
        # Where stages change the world, a behaviour is easiest to find in the first one.
        stage = 0 if any(s.world for s in stages) else len(stages) - 1
        found: dict[str, Node] = {}
        with closing(make_evaluator(settings)) as evaluator:
            search = single_behaviours(
                settings.classes, space, settings.gp.mutation, evaluator, stage
            )
            for n, (name, tree) in enumerate(search, 1):
                if tree is not None:
                    found[name] = tree
                if settings.progress != "off":
                    said = "no tree found" if tree is None else f"a tree of {size(tree)} nodes"
                    print(f"islandgp: {name}: {said} ({n} of {behaviours})", file=sys.stderr)
        file.parent.mkdir(parents=True, exist_ok=True)
        plain = {name: to_text(tree) for name, tree in found.items()}
        write_atomic(file, json.dumps(plain, indent=1).encode())
    with reading("a library that was searched for", file):
        texts = must_fit(dict[str, str], file.read_bytes())
    if not texts:
        raise ConfigError(
            "library: expected to find a tree that shows one of the behaviours"
            f" ({', '.join(settings.classes.behaviours)}), found none; write one, and name its"
            " folder in library.folder."
        )
    trees = {name: parse(text, domain.schema.vocabulary) for name, text in texts.items()}
    return Library(trees, texts, {name: (name,) for name in trees}, {})


def make_supervisor(settings: Settings, folder: Path | None) -> Supervisor:
    """The supervisor that the settings choose. Raises SupervisionError when it cannot work."""
    part = settings.supervisor
    with blaming(path_of(part.factory)):
        context = run_context(settings, folder)
        supervisor: Supervisor = part.factory.make(part.settings(), context)
        if not callable(getattr(supervisor, "advise", None)):
            made = type(supervisor).__name__
            raise TypeError(f"expected make to return a supervisor, with advise, found {made}")
    return supervisor


def check_ready(settings: Settings, coming: frozenset[Path] = frozenset()) -> None:
    """Raises SupervisionError where the supervisor could not work, e.g. without a key.

    A tracker that could not raises TrackingError. `coming` are the folders of the runs that the
    same command makes before this one.
    """
    tracking = settings.tracking
    if hasattr(tracking.factory, "ready"):
        with blaming(path_of(tracking.factory)):
            tracking.factory.ready(tracking.settings(), Path.cwd())
    part = settings.supervisor
    if hasattr(part.factory, "ready"):
        with blaming(path_of(part.factory)):
            context = replace(run_context(settings), coming=coming)
            part.factory.ready(part.settings(), context)


def make_evaluator(settings: Settings) -> Evaluator:
    """The evaluator that the settings choose."""
    part = settings.evaluator
    evaluator: Evaluator = part.factory.make(part.settings(), settings.problem())
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
) -> End:
    """Runs an experiment, or what is missing of it, in `folder`.

    `config` is the resolved configuration that `settings` were read from, `home` the
    folder in which the command was given, and `command` does the run again. The live
    display stays on the terminal with `keep_display`. `judge` gets each generation with its
    highest fitness, also those before a resumption, and may stop the run by raising Pruned.

    Raises:
        Pruned: as `judge`.
        RunError: the folder belongs to another configuration or another process.
        EvaluationError, SupervisionError: the run cannot go on; what it has is kept.
    """
    config = redacted(config)
    target = choose(RunFolder(folder), settings, config)
    tracker: Tracker = settings.tracking.factory.make(settings.tracking.settings(), home)
    if target.finished():
        return _complete(target, tracker)
    supervisor = make_supervisor(settings, target.path)
    about = about_run(settings, config, target, home, command)
    try:
        target.open(yaml.safe_dump(config, sort_keys=False), about)
        if target.finished():  # by the process that had the folder until now
            return _complete(target, tracker)
        status = Status.FAILED
        tracker.start(target)
        try:
            _evolve(settings, target, supervisor, tracker, keep_display, judge)
            status = Status.FINISHED
        except (KeyboardInterrupt, Pruned):
            status = Status.KILLED
            raise
        except Exception as error:
            target.fail(error)
            raise
        finally:
            where = tracker.finish(status)
    finally:
        target.close()
    return _end(target, where)


def _end(target: RunFolder, *more: str) -> End:
    text = "\n".join((report(target), *more)).rstrip()
    return End(text, is_mostly_fallback(target.summary()))


def _complete(target: RunFolder, tracker: Tracker) -> End:
    """A finished run as it is; the tracker sends what is missing of it."""
    target.restore()
    tracker.start(target)
    where = tracker.finish(Status.FINISHED)
    again = "This run was complete already; resume=never runs it again."
    return _end(target, again, where)


def _evolve(
    settings: Settings,
    target: RunFolder,
    supervisor: Supervisor,
    tracker: Tracker,
    keep_display: bool,
    judge: Judge | None,
) -> None:
    if isinstance(supervisor, Service):
        with blaming(path_of(type(supervisor))):
            line = supervisor.start()
        if line:
            print(line, file=sys.stderr)
    start = target.resume(lambda line: print(f"islandgp: {line}", file=sys.stderr))
    done = 0 if start is None else start.generation
    if judge is not None:
        for record in islice(target.records(), done):
            judge(record["snapshot"]["generation"], record["snapshot"]["best"])
    evaluator = make_evaluator(settings)
    fittest: Champion | None = None
    plan = plan_of(settings, settings.make_domain())
    past = target.generations() if done and isinstance(supervisor, Witness) else ()
    steps = evolve(plan, settings.seed, supervisor, evaluator, start=start, past=past)
    written: Future[None] = Future()
    written.set_result(None)
    try:
        # A generation is written down while the episodes of the next one run.
        with (
            ThreadPoolExecutor(1, "writer") as writer,
            Progress(
                settings.progress,
                settings.gp.generations,
                f"{settings.name}: {settings.supervisor.name}, seed {settings.seed}",
                settings.classes.milestones,
                done=done,
                keep=keep_display,
            ) as progress,
        ):
            for step in steps:
                written.result()
                written = writer.submit(_write, target, step, tracker)
                progress.show(step)
                fittest = step.champion
                if judge is not None:
                    written.result()
                    judge(step.record.snapshot.generation, step.record.snapshot.best)
            written.result()
        assert fittest is not None
        best = best_robot(settings, target, evaluator)
    finally:
        steps.close()  # now, and not when the interpreter ends
        evaluator.close()
    most = settings.supervisor.policy.get("most_fallback")  # None: a supervisor without a fallback
    target.finish(summary(target, fittest, best, settings.classes.milestones, most))


def best_robot(settings: Settings, target: RunFolder, evaluator: Evaluator) -> Best:
    """The run's best robot: its most promising trees race in worlds that trained no tree.

    With gp.validation=0 it is the fittest individual of the last stage.
    """
    found = candidates(target.records(), settings.classes)
    episodes = round(settings.gp.validation * settings.gp.episodes_in_all)
    verdict: Validation | None = None
    if episodes < len(found):
        winner = max(found, key=lambda c: c.trained)
    else:
        used: set[int] = set()
        stage = 0
        for record in target.records():
            used.update(record["worlds"])
            stage = record["snapshot"]["stage"]
        winner, verdict = validate(
            found,
            validation_worlds(settings.seed, frozenset(used), episodes),
            evaluator,
            stage,
            settings.classes,
            episodes=episodes,
            yardstick=_yardstick(settings),
        )[0]
    born = next(target.records(winner.generation))
    own = next(i for i in born["individuals"] if i["id"] == winner.id)
    return Best(winner.generation, own, verdict)


def _yardstick(settings: Settings) -> tuple[str, str] | None:
    """Name and canonical text of the tree that best robots are compared with, if there is one."""
    how, domain = settings.library, settings.make_domain()
    if how.folder is None or not how.yardsticks:
        return None
    name = how.yardsticks[0]
    text = read_tree(library_folder(how.folder, domain), name)
    return name, to_text(parse(text, domain.schema.vocabulary, name=name))


def _write(target: RunFolder, step: Step, tracker: Tracker) -> None:
    target.append(step)
    tracker.generation()
