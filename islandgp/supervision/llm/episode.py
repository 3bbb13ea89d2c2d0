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
from islandgp.bt.core.node import AGAIN, RUNNING, Node, walk
from islandgp.domain import Domain, Outcome, Scene, Schema
from islandgp.gp.record import IndividualRecord
from islandgp.supervision.base import GenerationView, RunContext
from islandgp.supervision.llm.prompts import about
from islandgp.text import in_points

SPANS: Final = 8  # most spans of an episode, one line each
BINS: Final = 60  # intervals of an episode from which spans are formed
MAX_NAMED: Final = 3  # most actions and events named in a span
KEYS: Final = 12  # most keys that are described
TREE: Final = 1500  # most characters of a tree
PARTS: Final = 3  # most components of a class's earnings
LINE: Final = 240  # most characters of a line


class EpisodeLog:
    """An observer that records the data of the description."""

    def __init__(self, tree: Node) -> None:
        self.actions = [n.action for n in walk(tree)]
        self.doing: list[str] = []  # by tick: the action that ran, else the last that ended, or ""
        self.boards: list[tuple[float, ...]] = []  # by tick
        self.credits: list[tuple[int, str, float]] = []  # tick, event, points
        self._ran = self._ended = ""

    def node(self, place: int, status: int) -> None:
        """See `Observer`."""
        if not (action := self.actions[place]) or status == ABORTED:
            return
        if status in (RUNNING, AGAIN):
            self._ran = action
        else:
            self._ended = action

    def tick(self, board: Sequence[float], scene: Scene | None) -> None:  # noqa: ARG002 -- the protocol's
        """See `Observer`."""
        self.doing.append(self._ran or self._ended)
        self.boards.append(tuple(map(float, board)))
        self._ran = self._ended = ""

    def credit(self, component: str, points: float, event: str, action: str) -> None:  # noqa: ARG002 -- the protocol's
        """See `Observer`."""
        self.credits.append((len(self.doing), event, points))


@dataclass(frozen=True, slots=True)
class Stretch:
    """A part of an episode with similar actions."""

    begin: int  # first tick
    end: int  # first tick after it
    actions: Counter[str]  # ticks by action

    def __add__(self, other: Stretch) -> Stretch:
        return Stretch(self.begin, other.end, self.actions + other.actions)

    def apart(self, other: Stretch) -> float:
        """Loss of information if two spans are merged; 0 if their shares of actions are equal."""
        n, m = self.end - self.begin, other.end - other.begin
        names = self.actions | other.actions
        differ = sum(abs(self.actions[name] / n - other.actions[name] / m) for name in names)
        return differ * n * m / (n + m)


def describe_episode(
    domain: Domain, tree: Node, seed: int, weights: Mapping[str, float]
) -> tuple[Outcome, list[str]]:
    """An episode's outcome and its description: at most SPANS + KEYS + 2 lines of LINE characters.

    It runs one episode, which is a function of the arguments.
    """
    log = EpisodeLog(tree)
    outcome = domain.run_episode(tree, seed, weights, log)
    lines = [*_course(log, domain.step_s), *_never(log), *_keys(log, domain)]
    return outcome, [line if len(line) <= LINE else line[: LINE - 3] + "..." for line in lines]


def spans(actions: Sequence[str]) -> list[Stretch]:
    """An episode's ticks in at most SPANS parts, cut where the actions change most."""
    bins = min(BINS, len(actions))
    edges = [i * len(actions) // bins for i in range(bins + 1)] if bins else []
    stretches = [Stretch(a, b, Counter(actions[a:b])) for a, b in pairwise(edges)]
    while len(stretches) > 1:
        lost, i = min((a.apart(b), i) for i, (a, b) in enumerate(pairwise(stretches)))
        if len(stretches) <= SPANS and lost > 0:
            break
        stretches[i : i + 2] = [stretches[i] + stretches[i + 1]]
    return stretches


def _course(log: EpisodeLog, step_s: float) -> Iterator[str]:
    last = len(log.doing) - 1
    for span in spans(log.doing):
        length = span.end - span.begin
        counts = ", ".join(
            f"{name or 'nothing'} {count / length:.0%}"
            for name, count in span.actions.most_common(MAX_NAMED)
        )
        inside = [
            (event, points)
            for tick, event, points in log.credits
            if span.begin <= min(tick, last) < span.end
        ]
        times = Counter(event for event, _ in inside)
        earned = "".join(f", {event} {n}x" for event, n in times.most_common(MAX_NAMED))
        gain = sum(points for _, points in inside)
        tail = f"; {earned[2:]}: {in_points(gain, '+')} points" if inside else ""
        yield f"- {span.begin * step_s:.0f} to {span.end * step_s:.0f} s: {counts}{tail}"


def _never(log: EpisodeLog) -> Iterator[str]:
    done = set(log.doing)
    unused = dict.fromkeys(name for name in log.actions if name and name not in done)
    if unused:
        yield f"- hardly or never done, though in the tree: {', '.join(unused)}"


def _keys(log: EpisodeLog, domain: Domain) -> Iterator[str]:
    schema: Schema = domain.schema
    if not log.boards:
        return
    for place, (name, key) in enumerate(list(schema.vocabulary.keys.items())[:KEYS]):
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
        step_s = domain.step_s
        if low == high:
            yield f"- {name}: {_number(low)} throughout"
            continue
        yield (
            f"- {name}: {_number(points[0][0])} at first, {_number(points[-1][0])} at the end;"
            f" least {_number(low)} at {trough * step_s:.0f} s, most {_number(high)} at"
            f" {peak * step_s:.0f} s"
        )


def _number(value: float) -> str:
    return f"{round(value, 1) + 0.0:g}"


def trace_of(name: str, i: IndividualRecord, context: RunContext, now: GenerationView) -> str:
    """A description of an individual's episode in the first world of its evaluation."""
    # Worlds of an individual; 0 if all individuals share fewer worlds than there are individuals.
    worlds_each = len(now.worlds) // len(now.individuals)
    seed = now.worlds[now.individuals.index(i) * worlds_each]
    tree = parse(i.tree, context.schema.vocabulary)
    domain = context.domain_in(now.snapshot.generation)
    outcome, lines = describe_episode(domain, tree, seed, now.multipliers)
    n, world = context.gp.episodes, about(domain, seed)
    mean = f" on the mean of {n} episodes" if n > 1 else ""
    which = (
        f"the first of them, with {in_points(outcome.fitness)} points," if n > 1 else "an episode"
    )
    head = (
        f"{name}, of class {i.specialist}, {in_points(i.fitness)} points{mean}"
        f" ({components([i])}). In {which} of {in_points(outcome.seconds)} s that ended with"
        f" {', '.join(outcome.endings)} it did:"
    )
    if world:
        head = f"{head}\n{world}"
    return "\n".join((head, *lines, "```", shortened(i.tree), "```"))


def components(members: Sequence[IndividualRecord]) -> str:
    """The largest components of some individuals' points."""
    means = {c: fmean(i.components[c] for i in members) for c in members[0].components}
    largest = sorted(means, key=lambda c: -abs(means[c]))[:PARTS]
    return ", ".join(f"{c} {in_points(means[c], '+')}" for c in largest if means[c]) or "nothing"


def shortened(tree: str) -> str:
    """A tree's text, of TREE characters at most."""
    text = tree.strip()
    return text if len(text) <= TREE else text[: TREE - 3] + "..."
