"""The sections of prompts on the run so far: classes, injected trees, decisions, traces, edits.

Their texts are in `prompts/history.jinja`. They depend on the configuration, the domain and the
records of generations only, so a resumed run and a replay have the same. Their size is limited, and
no tree is shown twice in a prompt.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from math import isfinite
from statistics import fmean
from typing import Any, Final

from islandgp.bt.core.engine import ABORTED
from islandgp.bt.core.language import parse, to_text
from islandgp.bt.core.node import AGAIN, FAILURE, RUNNING, SUCCESS, Node, walk
from islandgp.domain import Domain, Observer, Outcome, Scene
from islandgp.gp.edits import EditRecord, EditTrial, nodes_with_paths, path_text
from islandgp.gp.population import Origin
from islandgp.gp.record import IndividualRecord
from islandgp.scoring.classes import Classes
from islandgp.scoring.constraints import merit, violation
from islandgp.scoring.explain import explained_in_text
from islandgp.scoring.state import PopulationState
from islandgp.supervision.base import GenerationView, RunContext
from islandgp.supervision.llm.prompts import about, environment
from islandgp.text import in_points

ROWS: Final = 40  # most classes, and most learned sentences, in a prompt
KEPT: Final = 5  # most injected trees and decisions in a prompt
MAX_PAST_EDITS: Final = 8  # most earlier edits in a prompt
NEIGHBOURS: Final = 3  # most individuals in a prompt besides the parents
LINES: Final = 60  # most nodes of a listed tree

SPANS: Final = 8  # parts of an episode, one line each
MAX_NAMED: Final = 4  # most actions and events named in a span
KEYS: Final = 12  # most keys that are described
PARTS: Final = 3  # most components of a class's earnings

RUN_VALUES: Final = ("earnings", "injected", "traces", "decisions", "learned")
EDIT_VALUES: Final = ("parents", "neighbours", "past_edits")
"""Variables of prompts that differ between generations."""
OF_STATE: Final = ("urgency", "progress")
"""Those that need the population's state only."""


@dataclass(frozen=True, slots=True)
class InjectedTree:
    """An injected tree with its descendants."""

    generation: int  # of its first evaluation
    target: str  # its purpose
    new: IndividualRecord  # at its first evaluation, possibly mutated
    rank: int  # by fitness in that generation, from 1
    family: frozenset[str]  # ids of all descendants so far; a search can keep some aside
    last: int  # last generation with any


def injected_trees(history: Sequence[GenerationView]) -> list[InjectedTree]:
    """The KEPT trees of a run that were injected last, the oldest first."""
    trees: list[InjectedTree] = []
    for k, view in enumerate(history):
        if view.guidance is None or not view.guidance.injected:
            continue
        for new in (i for i in view.individuals if i.origin == Origin.INJECTED):
            family, last = {new.id}, view
            for later in history[k + 1 :]:
                alive = {i.id for i in later.individuals if not family.isdisjoint(i.parents)}
                family, last = family | alive, later if alive else last
            born, target = view.snapshot.generation, view.guidance.target or ""
            rank, end = best_rank([new], view.individuals), last.snapshot.generation
            trees.append(InjectedTree(born, target, new, rank, frozenset(family), end))
    return trees[-KEPT:]


def past_edits(
    history: Sequence[GenerationView],
) -> list[tuple[int, EditRecord, EditTrial | None]]:
    """The last edits of a run, the oldest first.

    Each has the generation in which it was or would have been evaluated, and its comparison with
    the tree before; None: refused, or not evaluated.
    """
    return [
        (view.snapshot.generation, e, None if e.refused else next(trials, None))
        for view in history
        if view.guidance is not None
        for trials in [iter(view.trials)]
        for e in view.guidance.edits
    ][-MAX_PAST_EDITS:]


def ranked(individuals: Sequence[IndividualRecord]) -> list[IndividualRecord]:
    """The individuals by fitness, best first; equal ones in slot order."""
    return sorted(individuals, key=lambda i: -i.fitness)


def best_rank(some: Sequence[IndividualRecord], population: Sequence[IndividualRecord]) -> int:
    """The rank by fitness, from 1, of the fittest of some individuals of a population."""
    order = [i.id for i in ranked(population)]
    return 1 + min(order.index(i.id) for i in some)


def sections(
    context: RunContext,
    history: Sequence[GenerationView],
    state: PopulationState,
    names: Collection[str],
    *,
    rare: float,
    count: int,
    evidence: GenerationView | None = None,
    traced: bool = True,
) -> tuple[dict[str, str], int]:
    """The sections of a prompt by their variables, and the episodes simulated for them.

    Args:
        context: of the run.
        history: the run's generations so far; the last one has the trees to edit.
        state: of the population.
        names: of the sections to be written; others are "".
        rare: share of the population below which a behaviour is rare.
        count: most trees to edit.
        evidence: whose points and traces are shown; None: the last generation.
        traced: True: with a trace of each tree to edit.
    """
    values: dict[str, Any] = {"run": context, "state": state, "rare": rare, "names": OF_STATE}
    episodes = None
    if history:
        now, view, classes = history[-1], evidence or history[-1], context.classes
        episodes, members = EpisodeTexts(context, view), view.individuals
        groups = {n: [i for i in members if i.specialist == n] for n in classes.specialist_names}
        for name in classes.tiers:
            groups[f"{classes.tier_title(name)}s"] = [i for i in members if name in i.tiers]
        parents = parents_of(now, context, count)
        own = {i.tree for i in parents}
        values |= {
            "names": {*names, *OF_STATE},
            "view": view,
            "injected_trees": injected_trees(history),
            "changes": [(b.guidance, a.snapshot, b.snapshot) for a, b in pairwise(history)][-KEPT:],
            "all_edits": past_edits(history),
            "groups": dict([*groups.items()][:ROWS]),
            "learned_lines": view.learned[:ROWS],
            "best": ranked(members)[0],
            "worst": most_lacking(members, classes),
            "parents_to_edit": [*zip(parents, parents_of(view, context, count), strict=False)],
            "others": parents_of(now, context, count + NEIGHBOURS)[len(parents) :],
            "elites": [*{e.tree: e for e in now.archive if e.tree not in own}.values()],
            "most_neighbours": NEIGHBOURS,
            "traced": traced,
            "episodes": episodes,
            "listing": lambda tree: listing(parse(tree, context.schema.vocabulary)),
            "best_rank": best_rank,
            "components": components,
            "mean": fmean,
        }
    module = environment().get_template("history.jinja").make_module(values)
    every = (*OF_STATE, *RUN_VALUES, *EDIT_VALUES)
    return {n: str(getattr(module, n)) for n in every}, episodes.number if episodes else 0


def most_lacking(individuals: Sequence[IndividualRecord], classes: Classes) -> IndividualRecord:
    """The individual with the fewest behaviours; of several the least fit one."""
    return min(
        ranked(individuals)[::-1], key=lambda i: (len(classes.behaviours_of(i.counters)), i.fitness)
    )


def parents_of(view: GenerationView, context: RunContext, count: int) -> list[IndividualRecord]:
    """The individuals to improve: the fittest, then the best of other classes; distinct trees."""

    def worth(i: IndividualRecord) -> tuple[float, float]:
        return merit(i.fitness, violation(i.counters, context.constraints))

    order = sorted(view.individuals, key=worth, reverse=True)
    classes: dict[str, IndividualRecord] = {}
    for i in order:
        classes.setdefault(i.specialist, i)
    first = [*classes.values(), *order]
    return list({i.tree: i for i in reversed(first)}.values())[::-1][:count]


def paths_of(tree: str, context: RunContext) -> list[str]:
    """The places of a tree that are listed."""
    nodes = nodes_with_paths(parse(tree, context.schema.vocabulary))
    return [path_text(path) for path, _ in list(nodes)[:LINES]]


def listing(tree: Node) -> list[str]:
    """One line per node of a tree without its children, with its path: `0/2 action Charge`."""
    return [
        f'  at "{path_text(path)}": {to_text(node).split("{", 1)[0].strip()}'
        for path, node in list(nodes_with_paths(tree))[:LINES]
    ]


class EpisodeLog:
    """An observer that records the data of the description."""

    def __init__(self, tree: Node) -> None:
        self.names = [n.action for n in walk(tree)]
        self.actions = list(dict.fromkeys(filter(None, self.names)))
        self.statuses: list[tuple[int, str, int]] = []  # tick, action, status
        self.boards: list[tuple[float, ...]] = []  # by tick
        self.credits: list[tuple[int, str, float]] = []  # tick, event, points

    def node(self, place: int, status: int) -> None:
        """See `Observer`."""
        if (action := self.names[place]) and status != ABORTED:
            self.statuses.append((len(self.boards), action, status))

    def tick(self, board: Sequence[float], scene: Scene | None) -> None:  # noqa: ARG002 -- the protocol's
        """See `Observer`."""
        self.boards.append(tuple(map(float, board)))

    def credit(self, component: str, points: float, event: str, action: str) -> None:  # noqa: ARG002 -- the protocol's
        """See `Observer`."""
        self.credits.append((len(self.boards), event, points))


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
    ticks = len(log.boards)
    did = {(tick, name) for tick, name, s in log.statuses if s in (RUNNING, AGAIN, SUCCESS)}
    for begin, end in pairwise(sorted({ticks * k // SPANS for k in range(SPANS + 1)})):
        active = Counter(name for tick, name in sorted(did) if begin <= tick < end)
        shares = ", ".join(
            f"{name} {f'{n / (end - begin):.0%}' if n * 100 >= end - begin else f'{n} ticks'}"
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
    succeeded = Counter(name for _, name, s in log.statuses if s == SUCCESS)
    failed = Counter(name for _, name, s in log.statuses if s == FAILURE)
    going = (RUNNING, AGAIN)
    running = {n for tick, n, s in log.statuses if s in going and tick == len(log.boards) - 1}
    running -= succeeded.keys()
    started = {name for _, name, _ in log.statuses}
    none = Counter[str]()
    for what, names, counts in (
        ("succeeded", succeeded.keys(), succeeded),
        ("running at the end, without a success before", running, none),
        ("failed and never succeeded", failed.keys() - succeeded.keys() - running, failed),
        ("never started", set(log.actions) - started, none),
    ):
        texts = [n + (f" {counts[n]}x" if n in counts else "") for n in log.actions if n in names]
        if texts:
            yield f"- {what}: {', '.join(texts)}"


def _keys(log: EpisodeLog, domain: Domain) -> Iterator[str]:
    """The values of the first KEYS keys over the episode."""
    keys = list(domain.schema.vocabulary.keys.items())[:KEYS]
    for (name, key), values in zip(keys, zip(*log.boards, strict=True), strict=False):
        points = [(v, tick) for tick, v in enumerate(values) if isfinite(v)]
        if key.flag:
            yield f"- {name}: yes in {sum(v != 0 for v in values) / len(values):.0%} of the time"
        elif key.words:
            counts = Counter(map(key.text_of, values)).most_common()
            shares = ", ".join(f"{value} {n / len(values):.0%}" for value, n in counts)
            yield f"- {name}: {shares} of the time"
        elif points and min(points)[0] == max(points)[0]:
            yield f"- {name}: {in_points(points[0][0])} throughout"
        elif points:
            low, trough = min(points)
            high, peak = max(points, key=lambda pair: (pair[0], -pair[1]))
            yield (
                f"- {name}: {in_points(points[0][0])} at first, {in_points(points[-1][0])} at the"
                f" end; least {in_points(low)} at {in_points(trough * domain.step_s)} s,"
                f" most {in_points(high)} at {in_points(peak * domain.step_s)} s"
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

    def described(self, i: IndividualRecord) -> tuple[Outcome, str, list[str]]:
        """The outcome of an individual's episode, its world in words, and its course in lines."""
        domain, seed = self._world(i)
        tree = parse(i.tree, self.context.schema.vocabulary)
        outcome, lines = describe_episode(domain, tree, seed, self.view.multipliers)
        self.number += 1
        return outcome, about(domain, seed), lines

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
