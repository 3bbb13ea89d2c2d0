"""The sections of prompts on the run so far: classes, injected trees, decisions, traces, edits.

Their texts are in `prompts/history.jinja`. They depend on the configuration, the domain and the
records of generations only, so a resumed run and a replay have the same. Their size is limited, and
no tree is shown twice in a prompt.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace
from statistics import fmean
from typing import Any, Final

from islandgp.bt.core.language import parse, to_text
from islandgp.bt.core.node import Node
from islandgp.gp.edits import EditRecord, EditTrial, nodes_with_paths, path_text
from islandgp.gp.population import Origin
from islandgp.gp.record import GuidanceRecord, IndividualRecord
from islandgp.scoring.classes import Classes
from islandgp.scoring.constraints import merit, violation
from islandgp.scoring.generation_stats import GenerationStats
from islandgp.scoring.state import PopulationState
from islandgp.supervision.base import GenerationView, RunContext
from islandgp.supervision.llm.episode import EpisodeTexts, components
from islandgp.supervision.llm.prompts import environment

ROWS: Final = 40  # most classes, and most learned sentences, in a prompt
KEPT: Final = 5  # most injected trees and decisions in a prompt
MAX_PAST_EDITS: Final = 8  # most earlier edits in a prompt
NEIGHBOURS: Final = 3  # most individuals in a prompt besides the parents
LINES: Final = 60  # most nodes of a listed tree

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
