"""The library of runs without one: a tree for each behaviour, stored in the folder of runs."""

from __future__ import annotations

import hashlib
import json
import sys
from collections.abc import Callable, Iterator
from contextlib import closing
from dataclasses import asdict, dataclass
from math import inf
from pathlib import Path
from typing import Final

from filelock import FileLock

from islandgp.atomic_files import reading, write_atomic
from islandgp.bt.core.language import parse, to_text
from islandgp.bt.core.node import Node, size
from islandgp.config.settings import Settings
from islandgp.domain import Domain
from islandgp.evaluation.base import Evaluator
from islandgp.evaluation.perturbation import staged
from islandgp.evolution.single_behaviours import single_behaviours
from islandgp.plain import from_json, read_json
from islandgp.running.resume import domain_code
from islandgp.supervision.library import Library

SEARCH: Final = 4  # version of the search, which is part of a stored library's file name


def automatic_library(
    settings: Settings, domain: Domain, make_evaluator: Callable[[], Evaluator]
) -> Library:
    """A tree for each behaviour, found by a search once and stored in `runs` for later runs.

    If stages of the curriculum change the world, the missing behaviours are searched in each
    stage's world, in order. Behaviours without a tree are reported to the error stream by every run
    that uses the library.

    Args:
        settings: of the run.
        domain: with the run's world.
        make_evaluator: called if a search is needed.

    Raises:
        EvaluationError: an episode of the search cannot be run.
        RunError: the stored file is damaged.
    """
    file = library_file(settings, domain)
    file.parent.mkdir(parents=True, exist_ok=True)
    with FileLock(file.with_suffix(".lock")):  # jobs of a sweep wait for the first one's search
        if not file.exists():
            library = _search(settings, domain, make_evaluator)
            write_atomic(file, json.dumps(asdict(library), indent=1).encode())
    with reading("a library that was searched for", file):
        kept = from_json(KeptLibrary, read_json(file.read_bytes()))
    if missing := [name for name in settings.classes.behaviours if name not in kept.trees]:
        _say(
            f"library: found no tree for {', '.join(missing)} in any stage; supervisors inject none"
            " for that. Write a tree for each behaviour, and name their folder in library.folder"
        )
    vocabulary = domain.schema.vocabulary
    trees = {n: parse(t, vocabulary, name=f"{file}: {n}") for n, t in kept.trees.items()}
    return Library(trees, kept.trees, {name: (name,) for name in trees}, {}, kept.episodes)


def library_file(settings: Settings, domain: Domain) -> Path:
    """The file of the library for these settings, which need not exist."""
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
    most = most_episodes(settings)
    key = json.dumps([SEARCH, shape, repr(domain.schema), domain_code(settings), most])
    digest = hashlib.sha256(key.encode()).hexdigest()[:16]
    return Path(settings.runs) / ".libraries" / f"{digest}.json"


def most_episodes(settings: Settings) -> float:
    """Most episodes of the search: a quarter of the budget, which leaves one generation."""
    if settings.budget.episodes is None:
        return inf
    one = settings.gp.population * settings.gp.episodes
    left = settings.budget.episodes - one - max(1, round(settings.gp.validation * one))
    return max(0, min(left, settings.budget.episodes // 4))


@dataclass(frozen=True, slots=True)
class KeptLibrary:
    """A library that was found by a search."""

    episodes: int  # of the search; they count in the budget of each run with this library
    trees: dict[str, str]  # canonical texts by behaviour


def _search(
    settings: Settings, domain: Domain, make_evaluator: Callable[[], Evaluator]
) -> KeptLibrary:
    """The trees found, in the order of the behaviours, and the number of episodes."""
    by_behaviour, episodes = dict[str, Node](), 0
    _say("searching for a tree of each behaviour, once")
    with closing(make_evaluator()) as evaluator:
        for stage, name, tree, spent in single_behaviours(
            settings.classes,
            settings.plan(domain).space,
            settings.gp.mutation,
            evaluator,
            [*_stages(settings)],
            most=most_episodes(settings),
        ):
            episodes = spent
            if tree is not None:
                by_behaviour[name] = tree
            if settings.progress != "off":
                outcome = "no tree found" if tree is None else f"a tree of {size(tree)} nodes"
                _say(f"{name}: {outcome} in the world of stage {stage + 1}")
    found = [name for name in settings.classes.behaviours if name in by_behaviour]
    return KeptLibrary(episodes, {name: to_text(by_behaviour[name]) for name in found})


def _stages(settings: Settings) -> Iterator[int]:
    """The stages to search: the first one with each world, or the last one if all are equal.

    Early stages come first, as behaviours are easiest to find there.
    """
    stages = settings.curriculum.stages
    worlds = [staged(settings.world, stage.world) for stage in stages]
    if all(world == worlds[0] for world in worlds):
        yield len(stages) - 1
        return
    yield from (i for i, world in enumerate(worlds) if world not in worlds[:i])


def _say(line: str) -> None:
    print(f"islandgp: {line}", file=sys.stderr)
