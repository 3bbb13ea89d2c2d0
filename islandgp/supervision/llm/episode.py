"""Descriptions of a tree's episode for prompts."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from math import isfinite
from statistics import fmean
from typing import Final

from islandgp.bt.core.engine import ABORTED
from islandgp.bt.core.language import parse
from islandgp.bt.core.node import AGAIN, RUNNING, SUCCESS, Node, walk
from islandgp.domain import Domain, Observer, Outcome, Scene
from islandgp.gp.record import IndividualRecord
from islandgp.scoring.explain import explained_in_text
from islandgp.supervision.base import GenerationView, RunContext
from islandgp.supervision.llm.prompts import about
from islandgp.text import in_points

SPANS: Final = 8  # parts of an episode, one line each
MAX_NAMED: Final = 4  # most actions and events named in a span
KEYS: Final = 12  # most keys that are described
PARTS: Final = 3  # most components of a class's earnings


class EpisodeLog:
    """An observer that records the data of the description."""

    def __init__(self, tree: Node) -> None:
        self.actions = [n.action for n in walk(tree)]
        self.active: list[tuple[str, ...]] = []  # by tick: the actions that ran or succeeded
        self.boards: list[tuple[float, ...]] = []  # by tick
        self.credits: list[tuple[int, str, float]] = []  # tick, event, points
        self.succeeded: Counter[str] = Counter()  # by action
        self.failed: Counter[str] = Counter()
        self._now: set[str] = set()

    def node(self, place: int, status: int) -> None:
        """See `Observer`."""
        if not (action := self.actions[place]) or status == ABORTED:
            return
        if status in (RUNNING, AGAIN, SUCCESS):
            self._now.add(action)
        if status not in (RUNNING, AGAIN):
            (self.succeeded if status == SUCCESS else self.failed)[action] += 1

    def tick(self, board: Sequence[float], scene: Scene | None) -> None:  # noqa: ARG002 -- the protocol's
        """See `Observer`."""
        self.active.append(tuple(sorted(self._now)))  # a set has another order in each process
        self.boards.append(tuple(map(float, board)))
        self._now.clear()

    def credit(self, component: str, points: float, event: str, action: str) -> None:  # noqa: ARG002 -- the protocol's
        """See `Observer`."""
        self.credits.append((len(self.active), event, points))


def describe_episode(
    domain: Domain, tree: Node, seed: int, weights: Mapping[str, float]
) -> tuple[Outcome, list[str]]:
    """An episode's outcome and its description in at most SPANS + KEYS + 3 lines.

    It runs one episode, which is a function of the arguments.
    """
    log = EpisodeLog(tree)
    outcome = domain.run_episode(tree, seed, weights, log)
    return outcome, [*_course(log, domain.step_s), *_ends(log), *_keys(log, domain)]


def _course(log: EpisodeLog, step_s: float) -> Iterator[str]:
    """A line for each of SPANS equal parts of the episode."""
    ticks = len(log.active)
    for begin, end in pairwise(sorted({ticks * k // SPANS for k in range(SPANS + 1)})):
        length = end - begin
        active = Counter(name for names in log.active[begin:end] for name in names)
        shares = ", ".join(
            f"{name} {f'{n / length:.0%}' if n * 100 >= length else f'{n} ticks'}"
            for name, n in active.most_common(MAX_NAMED)
        )
        inside = [
            (e, points) for tick, e, points in log.credits if begin <= min(tick, ticks - 1) < end
        ]
        events = Counter(event for event, _ in inside)
        earned = ", ".join(f"{event} {n}x" for event, n in events.most_common(MAX_NAMED))
        gain = sum(points for _, points in inside)
        tail = f"; {earned}: {in_points(gain, '+')} points" if inside else ""
        times = f"{in_points(begin * step_s)} to {in_points(end * step_s)} s"
        yield f"- {times}: {shares or 'nothing'}{tail}"


def _ends(log: EpisodeLog) -> Iterator[str]:
    """How the actions of the tree ended; each of them is in one of the lines, or ran to the end."""
    names = dict.fromkeys(filter(None, log.actions))
    ran = {name for names in log.active for name in names}
    succeeded = [f"{name} {log.succeeded[name]}x" for name in names if log.succeeded[name]]
    failed = [f"{n} {log.failed[n]}x" for n in names if log.failed[n] and not log.succeeded[n]]
    unused = [name for name in names if name not in ran and not log.failed[name]]
    for what, parts in (
        ("succeeded", succeeded), ("failed and never succeeded", failed), ("never started", unused)
    ):  # fmt: skip
        if parts:
            yield f"- {what}: {', '.join(parts)}"


def _keys(log: EpisodeLog, domain: Domain) -> Iterator[str]:
    if not log.boards:
        return
    step_s = domain.step_s
    for place, (name, key) in enumerate(list(domain.schema.vocabulary.keys.items())[:KEYS]):
        values = [board[place] for board in log.boards]
        if key.flag:
            yield f"- {name}: yes in {sum(v != 0 for v in values) / len(values):.0%} of the time"
            continue
        if key.words:
            counts = Counter(map(key.text_of, values)).most_common()
            shares = ", ".join(f"{value} {n / len(values):.0%}" for value, n in counts)
            yield f"- {name}: {shares} of the time"
            continue
        points = [(v, tick) for tick, v in enumerate(values) if isfinite(v)]
        if not points:
            continue
        low, trough = min(points)
        high, peak = max(points, key=lambda pair: (pair[0], -pair[1]))
        if low == high:
            yield f"- {name}: {in_points(low)} throughout"
            continue
        yield (
            f"- {name}: {in_points(points[0][0])} at first, {in_points(points[-1][0])} at the end;"
            f" least {in_points(low)} at {in_points(trough * step_s)} s,"
            f" most {in_points(high)} at {in_points(peak * step_s)} s"
        )


@dataclass
class EpisodeTexts:
    """Describes episodes of individuals of a generation, in the first world of each evaluation."""

    context: RunContext
    view: GenerationView
    number: int = 0  # of episodes that were simulated

    def _world(self, i: IndividualRecord) -> tuple[Domain, int]:
        gp, view = self.context.gp, self.view
        place = 0 if gp.shared_seed else view.individuals.index(i) * gp.episodes
        return self.context.domain_in(view.snapshot.generation), view.worlds[place]

    def described(self, i: IndividualRecord) -> tuple[Outcome, list[str]]:
        """The outcome of an individual's episode, and its world and course in lines."""
        domain, seed = self._world(i)
        tree = parse(i.tree, self.context.schema.vocabulary)
        outcome, lines = describe_episode(domain, tree, seed, self.view.multipliers)
        self.number += 1
        return outcome, [*filter(None, (about(domain, seed), *lines))]

    def explained(self, i: IndividualRecord) -> str:
        """An individual's tree with what each branch did and is worth."""
        domain, first = self._world(i)

        def run(tree: Node, seed: int, observer: Observer | None) -> Outcome:
            return domain.run_episode(tree, seed, self.view.multipliers, observer)

        tree = parse(i.tree, self.context.schema.vocabulary)
        text, episodes = explained_in_text(run, tree, [first])
        self.number += episodes
        return text


def components(members: Sequence[IndividualRecord]) -> str:
    """The largest components of some individuals' points."""
    means = {c: fmean(i.components[c] for i in members) for c in members[0].components}
    largest = sorted(means, key=lambda c: -abs(means[c]))[:PARTS]
    return ", ".join(f"{c} {in_points(means[c], '+')}" for c in largest if means[c]) or "nothing"
