"""The sections of prompts on the run so far and its rules: rewards, injected trees, traces, edits.

The sections depend on the configuration, the domain and the records of generations only, so a
resumed run and a replay have the same. Their size is limited.
"""

from __future__ import annotations

import json
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from statistics import fmean
from typing import Final

from pydantic import BaseModel

from islandgp.bt.core.language import parse, to_text
from islandgp.bt.core.node import Node
from islandgp.domain import Reward, RewardTable, Schema
from islandgp.gp.archive import Elite
from islandgp.gp.edits import EditRecord, EditTrial, nodes_with_paths, path_text
from islandgp.gp.population import Origin
from islandgp.gp.record import GuidanceRecord, IndividualRecord
from islandgp.scoring.classes import Classes
from islandgp.scoring.constraints import merit, violation
from islandgp.scoring.generation_stats import GenerationStats
from islandgp.scoring.state import Crisis, PopulationState
from islandgp.supervision.base import GenerationView, RunContext
from islandgp.supervision.llm.answers import MAX_EXPLANATION
from islandgp.supervision.llm.episode import components, shortened, trace_of
from islandgp.supervision.llm.settings import MAX_KEPT, InformedSettings
from islandgp.text import in_points

ROWS: Final = 40  # most rewards and classes in a prompt
SHOWN: Final = 2000  # most characters of rewards that are not a table of events
MAX_PAST_EDITS: Final = 8  # most earlier edits in a prompt
NEIGHBOURS: Final = 3  # most individuals in a prompt besides the parents
LINES: Final = 60  # most nodes of a listed tree

EDIT_VALUES: Final = ("parents", "neighbours", "past_edits")
"""Variables of `prompts/edits.md` that differ between generations."""


@dataclass(frozen=True, slots=True)
class InjectedTree:
    """An injected tree with its descendants."""

    generation: int  # of its first evaluation
    target: str  # its purpose
    new: IndividualRecord  # at its first evaluation, possibly mutated
    rank: int  # by fitness in that generation, from 1
    alive: tuple[IndividualRecord, ...]  # living descendants, including itself and copies
    most_alive: int  # largest number of them in any generation
    last: int  # last generation with any

    @property
    def unchanged(self) -> bool:
        """True if a living descendant is the same tree."""
        return any(i.tree == self.new.tree for i in self.alive)

    def followed_by(self, view: GenerationView) -> InjectedTree:
        """The tree with its descendants in the next generation."""
        before = {i.id for i in self.alive}
        alive = tuple(i for i in view.individuals if not before.isdisjoint(i.parents))
        last = view.snapshot.generation if alive else self.last
        return replace(self, alive=alive, most_alive=max(self.most_alive, len(alive)), last=last)


@dataclass(frozen=True, slots=True)
class PastDecision:
    """A decision, and the generations before and after it."""

    guidance: GuidanceRecord
    before: GenerationStats
    after: GenerationStats


@dataclass(frozen=True, slots=True)
class PastEdit:
    """An edit of an earlier answer, and its comparison with the tree before it."""

    generation: int  # in which its tree was evaluated, or would have been
    edit: EditRecord
    trial: EditTrial | None  # None: refused, or not evaluated


@dataclass(frozen=True, slots=True)
class RunHistory:
    """The history of a run for prompts."""

    now: GenerationView | None = None  # the last generation
    injected: tuple[InjectedTree, ...] = ()  # of the trees injected last, oldest first
    decisions: tuple[PastDecision, ...] = ()  # the last decisions, oldest first
    edits: tuple[PastEdit, ...] = ()  # the last edits, oldest first

    def followed_by(self, view: GenerationView) -> RunHistory:
        """The history extended by one generation."""
        trees = [tree.followed_by(view) for tree in self.injected]
        trees += [_new(i, view) for i in view.individuals if i.origin == Origin.INJECTED]
        decisions, edits = [*self.decisions], [*self.edits]
        if (guidance := view.guidance) is not None:
            if self.now is not None:
                decisions.append(PastDecision(guidance, self.now.snapshot, view.snapshot))
            trials = iter(view.trials)
            for edit in guidance.edits:
                trial = None if edit.refused else next(trials, None)
                edits.append(PastEdit(view.snapshot.generation, edit, trial))
        return RunHistory(
            now=view,
            injected=tuple(trees[-MAX_KEPT:]),
            decisions=tuple(decisions[-MAX_KEPT:]),
            edits=tuple(edits[-MAX_PAST_EDITS:]),
        )


def ranked(individuals: Sequence[IndividualRecord]) -> list[IndividualRecord]:
    """The individuals by fitness, best first; equal ones in slot order."""
    return sorted(individuals, key=lambda i: -i.fitness)


def best_rank(some: Sequence[IndividualRecord], population: Sequence[IndividualRecord]) -> int:
    """The rank by fitness, from 1, of the fittest of some individuals of a population."""
    order = [i.id for i in ranked(population)]
    return 1 + min(order.index(i.id) for i in some)


def _new(i: IndividualRecord, view: GenerationView) -> InjectedTree:
    target = "" if view.guidance is None else view.guidance.target or ""
    generation, rank = view.snapshot.generation, best_rank([i], view.individuals)
    return InjectedTree(generation, target, i, rank, (i,), 1, generation)


@dataclass(frozen=True, slots=True)
class RunValues:
    """Values for a generation's prompts, and their costs."""

    values: dict[str, str]
    episodes: int  # simulated for them


def constant_values(settings: InformedSettings, context: RunContext) -> dict[str, str]:
    """Values that are the same in all generations; "" for a part that is left out."""
    return {
        "reasoning": "first" if settings.reasoning else "",
        "differ": "differ" if settings.differ else "",
        "trace_section": "yes" if settings.traces else "",
        "decision_section": "yes" if settings.decisions else "",
        "rewards": _rewards(context.rewards, context.schema) if settings.rewards else "",
        "thresholds": _thresholds(context.crisis) if settings.rewards else "",
    }


RUN_VALUES: Final = ("earnings", "injected", "traces", "decisions")
"""Values that `run_values` gives."""

NO_VALUES: Final = RunValues(dict.fromkeys(RUN_VALUES, ""), 0)


def run_values(
    settings: InformedSettings, context: RunContext, state: PopulationState, run: RunHistory
) -> RunValues:
    """The other values; "" for a part that is left out, or without data so far."""
    if run.now is None:
        return NO_VALUES
    values, episodes = dict.fromkeys(RUN_VALUES, ""), 0
    if settings.classes:
        values["earnings"] = "\n".join(_earnings(run.now.individuals, context.classes))
    if settings.injected:
        trees = [
            _injected(tree, run.now, context.classes) for tree in run.injected[-settings.injected :]
        ]
        values["injected"] = "\n\n".join(trees)
    if settings.decisions:
        lines = [_decision(past, context.classes) for past in run.decisions[-settings.decisions :]]
        values["decisions"] = "\n".join(lines)
    if settings.traces:
        values["traces"], episodes = _traces(context, state, run.now)
    return RunValues(values, episodes)


def _rewards(rewards: BaseModel, schema: Schema) -> str:
    """Table 3 of the running configuration in words."""
    if not isinstance(rewards, RewardTable):
        text = json.dumps(rewards.model_dump(mode="json"))
        return text if len(text) <= SHOWN else text[: SHOWN - 3] + "..."
    lines = []
    for name, reward in list(rewards.events.items())[:ROWS]:
        event = schema.events[name]
        line = f"- {name}, {event.meaning}: {_points(reward, event.amount)}"
        lines.append(f"{line} (component {reward.component})")
    if rewards.normalize:
        maxima = ", ".join(f"{name} {value:g}" for name, value in rewards.maxima.items())
        lines.append(f"- each component is divided by its largest value: {maxima}")
    return "\n".join(lines)


def _points(reward: Reward, amount: str) -> str:
    """The points of one event in words, e.g. "200 points and 100 for each of items"."""
    bands = [f"{band.points:g} points below {band.below:g} {amount}" for band in reward.bands]
    terms = [f"{reward.base:g} points"] if reward.base or not reward.per_unit else []
    each = f"{reward.per_unit:g} points for each of: {amount}"
    terms += [each] if reward.per_unit else []
    parts = [*bands, ("else " if bands else "") + " and ".join(terms)]
    over = f"; nothing up to {reward.over:g} {amount}" if reward.over is not None else ""
    return ", ".join(parts) + over


def _thresholds(crisis: Crisis) -> str:
    return (
        f"A crisis is a diversity below {crisis.diversity_below:g}, or more than"
        f" {crisis.stagnant_epochs_above:g} epochs of stagnation: then the mutation rate is"
        f" {crisis.emergency_rate:g}, regardless of your answer."
    )


def _earnings(individuals: Sequence[IndividualRecord], classes: Classes) -> Iterator[str]:
    """A line for each class and tier with individuals in the generation."""
    groups = {
        **{n: [i for i in individuals if i.specialist == n] for n in classes.specialist_names},
        **{
            f"{classes.tier_title(name)}s": [i for i in individuals if name in i.tiers]
            for name in classes.tiers
        },
    }
    for name, members in list(groups.items())[:ROWS]:
        if members:
            points = [i.fitness for i in members]
            yield (
                f"- {name}: {len(members)} individuals, mean {in_points(fmean(points))} points,"
                f" best {in_points(max(points))}; on the mean {components(members)}"
            )


def _injected(tree: InjectedTree, now: GenerationView, classes: Classes) -> str:
    tiers = ", ".join(map(classes.tier_title, tree.new.tiers))
    start = (
        f"Generation {tree.generation}, for {tree.target or 'nothing'}"
        f"{', mutated at once' if tree.new.mutation else ''}: {in_points(tree.new.fitness)} points,"
        f" rank {tree.rank} of {len(now.individuals)}{f', {tiers}' if tiers else ''}."
    )
    n = len(tree.alive)
    if n:
        same = "it lives on unchanged" if tree.unchanged else "it lives on in changed trees only"
        alive = "1 living individual descends" if n == 1 else f"{n} living individuals descend"
        end = f"{alive} from it, the best of rank {best_rank(tree.alive, now.individuals)}; {same}."
    else:
        end = (
            f"It died out after generation {tree.last}; at most {tree.most_alive} descended from"
            " it at a time."
        )
    return f"{start} {end}\n```\n{shortened(tree.new.tree)}\n```"


def _decision(past: PastDecision, classes: Classes) -> str:
    g, before, after = past.guidance, past.before, past.after
    by = "" if g.source == "llm" else f" by {g.source}"
    rate = f"rate {g.applied_rate:.2f}" + (f", enforced: crisis of {g.crisis}" if g.crisis else "")
    phase = f"{g.phase}, " if g.phase else ""
    tree = f", a tree for {g.target}" if g.injected else ""
    milestones = "; ".join(
        f"{classes.tier_title(tier)}s {before.tiers[tier]} -> {after.tiers[tier]}"
        for tier in classes.milestones
    )
    new = "; a new stage, another scale" if before.stage != after.stage else ""
    return (
        f"- after generation {before.generation}{by}: {phase}{rate}{tree}. Then best"
        f" {in_points(before.best)} -> {in_points(after.best)}, mean"
        f" {in_points(before.mean)} -> {in_points(after.mean)};"
        f" {milestones}; diversity {before.diversity:.2f} -> {after.diversity:.2f}{new}"
    )


def most_lacking(individuals: Sequence[IndividualRecord], classes: Classes) -> IndividualRecord:
    """The individual with the fewest behaviours; of several the least fit one."""
    return min(
        ranked(individuals)[::-1], key=lambda i: (len(classes.behaviours_of(i.counters)), i.fitness)
    )


def _traces(context: RunContext, state: PopulationState, now: GenerationView) -> tuple[str, int]:
    """Traces of the best and the least capable tree, in their first world of the generation."""
    best, worst = ranked(now.individuals)[0], most_lacking(now.individuals, context.classes)
    named = [("The fittest tree", best)]
    if worst.tree != best.tree:
        behaviours = context.classes.behaviours_of(worst.counters)
        lacking = ", ".join(name for name in state.rarest_behaviours if name not in behaviours)
        named.append((f"The most lacking tree (no {lacking or 'behaviour lacks'})", worst))
    texts = [trace_of(name, i, context, now) for name, i in named]
    return "\n\n".join(texts), len(texts)


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


def edit_values(context: RunContext, run: RunHistory, count: int) -> tuple[dict[str, str], int]:
    """The values of EDIT_VALUES, and the episodes that were run for them.

    Args:
        context: of the run.
        run: so far.
        count: parents that are shown, at most.
    """
    view = run.now
    if view is None:
        return dict.fromkeys(EDIT_VALUES, ""), 0
    parents = parents_of(view, context, count)
    others = parents_of(view, context, count + NEIGHBOURS)[len(parents) :]
    texts = {i.tree for i in parents}
    elites = [_elite(e) for e in view.archive if e.tree not in texts]
    near = [f"{_head(i, context.classes)}\n```\n{shortened(i.tree)}\n```" for i in others]
    return {
        "parents": "\n\n".join(_parent(i, context, view) for i in parents),
        "neighbours": "\n\n".join((elites or near)[:NEIGHBOURS]),
        "past_edits": "\n".join(map(_past, run.edits)),
    }, len(parents)


def _elite(e: Elite) -> str:
    points = f"{in_points(e.mean)} points in stage {e.stage + 1}"
    return f"Individual {e.id}, of the archive: {points}.\n```\n{shortened(e.tree)}\n```"


def _head(i: IndividualRecord, classes: Classes) -> str:
    tiers = "".join(f", {classes.tier_title(tier)}" for tier in i.tiers)
    counts = ", ".join(f"{name} {in_points(value)}" for name, value in i.counters.items() if value)
    return (
        f"Individual {i.id}: {in_points(i.fitness)} points, class {i.specialist}{tiers}"
        f" ({counts or 'nothing counted'})."
    )


def _parent(i: IndividualRecord, context: RunContext, view: GenerationView) -> str:
    tree = parse(i.tree, context.schema.vocabulary)
    return "\n".join((_head(i, context.classes), *listing(tree), trace_of("It", i, context, view)))


def listing(tree: Node) -> list[str]:
    """One line per node of a tree, with its path, e.g. `0/2 action Charge`."""
    lines = []
    for path, node in list(nodes_with_paths(tree))[:LINES]:
        text = to_text(node._replace(children=())) if not node.children else _opening(node)
        lines.append(f'  at "{path_text(path)}": {text.strip()}')
    return lines


def _opening(node: Node) -> str:
    """A node's first line, without its children."""
    return to_text(node).split("{", 1)[0].strip()


def _past(past: PastEdit) -> str:
    e, trial = past.edit, past.trial
    change = e.branch or (f"donor {e.donor} at {e.donor_at!r}" if e.donor else f"{e.number}")
    change = " ".join(change.split())
    text = f'- generation {past.generation}, {e.kind} at "{e.at}" of {e.of}: {change}'
    if e.refused:
        return f"{text[:MAX_EXPLANATION]}; refused: {e.refused}"
    if trial is None:
        return f"{text[:MAX_EXPLANATION]}; not evaluated"
    before, after = trial.parent_fitness, trial.fitness
    gain = in_points(after - before, "+")
    return f"{text[:MAX_EXPLANATION]}; {in_points(before)} -> {in_points(after)} points ({gain})"


def known_texts(living: Iterable[str], examples: Iterable[Node]) -> frozenset[str]:
    """Canonical texts of the living trees and of the examples."""
    return frozenset((*living, *map(to_text, examples)))
