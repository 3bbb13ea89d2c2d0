"""Checks a domain against the interface of `islandgp.domain`.

    from islandgp.testing import check_domain

    def test_the_domain() -> None:
        assert check_domain(lambda: Maze.make(World(...), RewardTable(...))).faults == {}

`islandgp domain NAME --check` does the same from the command line.
"""

from __future__ import annotations

import pickle
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass, field
from inspect import getfile
from itertools import combinations_with_replacement, pairwise
from math import isclose, isfinite
from pathlib import Path
from textwrap import indent
from typing import Any, Final

import numpy as np
import yaml

from islandgp.bt.core.language import domain_of, parse
from islandgp.bt.core.node import SUCCESS, Limits, Node, ParallelArgs, leaf, sequence
from islandgp.domain import Domain, Observer, Outcome
from islandgp.errors import IslandError, TimeLimitError
from islandgp.gp.random_trees import TreeSettings, TreeSpace, random_tree
from islandgp.plugin import raised_in
from islandgp.resources import resource
from islandgp.supervision.library import library_folder
from islandgp.testing.episodes import SEEDS, Promise, Record, fault_text, tree_line
from islandgp.text_files import read_text_file
from islandgp.time_limit import time_limit

MAX_FAULTS: Final = 10  # failed episodes that are reported


@dataclass(slots=True)
class Check:
    """The episodes of trees in a domain, and the promises that it breaks."""

    timeout: float  # of an episode, s; 0: none
    domain: Any = None  # None: it could not be made
    faults: dict[str, str] = field(default_factory=dict)  # by promise that is broken
    runs: list[Record] = field(default_factory=list)  # of the trees that raised no exception
    crashes: dict[tuple[str, str], str] = field(default_factory=dict)
    """By type and place: a line on the first exception, with the seed of the world and the tree."""

    def lines(self) -> Iterator[str]:
        """A report: each promise, what no tree has reached, and resources that seem shared."""
        for promise in Promise if self.runs else self.faults:
            fault = self.faults.get(promise, "")
            yield f"{'FAILED' if fault else 'ok':<6}  {promise}"
            if fault:
                yield indent(fault, " " * 8)
        if not self.runs:
            yield "The other promises are checked as soon as the episode of a tree runs."
        if lacking := self.unreached():
            number = len({run.tree for run in self.runs})
            yield f"\nNot reached by any of {number} trees:"
            yield from (f"  {line}" for line in lacking)
            yield "A tree in a .bt file beside the domain's module is run as well."
        if shared := self.shared():
            yield "\nActions that seem to share a resource; declare it as their `uses` if they do:"
            yield from (f"  {line}" for line in shared)

    def unreached(self) -> list[str]:
        """A line for the events, actions, keys and counters that no tree has reached, by kind."""
        if not self.runs:
            return []
        schema, runs = self.domain.schema, self.runs
        outcomes = [outcome for run in runs for outcome in run.plain]
        counted = {n for n in schema.counters if any(o.counters.get(n) for o in outcomes)}
        seen = counted.union(*(run.events | run.credited.keys() for run in runs))
        paid: Any = getattr(getattr(self.domain, "rewards", None), "events", {})
        observable = schema.events if hasattr(self.domain, "Episode") else paid
        done = {name for run in runs for name, status in run.statuses if status == SUCCESS}
        able = [n for n, a in schema.vocabulary.actions.items() if SUCCESS in a.statuses]
        ends = {n: {v for run in runs for v in run.ends.get(n, ())} for n in schema.vocabulary.keys}
        found = {
            "events never logged": [n for n in schema.events if n in observable and n not in seen],
            "actions that never succeeded": [n for n in able if n not in done],
            "keys that never changed": [
                f"{n} (always {min(e):g})" for n, e in ends.items() if len(e) == 1
            ],
            "counters that stayed 0": [
                n for n in schema.counters if n not in counted and n not in schema.events
            ],
        }
        return [f"{kind}: {', '.join(names)}" for kind, names in found.items() if names]

    def shared(self) -> list[str]:
        """A line for actions that seem to share a resource that they do not declare.

        Two actions do if their order in a parallel changes an episode, and an action does with
        itself if two of it at once do not do the same as one. None if an episode failed.
        """
        if self.crashes or not self.runs:
            return []
        actions = self.domain.schema.vocabulary.actions
        acting = [name for name, action in actions.items() if not action.condition]
        return [
            f"{one} with itself" if one == other else f"{one} and {other}"
            for one, other in combinations_with_replacement(acting, 2)
            if not {*actions[one].uses} & {*actions[other].uses}
            and self._trace(one, other) != self._trace(*dict.fromkeys((other, one)))
        ]

    def _trace(self, *names: str) -> int:
        """The trace of actions at once, behind those that come before them."""
        actions = self.domain.schema.vocabulary.actions
        before = [other for other in actions if any(other in actions[n].after for n in names)]
        at_once = Node("parallel", ParallelArgs("all", "all"), tuple(map(leaf, names)))
        record = Record(sequence(*map(leaf, before), at_once), self.domain.schema)
        with suppress(Exception, SystemExit):  # what was seen before is compared
            self.episode(record.tree, SEEDS[0], observer=record)
        return record.trace

    def episode(
        self,
        tree: Node,
        seed: int,
        weights: Mapping[str, float] | None = None,
        observer: Observer | None = None,
        domain: Domain | None = None,
    ) -> Outcome:
        """Runs an episode within the time limit.

        Args:
            tree: with actions of the domain.
            seed: of the world.
            weights: by component; None: 1 for each.
            observer: of the episode.
            domain: another one; None: that of the check.

        Returns:
            The outcome.
        """
        domain = domain or self.domain
        domain.prepare()
        with time_limit(self.timeout):
            outcome = domain.run_episode(tree, seed, weights or {}, observer)
        assert isinstance(outcome, Outcome), f"Expected an Outcome, found {outcome!r:.80}"
        return outcome

    def run(self, tree: Node) -> None:
        """Runs a tree in the worlds of SEEDS.

        Args:
            tree: with actions of the domain.

        Raises:
            TimeLimitError: an episode took too long; it is kept as well.
        """
        record, at = Record(tree, self.domain.schema), SEEDS[0]
        try:
            record.watched = self.episode(tree, at, observer=record)
            for at in SEEDS:
                record.plain.append(self.episode(tree, at))
        except (Exception, SystemExit) as error:  # a simulator may call sys.exit
            key = type(error).__name__, raised_in(error) or fault_text(error)
            line = f"{fault_text(error)} (world seed {at}, tree {tree_line(tree)})"
            self.crashes.setdefault(key, line)
            if isinstance(error, TimeLimitError):
                raise
        else:
            self.runs.append(record)


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
    check = Check(timeout)
    try:
        check.domain = make()
        _run_trees(check, trees, random_trees)
    except (Exception, SystemExit) as error:  # any exception of a domain is a fault
        check.runs.clear()
        check.faults[Promise.RUNS] = fault_text(error)
        return check
    if check.crashes:
        check.faults[Promise.RUNS] = "\n".join([*check.crashes.values()][:MAX_FAULTS])
    copies: dict[Promise, Callable[[], Domain]] = {
        Promise.REPEATS: make,
        Promise.PICKLES: lambda: pickle.loads(pickle.dumps(make())),
    }
    for promise, copy in copies.items() if check.runs else ():
        try:
            if fault := _other_outcome(check, copy()):
                check.faults[promise] = fault
        except (Exception, SystemExit) as error:
            check.faults[promise] = fault_text(error)
    for run in check.runs:
        for promise, fault in (*_of_outcomes(check, run), *run.faults.items()):
            check.faults.setdefault(promise, fault)
    return check


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


def _run_trees(check: Check, trees: Iterable[str | Node], number: int) -> None:
    """Runs all trees until one exceeds the time limit, as others would take as long."""
    vocabulary = check.domain.schema.vocabulary
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
            check.run(tree)
    except TimeLimitError:
        pass  # it is among the crashes


def _other_outcome(check: Check, domain: Domain) -> str:
    """A line for the first episode that has another outcome in an equal domain, or ""."""
    for run in reversed(check.runs):
        for seed, before in zip(reversed(SEEDS), reversed(run.plain), strict=True):
            if before != check.episode(run.tree, seed, domain=domain):
                line = tree_line(run.tree)
                return f"Expected equal outcomes of equal episodes, found others of {line}"
    return ""


def _of_outcomes(check: Check, run: Record) -> Iterator[tuple[Promise, str]]:
    """The promises that a tree's outcomes break, each with a line."""
    schema = check.domain.schema
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
    if run.plain[0] != check.episode(run.tree, SEEDS[0], ones):
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
