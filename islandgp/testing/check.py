"""Checks a domain against the interface of `islandgp.domain`.

    from islandgp.testing import check_domain

    def test_the_domain() -> None:
        assert check_domain(lambda: Maze.make(World(...), RewardTable(...))).faults == {}

`islandgp domain NAME --check` does the same from the command line.
"""

from __future__ import annotations

import pickle
from collections.abc import Callable, Hashable, Iterable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass
from inspect import getfile
from itertools import combinations_with_replacement, pairwise
from math import isclose, isfinite
from pathlib import Path
from textwrap import indent
from typing import Any, Final

import numpy as np
import yaml

from islandgp.bt.core.language import domain_of, parse
from islandgp.bt.core.node import Limits, Node, ParallelArgs, leaf, sequence
from islandgp.domain import Domain, Schema
from islandgp.errors import IslandError, TimeLimitError
from islandgp.gp.random_trees import TreeSettings, TreeSpace, random_tree
from islandgp.resources import resource
from islandgp.supervision.library import library_folder
from islandgp.testing.episodes import (
    SEEDS,
    Promise,
    Record,
    Survey,
    fault_text,
    tree_line,
    unreached,
)
from islandgp.text_files import read_text_file

MAX_FAULTS: Final = 10  # failed episodes that are reported


@dataclass(frozen=True, slots=True)
class Check:
    """The result of `check_domain`."""

    faults: dict[str, str]  # by promise that is broken
    survey: Survey | None  # the episodes; None: the domain could not be made

    @property
    def trees_run(self) -> int:
        """Number of trees whose episodes raised no exception."""
        return len({run.tree for run in self.survey.runs}) if self.survey else 0

    def unreached(self) -> list[str]:
        """A line for the events, actions and keys of the schema that no tree has reached."""
        return list(unreached(self.survey)) if self.survey else []

    def shared(self) -> list[str]:
        """A line for actions that seem to share a resource that they do not declare.

        Two actions do if their order in a parallel changes an episode, and an action does with
        itself if two of it at once do not do the same as one. None if an episode failed.
        """
        return list(_seem_shared(self.survey)) if self.survey and not self.survey.crashes else []

    def lines(self) -> Iterator[str]:
        """A report: each promise, what no tree has reached, and resources that seem shared."""
        for promise in Promise if self.trees_run else self.faults:
            fault = self.faults.get(promise, "")
            yield f"{'FAILED' if fault else 'ok':<6}  {promise}"
            if fault:
                yield indent(fault, " " * 8)
        if not self.trees_run:
            yield "The other promises are checked as soon as the episode of a tree runs."
            return
        if lacking := self.unreached():
            yield f"\nNot reached by any of {self.trees_run} trees:"
            yield from (f"  {line}" for line in lacking)
            yield "A tree in a .bt file beside the domain's module is run as well."
        if shared := self.shared():
            yield "\nActions that seem to share a resource; declare it as their `uses` if they do:"
            yield from (f"  {line}" for line in shared)


def check_domain(
    make: Callable[[], Domain],
    *,
    trees: Iterable[str | Node] = (),
    random_trees: int = 20,
    timeout: float = 30.0,
) -> Check:
    """Runs trees in a domain and checks the promises of the interface.

    Args:
        make: makes a new but equal instance at each call.
        trees: that reach events, as texts or nodes; they run besides each action, random trees,
            and a tree that tries the actions in random order.
        random_trees: number of random trees, >= 0.
        timeout: of an episode in seconds; 0: none.

    Returns:
        The result. If no episode runs, the other promises are not checked.
    """
    try:
        survey = Survey(make(), timeout)
        _run_trees(survey, trees, random_trees)
    except (Exception, SystemExit) as error:  # any exception of a domain is a fault
        return Check({str(Promise.RUNS): fault_text(error)}, None)
    found: dict[str, str] = {}
    if survey.crashes:
        found[Promise.RUNS] = "\n".join(list(survey.crashes.values())[:MAX_FAULTS])
    copies: dict[Promise, Callable[[], Domain]] = {
        Promise.REPEATS: make,
        Promise.PICKLES: lambda: pickle.loads(pickle.dumps(make())),
    }
    for promise, copy in copies.items() if survey.runs else ():
        try:
            if fault := _other_outcome(survey, copy()):
                found[promise] = fault
        except (Exception, SystemExit) as error:
            found[promise] = fault_text(error)
    for run in survey.runs:
        for promise, fault in (*_of_outcomes(survey, run), *run.faults.items()):
            found.setdefault(promise, fault)
    return Check({str(promise): found[promise] for promise in Promise if promise in found}, survey)


def known_trees(domain: Domain, library: str | None, default: str) -> tuple[list[Node], list[str]]:
    """The trees of .bt files for a domain, and a line for each file that cannot be read.

    The files are next to the domain's module, in its folder `trees`, in the library's folder, and
    in the examples.

    Args:
        domain: of the trees.
        library: folder of the library; None: there is none.
        default: the domain of a file that names none.

    Returns:
        The trees, and the first lines of the errors of files that are no trees of the domain.
    """
    beside = Path(getfile(type(domain))).parent
    folders = [beside, beside / "trees", resource("grammar") / "examples"]
    folders += [] if library is None else [library_folder(library, domain)]
    trees, left_out, vocabulary = [], [], domain.schema.vocabulary
    for file in dict.fromkeys(f for folder in folders for f in sorted(folder.glob("*.bt"))):
        try:
            text = read_text_file(file)
            if (domain_of(text) or default) == vocabulary.domain:
                trees.append(parse(text, vocabulary, name=str(file), folder=file.parent))
        except IslandError as error:
            left_out.append(str(error).splitlines()[0])
    return trees, left_out


def _run_trees(survey: Survey, trees: Iterable[str | Node], number: int) -> None:
    """Runs all trees until one exceeds the time limit, as others would take as long."""
    vocabulary = survey.domain.schema.vocabulary
    own = [parse(tree, vocabulary) if isinstance(tree, str) else tree for tree in trees]
    leaves = [leaf(name) for name in vocabulary.actions]
    pairs = [sequence(*pair) for pair in pairwise((leaves[-1], *leaves))]
    paper = yaml.safe_load(resource("conf/gp/paper.yaml").read_bytes())["trees"]
    settings = TreeSettings.model_validate({**paper, "depth": (2, 4)})
    space = TreeSpace(settings, vocabulary, Limits(max_depth=5, max_nodes=30))
    tried = Node("force_success", (), (Node("random_selector", (), (*leaves,)),))
    at_random = Node("until_failure", (), (tried,))  # any action, in each tick that runs none
    drawn = (random_tree(np.random.default_rng(slot), space) for slot in range(number))
    try:
        for tree in (*leaves, *own, *pairs, *drawn, at_random):
            survey.run(tree)
    except TimeLimitError:
        pass  # the survey has kept it


class _Ticks(Record):
    """A record of the blackboard in each tick, with the things that move."""

    def __init__(self, tree: Node, schema: Schema) -> None:
        super().__init__(tree, schema, SEEDS[:1])
        self.seen: list[Hashable] = []

    def tick(self, board: Sequence[float], scene: Any) -> None:
        self.seen.append((tuple(board), getattr(scene, "movers", ())))


def _seem_shared(survey: Survey) -> Iterator[str]:
    actions = survey.domain.schema.vocabulary.actions
    acting = [name for name, action in actions.items() if not action.condition]

    def ticks(*names: str) -> list[Hashable]:
        """What happens with actions at once, behind those that come before them."""
        before = [other for other in actions if any(other in actions[n].after for n in names)]
        at_once = Node("parallel", ParallelArgs("all", "all"), tuple(map(leaf, names)))
        tree = sequence(*map(leaf, before), at_once)
        record = _Ticks(tree, survey.domain.schema)
        with suppress(Exception, SystemExit):  # what was seen before is compared
            survey.episode(tree, record.seeds[0], observer=record)
        return record.seen

    for one, other in combinations_with_replacement(acting, 2):
        if {*actions[one].uses} & {*actions[other].uses}:
            continue
        instead = (one,) if one == other else (other, one)
        if ticks(one, other) != ticks(*instead):
            yield f"{one} with itself" if one == other else f"{one} and {other}"


def _other_outcome(survey: Survey, domain: Domain) -> str:
    """A line for the first episode that has another outcome in an equal domain, or ""."""
    for run in reversed(survey.runs):
        for seed, before in zip(reversed(run.seeds), reversed(run.plain), strict=True):
            if before != survey.episode(run.tree, seed, domain=domain):
                line = tree_line(run.tree)
                return f"Expected equal outcomes of equal episodes, found others of {line}"
    return ""


def _of_outcomes(survey: Survey, run: Record) -> Iterator[tuple[Promise, str]]:
    """The promises that a tree's outcomes break, each with a line."""
    schema = survey.domain.schema
    for o in run.plain:
        for kind in ("components", "counters"):
            names, declared = ([*getattr(each, kind)] for each in (o, schema))
            if names != declared:
                yield Promise.OUTCOMES, f"Expected the {kind} {declared}, found {names}"
        if not all(map(isfinite, (*o.components.values(), *o.counters.values(), o.seconds))):
            yield Promise.OUTCOMES, f"Expected finite numbers, found {o}."
        if not o.seconds > 0:
            yield Promise.OUTCOMES, f"Expected an episode to take time, found {o.seconds:g} s."
        if len(o.endings) != 1 or not o.endings[0]:
            line = f"Expected one word for why the episode ended, found {o.endings!r}."
            yield Promise.OUTCOMES, line
    ones = dict.fromkeys(schema.components, 1.0)
    if run.plain[0] != survey.episode(run.tree, run.seeds[0], ones):
        yield Promise.WEIGHTS, "Expected weights of 1 to change nothing."
    if run.watched != run.plain[0]:
        line = f"Expected the same outcome when observed, found another of {tree_line(run.tree)}"
        yield Promise.OBSERVED, line
    if not run.ticks:
        yield Promise.RANGES, "Expected `observer.tick` to be called for each tick."
    for name, points in run.watched.components.items():
        if not isclose(run.points[name], points, rel_tol=1e-9, abs_tol=1e-6):
            line = f"Expected credits of {points} for {name}, found {run.points[name]}."
            yield Promise.CREDITS, line
    for name in sorted(schema.counters.keys() & schema.events.keys() & run.credited.keys()):
        expected, counted = run.credited[name], run.watched.counters[name]
        if counted != expected:
            yield Promise.COUNTERS, f"Expected {expected} as the counter {name}, found {counted}."
