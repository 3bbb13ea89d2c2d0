"""One run from settings to summary: wires the parts, and owns every side effect."""

from __future__ import annotations

import hashlib
import json
import sys
from collections.abc import Mapping
from dataclasses import asdict
from pathlib import Path
from time import time
from typing import Any, Final
from uuid import uuid4

import yaml

from islandgp.bt.language import parse
from islandgp.bt.node import Node
from islandgp.errors import RunError
from islandgp.evaluation.base import Evaluator, Setting
from islandgp.evaluation.cache import Cached
from islandgp.evolution.loop import evolve
from islandgp.evolution.record import Champion
from islandgp.progress import Progress
from islandgp.resources import resource
from islandgp.scoring.rewards import Component
from islandgp.settings import Settings
from islandgp.supervision.base import Service, Setup, Supervisor
from islandgp.tracking.base import Tracker
from islandgp.tracking.folder import About, RunFolder, Status
from islandgp.tracking.parameters import redacted
from islandgp.version import code_version

FREE: Final = frozenset({"runs", "resume", "progress", "evaluator", "tracking"})
"""Keys that may differ between a run and its resumption: they do not change its records."""


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
    supervisor: Supervisor = part.factory.make(part.settings(), setup_of(settings, folder))
    return supervisor


def check_ready(settings: Settings) -> None:
    """Raises SupervisionError where the supervisor could not work, e.g. without a key."""
    part = settings.supervisor
    if hasattr(part.factory, "ready"):
        part.factory.ready(part.settings())


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
) -> str:
    """Runs an experiment, or what is missing of it, in `folder`; returns the summary text.

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
        tracker.start(target)
        where = tracker.finish(Status.FINISHED)
        again = "This run was complete already; resume=never runs it again."
        return f"{report(target)}\n{again}\n{where}".rstrip()
    supervisor = make_supervisor(settings, target.path)
    target.open(
        yaml.safe_dump(config, sort_keys=False), _about(settings, config, target, home, command)
    )
    try:
        where = _tracked(settings, target, supervisor, tracker, keep_display)
    finally:
        target.close()
    return f"{report(target)}\n{where}".rstrip()


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


def _about(
    settings: Settings, config: Mapping[str, Any], target: RunFolder, home: Path, command: str
) -> About:
    before = target.about()
    shape = {key: value for key, value in config.items() if key not in FREE}
    alike = {key: value for key, value in shape.items() if key not in {"seed", "name"}}
    return About(
        id=before.id if before else uuid4().hex,
        title=target.path.name,
        home=str(home),
        command=command,
        started=before.started if before else int(1000 * time()),
        identity=_hash(shape),
        tags={
            "supervisor": settings.supervisor.name,
            "seed": str(settings.seed),
            "sweep": settings.name,
            "code": code_version(),
            "config": _hash(alike),  # the same for all seeds
        },
    )


def _hash(config: Mapping[str, Any]) -> str:
    return hashlib.sha256(json.dumps(config, sort_keys=True).encode()).hexdigest()[:12]


def _evolve(
    settings: Settings,
    target: RunFolder,
    supervisor: Supervisor,
    tracker: Tracker,
    keep_display: bool,
) -> None:
    if isinstance(supervisor, Service) and (line := supervisor.start()):
        print(line, file=sys.stderr)
    start = target.resume()
    done = start.generation if start is not None else 0
    evaluator = make_evaluator(settings)
    champion: Champion | None = None
    steps = evolve(settings.plan, settings.seed, supervisor, evaluator, start=start)
    try:
        with Progress(
            settings.progress,
            settings.gp.generations,
            _title(settings),
            done=done,
            keep=keep_display,
        ) as progress:
            for step in steps:
                target.append(step)
                tracker.generation()
                progress.show(step)
                champion = step.champion
    finally:
        steps.close()  # now, and not when the interpreter ends
        evaluator.close()
    assert champion is not None
    target.finish(summary(target, champion))


def summary(target: RunFolder, champion: Champion) -> dict[str, Any]:
    """What a run came to, from its records; `seconds` are those spent in its generations."""
    first: dict[str, int | None] = {"complete": None, "excellent": None}
    snapshots = [record["snapshot"] for record in target.records()]
    seconds = (c["evaluation"] + c["supervision"] + c["operators"] for c in target.costs())
    for tier in first:
        first[tier] = next((s["generation"] for s in snapshots if s["tiers"][tier]), None)
    return {
        "champion": asdict(champion),
        "first": first,
        "final_best": snapshots[-1]["best"],
        "final_mean": snapshots[-1]["mean"],
        "mean_diversity": sum(s["diversity"] for s in snapshots) / len(snapshots),
        "generations": len(snapshots),
        "seconds": round(sum(seconds), 3),
    }


def choose(folder: RunFolder, resume: str, config: Mapping[str, Any]) -> RunFolder:
    """The folder to work in: `never` takes a new one beside an old one.

    Raises:
        RunError: the folder holds a run of another configuration, and `resume` is `auto`,
            or `force` while that run is finished.
    """
    before = folder.config()
    if before is None:
        return folder
    if resume == "never":
        n = 2
        while (path := folder.path.with_name(f"{folder.path.name}.{n}")).exists():
            n += 1
        return RunFolder(path)
    changed = differences(yaml.safe_load(before), config)
    if changed and (resume != "force" or folder.finished()):
        state = "the finished run" if folder.finished() else "the run"
        raise RunError(
            f"Expected the configuration of {state} in {folder.path}, found it changed:\n  "
            + "\n  ".join(changed)
            + "\nGive this run another name=..., or resume=never for a new folder beside it."
        )
    return folder


def differences(old: Mapping[str, Any], new: Mapping[str, Any], path: str = "") -> list[str]:
    """The keys whose values differ, as `key: old -> new`; keys of FREE are left out."""
    found = []
    for key in sorted({*old, *new}, key=str):
        if not path and key in FREE:
            continue
        name, a, b = f"{path}{key}", old.get(key), new.get(key)
        if isinstance(a, Mapping) and isinstance(b, Mapping):
            found += differences(a, b, f"{name}.")
        elif a != b:
            found.append(f"{name}: {a} -> {b}")
    return found


def _title(settings: Settings) -> str:
    return f"{settings.name}: {settings.supervisor.name}, seed {settings.seed}"


def report(target: RunFolder) -> str:
    """A finished run in a few lines for people."""
    s = target.summary()
    best = s["champion"]["record"]
    parts = sorted(zip(Component, best["components"], strict=True), key=lambda p: -abs(p[1]))
    came_from = ", ".join(f"{c.name.lower()} {p:+,.0f}" for c, p in parts if p)
    first = {tier: "never" if g is None else f"generation {g}" for tier, g in s["first"].items()}
    return "\n".join(
        (
            f"Best fitness {best['fitness']:,.0f} in generation {s['champion']['generation']}:"
            f" {came_from}",
            f"First Complete Robot: {first['complete']};"
            f" first Excellent Robot: {first['excellent']}",
            f"Results: {target.path}",
            "",
            best["tree"].rstrip(),
            "",
        )
    )
