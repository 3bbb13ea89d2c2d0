"""Checks a domain against the interface of `islandgp.domain`.

    from islandgp.testing import check_domain

    def test_the_domain() -> None:
        assert check_domain(lambda: Maze.make(World(...), RewardTable(...))).faults == {}

`islandgp domain NAME --check` does the same from the command line.
"""

from __future__ import annotations

import pickle
from collections.abc import Callable, Hashable, Iterable, Iterator
from dataclasses import dataclass
from heapq import heappop, heappush
from itertools import combinations_with_replacement, count, islice, pairwise
from math import isclose, isfinite
from textwrap import indent
from typing import Final

import numpy as np
import yaml

from islandgp.bt.core.language import parse
from islandgp.bt.core.node import STATUS_NAMES, Limits, Node, ParallelArgs, leaf, sequence
from islandgp.domain import Domain
from islandgp.errors import TimeLimitError
from islandgp.gp.random_trees import TreeSettings, TreeSpace, random_tree
from islandgp.resources import resource
from islandgp.testing.survey import (
    SEEDS,
    FrameChecker,
    Survey,
    TickObserver,
    fault_text,
    tree_line,
    unreached,
)

MAX_FAULTS: Final = 10  # failed episodes that are reported


@dataclass(frozen=True, slots=True)
class Check:
    """The result of `check_domain`."""

    faults: dict[str, str]  # by promise that is broken
    survey: Survey | None  # the episodes; None: the domain could not be made

    @property
    def trees_run(self) -> int:
        """Number of trees whose episodes raised no exception."""
        return len(self.survey.runs) if self.survey else 0

    def unreached(self) -> list[str]:
        """A line for the events, actions and keys of the schema that no tree has reached."""
        return list(unreached(self.survey)) if self.survey else []

    def shared(self) -> list[str]:
        """A line for actions that seem to share a resource that they do not declare.

        Two actions do if their order in a parallel changes an episode, and an action does with
        itself if two of it at once do not do the same as one.
        """
        return list(_shared(self.survey)) if self.survey else []

    def lines(self) -> Iterator[str]:
        """A report: each promise, what no tree has reached, and resources that seem shared."""
        for promise in PROMISES if self.trees_run else self.faults:
            fault = self.faults.get(promise, "")
            yield f"{'FAILED' if fault else 'ok':<6}  {promise}"
            if fault:
                yield indent(fault, " " * 8)
        if not self.trees_run:
            yield "The other promises are checked as soon as the episode of a tree runs."
            return
        if unreached_lines := self.unreached():
            yield f"\nNot reached by any of {self.trees_run} trees (no failure without --strict):"
            yield from (f"  {line}" for line in unreached_lines)
            yield "A tree that reaches them can be added: islandgp domain NAME --check TREE.bt"
        if shared := self.shared():
            yield "\nActions that seem to share a resource; declare it as their `uses` if they do:"
            yield from (f"  {line}" for line in shared)


def check_domain(
    make: Callable[[], Domain],
    *,
    trees: Iterable[str | Node] = (),
    random_trees: int = 20,
    grown_trees: int = 60,
    more_episodes: int = 30,
    timeout: float = 30.0,
) -> Check:
    """Runs trees in a domain and checks the promises of the interface.

    Args:
        make: makes a new but equal instance at each call.
        trees: that reach events, as texts or nodes; they run besides each action and random trees.
        random_trees: number of random trees, >= 0.
        grown_trees: sequences of actions, extended while they reach something new, at most.
        more_episodes: of `trees` in further worlds until everything is reached, at most.
        timeout: of an episode in seconds; 0: none.

    Returns:
        The result. If no episode runs, the other promises are not checked.
    """
    first = next(iter(PROMISES))
    try:
        survey = Survey(make(), make, timeout)
        _run_trees(survey, trees, random_trees, grown_trees, more_episodes)
    except (Exception, SystemExit) as error:  # any exception of a domain is a fault
        return Check({first: fault_text(error)}, None)
    faults = {}
    for promise, look in PROMISES.items():
        try:
            fault = next(look(survey), "")
        except (Exception, SystemExit) as error:
            fault = fault_text(error)
        if fault:
            faults[promise] = fault
        if not survey.runs:
            break
    return Check(faults, survey)


def _run_trees(
    survey: Survey, trees: Iterable[str | Node], number: int, grown: int, more: int
) -> None:
    """Runs all trees until one exceeds the time limit, as others would take as long."""
    vocabulary = survey.domain.schema.vocabulary
    own = [parse(tree, vocabulary) if isinstance(tree, str) else tree for tree in trees]
    leaves = [leaf(name) for name in vocabulary.actions]
    pairs = [sequence(*pair) for pair in pairwise((leaves[-1], *leaves))]
    paper = yaml.safe_load(resource("conf/gp/paper.yaml").read_bytes())["trees"]
    settings = TreeSettings.model_validate({**paper, "depth": (2, 4)})
    space = TreeSpace(settings, vocabulary, Limits(max_depth=5, max_nodes=30))
    drawn = (random_tree(np.random.default_rng(slot), space) for slot in range(number))
    try:
        for tree in (*own, *leaves, *pairs, *drawn):
            survey.look(tree)
        _grow(survey, leaves, grown)
        running = [run.tree for run in survey.runs if run.tree in own]
        for n in range(more if running else 0):
            if not any(unreached(survey)):
                return
            survey.visit(running[n % len(running)], SEEDS[0] + 1 + n // len(running))
    except TimeLimitError:
        pass  # the survey has kept it


def _grow(survey: Survey, actions: list[Node], remaining: int) -> None:
    """Runs sequences of actions and extends those that reached something new."""
    reached: set[Hashable] = set()
    number = count()
    waiting: list[tuple[int, int, int, tuple[Node, ...]]] = [(0, 0, next(number), ())]
    while waiting:
        *_, chain = heappop(waiting)
        for action in actions:
            if not remaining:
                return
            remaining -= 1
            longer = (*chain, action)
            if (run := survey.look(sequence(*longer))) is None:
                continue
            firsts, states = run.recorder.firsts() - reached, run.recorder.states - reached
            reached |= firsts | states
            if firsts or states:
                # Those with something that no sequence had shown come first, then the longest.
                heappush(waiting, (0 if firsts else 1, -len(longer), next(number), longer))


def _shared(survey: Survey) -> Iterator[str]:
    actions = survey.domain.schema.vocabulary.actions
    acting = [name for name, action in actions.items() if not action.condition]

    def ticks(tree: Node) -> list[Hashable]:
        observed = TickObserver()
        try:
            survey.run(tree, SEEDS[0], {}, observed)
        except (Exception, SystemExit):  # it is among the faults
            return []
        return observed.ticks

    for one, other in combinations_with_replacement(acting, 2):
        if {*actions[one].uses} & {*actions[other].uses}:
            continue
        first, second = leaf(one), leaf(other)
        both = Node("parallel", ParallelArgs("all", "all"), (first, second))
        swapped = first if one == other else both._replace(children=(second, first))
        before = dict.fromkeys((*actions[one].after, *actions[other].after))
        prepared = [leaf(name) for name in before]
        if ticks(sequence(*prepared, both)) != ticks(sequence(*prepared, swapped)):
            yield f"{one} with itself" if one == other else f"{one} and {other}"


def _every_episode_runs(survey: Survey) -> Iterator[str]:
    faults = [
        f"{fault.text} (world seed {fault.seed}, tree {tree_line(fault.tree)})"
        for fault in survey.faults.values()
    ]
    if faults:
        yield "\n".join(faults[:MAX_FAULTS])


def _equal_episodes(survey: Survey) -> Iterator[str]:
    other = survey.make()
    for run in reversed(survey.runs):
        for seed, before in zip(reversed(SEEDS), reversed(run.plain), strict=True):
            if before != survey.run(run.tree, seed, domain=other):
                yield (
                    "Expected equal outcomes of equal episodes, found others of"
                    f" {tree_line(run.tree)}"
                )


def _sent_to_workers(survey: Survey) -> Iterator[str]:
    copy: Domain = pickle.loads(pickle.dumps(survey.make()))
    for run in islice(survey.runs, 10):
        if run.plain[0] != survey.run(run.tree, SEEDS[0], domain=copy):
            yield f"Expected an equal outcome after pickling, not so: {tree_line(run.tree)}"


def _declared_outcomes(survey: Survey) -> Iterator[str]:
    schema = survey.domain.schema
    for o in (outcome for run in survey.runs for outcome in run.plain):
        for kind, found, declared in (
            ("components", o.components, schema.components),
            ("counters", o.counters, schema.counters),
        ):
            if list(found) != list(declared):
                yield (
                    f"Expected the {kind} {', '.join(declared)}, in this order, found"
                    f" {', '.join(found)}"
                )
        if not all(map(isfinite, (*o.components.values(), *o.counters.values(), o.seconds))):
            yield f"Expected finite numbers, found {o}."
        if not o.seconds > 0:
            yield f"Expected an episode to take time, found {o.seconds:g} s."
        if len(o.endings) != 1 or not o.endings[0]:
            yield f"Expected one word for why the episode ended, found {o.endings!r}."


def _weights_of_one(survey: Survey) -> Iterator[str]:
    ones = dict.fromkeys(survey.domain.schema.components, 1.0)
    for run in survey.runs:
        if run.plain[0] != survey.run(run.tree, SEEDS[0], ones):
            yield "Expected weights of 1 to change nothing."


def _observed_outcomes(survey: Survey) -> Iterator[str]:
    for run in survey.runs:
        if run.watched != run.plain[0]:
            yield f"Expected the same outcome when observed, found another of {tree_line(run.tree)}"


def _ranges(survey: Survey) -> Iterator[str]:
    for recorder in survey.recorders():
        if not recorder.ticks:
            yield "Expected `observer.tick` to be called for each tick."
        if recorder.wrong_board:
            yield recorder.wrong_board


def _declared_statuses(survey: Survey) -> Iterator[str]:
    actions = survey.domain.schema.vocabulary.actions
    for recorder in survey.recorders():
        for name, status in sorted(recorder.statuses):
            if status not in (declared := actions[name].statuses):
                names = ", ".join(STATUS_NAMES[each] for each in sorted(declared))
                yield f"Expected {name} to return {names}, found {STATUS_NAMES[status]}."


def _credits(survey: Survey) -> Iterator[str]:
    for run in survey.runs:
        if run.recorder.wrong_credit:
            yield run.recorder.wrong_credit
        for name, points in run.watched.components.items():
            credited = run.recorder.points[name]
            if not isclose(credited, points, rel_tol=1e-9, abs_tol=1e-6):
                yield f"Expected credits of {points} for {name}, found {credited}."


def _counted_events(survey: Survey) -> Iterator[str]:
    schema = survey.domain.schema
    for run in survey.runs:
        credited = run.recorder.credited
        for name in sorted(schema.counters.keys() & schema.events.keys() & credited.keys()):
            if (counted := run.watched.counters[name]) != credited[name]:
                yield f"Expected {credited[name]} as the counter {name}, found {counted}."


def _scenes(survey: Survey) -> Iterator[str]:
    for recorder in survey.recorders():
        if recorder.wrong_scene:
            yield recorder.wrong_scene
        if len(recorder.movers) > 1:
            yield f"Expected as many movers in each tick, found {sorted(recorder.movers)}"


def _frames(survey: Survey) -> Iterator[str]:
    for run in islice(survey.runs, 1):
        checker = FrameChecker(run.tree, survey.domain.schema)
        survey.run(run.tree, SEEDS[0], {}, checker)
        if checker.wrong_frame:
            yield checker.wrong_frame


PROMISES: Final[dict[str, Callable[[Survey], Iterator[str]]]] = {
    "every episode runs": _every_episode_runs,
    "an episode is a function of tree seed and weights": _equal_episodes,
    "it can be sent to workers": _sent_to_workers,
    "outcomes have what the schema declares": _declared_outcomes,
    "a component that is not named has the weight 1": _weights_of_one,
    "recording an episode keeps its outcome": _observed_outcomes,
    "keys stay in their ranges": _ranges,
    "actions return the statuses that they declare": _declared_statuses,
    "points of actions add up to the fitness": _credits,
    "counters named like an event count it": _counted_events,
    "scenes use the declared styles": _scenes,
    "frames are png images": _frames,
}
"""What a domain promises; each function yields a line for each place where it does not hold."""
