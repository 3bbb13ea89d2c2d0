"""The sections of prompts on the run so far: classes, decisions, traces, edits.

Their texts are in `prompts/history.jinja`. They depend on the configuration, the domain and the
records of generations only, so a resumed run and a replay have the same. Their size is limited, and
no tree is shown twice in a prompt.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass
from itertools import pairwise
from statistics import fmean
from typing import Any, Final

from islandgp.bt.core.language import parse, to_text
from islandgp.bt.core.node import Node, walk
from islandgp.domain import Domain, Observer, Outcome
from islandgp.gp.edits import EditRecord, EditTrial, nodes_with_paths, path_text
from islandgp.gp.record import IndividualRecord
from islandgp.scoring.classes import Classes
from islandgp.scoring.constraints import merit, violation
from islandgp.scoring.explain import NodeUsage, Run, explained_in_text, usage
from islandgp.scoring.state import PopulationState
from islandgp.supervision.base import GenerationView, RunContext
from islandgp.supervision.llm.prompts import about, environment
from islandgp.text import in_points

ROWS: Final = 40  # most classes, and most learned sentences, in a prompt
KEPT: Final = 5  # most decisions in a prompt
MAX_PAST_EDITS: Final = 8  # most earlier edits in a prompt
NEIGHBOURS: Final = 3  # most individuals in a prompt besides the parents
LINES: Final = 60  # most nodes of a listed tree

PARTS: Final = 3  # most components of a class's earnings

RUN_VALUES: Final = ("earnings", "traces", "decisions", "learned")
EDIT_VALUES: Final = ("parents", "neighbours", "past_edits")
"""Variables of prompts that differ between generations."""
OF_STATE: Final = ("urgency", "progress")  # those that need the population's state only


def past_edits(history: Sequence[GenerationView]) -> list[tuple[int, EditRecord, EditTrial | None]]:
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
            "changes": [*pairwise(history)][-KEPT:],
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
            "ranked": ranked,
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


def listing(tree: Node) -> dict[str, str]:
    """The nodes of a tree without their children, by path: `0/2` has `Charge`."""
    nodes = [*nodes_with_paths(tree)][:LINES]
    return {path_text(path): to_text(node).split("{", 1)[0].strip() for path, node in nodes}


def deeds(tree: Node, usages: Sequence[NodeUsage]) -> list[str]:
    """A line for each action of a tree: what its nodes did in an episode.

    Args:
        tree: that was run.
        usages: of its nodes, in document order, in one world.
    """
    actions: dict[str, list[NodeUsage]] = {}
    for node, own in zip(walk(tree), usages, strict=True):
        if node.action:
            actions.setdefault(to_text(node).strip(), []).append(own)
    lines = []
    for action, nodes in actions.items():
        ticks, succeeded = sum(u.ticks for u in nodes), sum(u.successes for u in nodes)
        failed, points = sum(u.failures for u in nodes), sum(u.points for u in nodes)
        counts = f"{ticks:g} ticks, succeeded {succeeded:g}x, failed {failed:g}x"
        earned = f", {in_points(points, '+')} points" if points else ""
        lines.append(f"- {action}: {counts if ticks else 'never ran'}{earned}")
    return lines


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

    def _tree(self, i: IndividualRecord) -> Node:
        return parse(i.tree, self.context.schema.vocabulary)

    def _run(self, domain: Domain, outcomes: list[Outcome]) -> Run:
        """Runs episodes with the generation's factors, and keeps their outcomes."""

        def run(tree: Node, seed: int, observer: Observer | None) -> Outcome:
            self.number += 1
            outcomes.append(domain.run_episode(tree, seed, self.view.multipliers, observer))
            return outcomes[-1]

        return run

    def described(self, i: IndividualRecord) -> tuple[Outcome, str, int, list[str]]:
        """The outcome of an individual's episode, its world in words, its ticks, and its deeds."""
        (domain, seed), tree, outcomes = self._world(i), self._tree(i), list[Outcome]()
        usages = usage(self._run(domain, outcomes), tree, [seed])
        return outcomes[0], about(domain, seed), int(usages[0].ticks), deeds(tree, usages)

    def explained(self, i: IndividualRecord) -> str:
        """An individual's tree with what each branch did and is worth."""
        domain, seed = self._world(i)
        return explained_in_text(self._run(domain, []), self._tree(i), [seed])


def components(members: Sequence[IndividualRecord]) -> str:
    """The largest components of some individuals' points."""
    means = {c: fmean(i.components[c] for i in members) for c in members[0].components}
    largest = sorted(means, key=lambda c: -abs(means[c]))[:PARTS]
    return ", ".join(f"{c} {in_points(means[c], '+')}" for c in largest if means[c]) or "nothing"
