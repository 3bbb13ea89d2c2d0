"""The sections of prompts on the run so far: classes, injected trees, decisions, traces, edits.

Their texts are in `prompts/history.jinja`. They depend on the configuration, the domain and the
records of generations only, so a resumed run and a replay have the same. Their size is limited, and
no tree is shown twice in a prompt.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from math import isfinite
from statistics import fmean
from typing import Any, Final

from islandgp.bt.core.engine import ABORTED
from islandgp.bt.core.language import parse, to_text
from islandgp.bt.core.node import AGAIN, RUNNING, SUCCESS, Node, walk
from islandgp.domain import Domain, Observer, Outcome, Scene
from islandgp.gp.edits import EditRecord, EditTrial, nodes_with_paths, path_text
from islandgp.gp.population import Origin
from islandgp.gp.record import GuidanceRecord, IndividualRecord
from islandgp.scoring.classes import Classes
from islandgp.scoring.constraints import merit, violation
from islandgp.scoring.explain import explained_in_text
from islandgp.scoring.generation_stats import GenerationStats
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

    def followed_by(self, view: GenerationView) -> InjectedTree:
        """The tree with its descendants in the next generation."""
        alive = {i.id for i in view.individuals if not self.family.isdisjoint(i.parents)}
        last = view.snapshot.generation if alive else self.last
        return replace(self, family=self.family | alive, last=last)


@dataclass(frozen=True, slots=True)
class RunHistory:
    """The history of a run for prompts, the oldest first."""

    now: GenerationView | None = None  # the last generation
    injected: tuple[InjectedTree, ...] = ()  # the trees injected last
    decisions: tuple[tuple[GuidanceRecord, GenerationStats, GenerationStats], ...] = ()
    """The last decisions, and the generations before and after each."""
    edits: tuple[tuple[int, EditRecord, EditTrial | None], ...] = ()
    """The last edits, with the generation in which each was or would have been evaluated, and its
    comparison with the tree before; None: refused, or not evaluated."""

    def followed_by(self, view: GenerationView) -> RunHistory:
        """The history extended by one generation."""
        g, guidance = view.snapshot.generation, view.guidance
        injected = [tree.followed_by(view) for tree in self.injected]
        decisions, edits = [*self.decisions], [*self.edits]
        if guidance is not None:
            trees = [i for i in view.individuals if i.origin == Origin.INJECTED]
            for i in trees if guidance.injected else ():
                rank, family = best_rank([i], view.individuals), frozenset({i.id})
                injected.append(InjectedTree(g, guidance.target or "", i, rank, family, g))
            if self.now is not None:
                decisions.append((guidance, self.now.snapshot, view.snapshot))
            trials = iter(view.trials)
            edits += [(g, e, None if e.refused else next(trials, None)) for e in guidance.edits]
        return RunHistory(
            now=view,
            injected=tuple(injected[-KEPT:]),
            decisions=tuple(decisions[-KEPT:]),
            edits=tuple(edits[-MAX_PAST_EDITS:]),
        )


def ranked(individuals: Sequence[IndividualRecord]) -> list[IndividualRecord]:
    """The individuals by fitness, best first; equal ones in slot order."""
    return sorted(individuals, key=lambda i: -i.fitness)


def best_rank(some: Sequence[IndividualRecord], population: Sequence[IndividualRecord]) -> int:
    """The rank by fitness, from 1, of the fittest of some individuals of a population."""
    order = [i.id for i in ranked(population)]
    return 1 + min(order.index(i.id) for i in some)


def sections(
    context: RunContext,
    history: RunHistory,
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
        history: of the run so far; its last generation has the trees to edit.
        state: of the population.
        names: of the sections to be written; others are "".
        rare: share of the population below which a behaviour is rare.
        count: most trees to edit.
        evidence: whose points and traces are shown; None: the last generation.
        traced: True: with a trace of each tree to edit.
    """
    values: dict[str, Any] = {"run": context, "history": history, "state": state, "rare": rare}
    written, episodes = set(OF_STATE), None
    if (now := history.now) is not None:
        written, view = {*names, *OF_STATE}, evidence or now
        episodes = EpisodeTexts(context, view)
        members, classes, seen = view.individuals, context.classes, parents_of(view, context, count)
        groups = {n: [i for i in members if i.specialist == n] for n in classes.specialist_names}
        for name in classes.tiers:
            groups[f"{classes.tier_title(name)}s"] = [i for i in members if name in i.tiers]
        parents = parents_of(now, context, count)
        own = {i.tree for i in parents}
        values |= {
            "view": view,
            "groups": dict([*groups.items()][:ROWS]),
            "learned_lines": view.learned[:ROWS],
            "best": ranked(members)[0],
            "worst": most_lacking(members, classes),
            "parents_to_edit": [*zip(parents, seen, strict=False)],
            "others": parents_of(now, context, count + NEIGHBOURS)[len(parents) :],
            "elites": [*{e.tree: e for e in now.archive if e.tree not in own}.values()],
            "most_neighbours": NEIGHBOURS,
            "traced": traced,
            "episodes": episodes,
            "listing": lambda tree: listing(parse(tree, context.schema.vocabulary)),
        }
    template = environment().get_template("history.jinja")
    functions = {"best_rank": best_rank, "components": components, "mean": fmean}
    module = template.make_module({**values, **functions, "names": written})
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
    never = [n for n in names if not log.succeeded[n]]
    running = [n for n in never if log.active and n in log.active[-1]]
    failed = [f"{n} {log.failed[n]}x" for n in never if log.failed[n] and n not in running]
    unused = [name for name in names if name not in ran and not log.failed[name]]
    for what, parts in (
        ("succeeded", succeeded),
        ("running at the end, without a success before", running),
        ("failed and never succeeded", failed),
        ("never started", unused),
    ):
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
