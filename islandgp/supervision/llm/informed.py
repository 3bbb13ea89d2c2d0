"""What `prompts=informed` adds to the paper's prompts: rewards, injected trees and the like.

Each part can be switched off. All of it follows from configuration, the domain's
declaration and the records of generations, which a run that goes on and a replay have as
well, and has a largest size.
"""

from __future__ import annotations

import json
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from statistics import fmean
from typing import Final

from pydantic import BaseModel, Field

from islandgp.bt.core.language import parse
from islandgp.domain import Schema
from islandgp.gp.population import Origin
from islandgp.gp.record import GuidanceRecord, IndividualRecord
from islandgp.scoring.classes import Classes
from islandgp.scoring.generation_stats import GenerationStats
from islandgp.scoring.rewards import Reward, RewardTable
from islandgp.scoring.state import Crisis, PopulationState
from islandgp.supervision.base import RunContext, Seen
from islandgp.supervision.llm.episode import describe_episode
from islandgp.supervision.llm.run_facts import about
from islandgp.text import in_points, title

KEPT: Final = 20  # injected trees and decisions that are remembered
TREE: Final = 1500  # characters of a tree that is shown, at most
ROWS: Final = 40  # rewards and classes that are shown, at most
SHOWN: Final = 2000  # characters of rewards that are no table of events
PARTS: Final = 3  # components of a class's earnings


class InformedSettings(BaseModel, frozen=True, extra="forbid"):
    """The parts of informed prompts; each can be left out."""

    reasoning: bool = True  # the answer's reasons stand before its decision
    rewards: bool = True  # what events earn, and the thresholds of a crisis
    classes: bool = True  # what each class of the population earns
    injected: int = Field(default=5, ge=0, le=KEPT)  # the last injected trees with their fate
    traces: bool = True  # what the best and the most lacking tree did, in words
    decisions: int = Field(default=5, ge=0, le=KEPT)  # the last decisions and what followed
    differ: bool = True  # the instruction to differ from the examples


@dataclass(frozen=True, slots=True)
class InjectedTree:
    """A tree that was injected, and what has become of it."""

    generation: int  # in which it was evaluated first
    target: str  # what it was for
    new: IndividualRecord  # when it was evaluated first, perhaps after a mutation
    rank: int  # by fitness when it was new, from 1
    alive: frozenset[str]  # ids of the living that descend from it, itself and copies included
    most_alive: int  # the largest number of them in any generation
    last: int  # the last generation that had any
    unchanged: bool  # the very tree is among them
    best_rank: int | None  # of the fittest of them now; None: none is left


@dataclass(frozen=True, slots=True)
class PastDecision:
    """A decision, and the generations before and after it."""

    guidance: GuidanceRecord
    before: GenerationStats
    after: GenerationStats


@dataclass(frozen=True, slots=True)
class RunHistory:
    """A run so far."""

    now: Seen | None = None  # the last generation
    injected: tuple[InjectedTree, ...] = ()  # of the trees injected last, oldest first
    decisions: tuple[PastDecision, ...] = ()  # the last decisions, oldest first

    def followed_by(self, seen: Seen) -> RunHistory:
        """With one generation more. Generations that it was not given are not in it."""
        order = ranked(seen.individuals)
        ranks = {i.id: rank for rank, i in enumerate(order, 1)}
        trees = [_followed(tree, seen, ranks) for tree in self.injected]
        trees += [_new(i, seen, ranks) for i in seen.individuals if i.origin == Origin.INJECTED]
        decisions = self.decisions
        if self.now is not None and seen.guidance is not None:
            decision = PastDecision(seen.guidance, self.now.snapshot, seen.snapshot)
            decisions = (*decisions, decision)
        return RunHistory(seen, tuple(trees[-KEPT:]), decisions[-KEPT:])


def ranked(individuals: Sequence[IndividualRecord]) -> list[IndividualRecord]:
    """Best first; equals in slot order."""
    return sorted(individuals, key=lambda i: -i.fitness)


def _new(i: IndividualRecord, seen: Seen, ranks: dict[str, int]) -> InjectedTree:
    target = "" if seen.guidance is None else seen.guidance.target or ""
    rank = ranks[i.id]
    return InjectedTree(
        generation=seen.snapshot.generation,
        target=target,
        new=i,
        rank=rank,
        alive=frozenset({i.id}),
        most_alive=1,
        last=seen.snapshot.generation,
        unchanged=True,
        best_rank=rank,
    )


def _followed(tree: InjectedTree, seen: Seen, ranks: dict[str, int]) -> InjectedTree:
    heirs = [i for i in seen.individuals if not tree.alive.isdisjoint(i.parents)]
    return replace(
        tree,
        alive=frozenset(i.id for i in heirs),
        most_alive=max(tree.most_alive, len(heirs)),
        last=seen.snapshot.generation if heirs else tree.last,
        unchanged=any(i.tree == tree.new.tree for i in heirs),
        best_rank=min((ranks[i.id] for i in heirs), default=None),
    )


@dataclass(frozen=True, slots=True)
class RunValues:
    """Values for a generation's prompts, and what they took."""

    values: dict[str, str]
    episodes: int  # that were run for them


def standing_values(how: InformedSettings, context: RunContext) -> dict[str, str]:
    """Values that no generation changes; "" for a part that is left out."""
    return {
        "reasoning": "first" if how.reasoning else "",
        "differ": "differ" if how.differ else "",
        "traces_told": "told" if how.traces else "",
        "decisions_told": "told" if how.decisions else "",
        "rewards": _rewards(context.rewards, context.schema) if how.rewards else "",
        "thresholds": _thresholds(context.crisis) if how.rewards else "",
    }


RUN_VALUES: Final = ("earnings", "injected", "traces", "decisions")
"""Values that `run_values` gives."""

NO_VALUES: Final = RunValues(dict.fromkeys(RUN_VALUES, ""), 0)


def run_values(
    how: InformedSettings, context: RunContext, state: PopulationState, run: RunHistory
) -> RunValues:
    """The other values; "" for a part that is left out, or of which nothing is known yet."""
    if run.now is None:
        return NO_VALUES
    values, episodes = dict.fromkeys(RUN_VALUES, ""), 0
    if how.classes:
        values["earnings"] = "\n".join(_earnings(run.now.individuals, context.classes))
    if how.injected:
        trees = [_injected(tree, run.now) for tree in run.injected[-how.injected :]]
        values["injected"] = "\n\n".join(trees)
    if how.decisions:
        lines = [_decision(past, context.classes) for past in run.decisions[-how.decisions :]]
        values["decisions"] = "\n".join(lines)
    if how.traces:
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
        most = ", ".join(f"{name} {value:g}" for name, value in rewards.maxima.items())
        lines.append(f"- each component is divided by its largest value: {most}")
    return "\n".join(lines)


def _points(reward: Reward, amount: str) -> str:
    """What one event earns, e.g. "200 points and 100 for each of items"."""
    bands = [f"{band.points:g} points below {band.below:g} {amount}" for band in reward.bands]
    whole = [f"{reward.base:g} points"] if reward.base or not reward.per_unit else []
    each = f"{reward.per_unit:g} points for each of: {amount}"
    whole += [each] if reward.per_unit else []
    parts = [*bands, ("else " if bands else "") + " and ".join(whole)]
    over = f"; nothing up to {reward.over:g} {amount}" if reward.over is not None else ""
    return ", ".join(parts) + over


def _thresholds(crisis: Crisis) -> str:
    return (
        f"A crisis is a diversity below {crisis.diversity_below:g}, or more than"
        f" {crisis.stagnant_epochs_above:g} epochs of stagnation: then the mutation rate is"
        f" {crisis.emergency_rate:g}, whatever you answer."
    )


def _earnings(individuals: Sequence[IndividualRecord], classes: Classes) -> Iterator[str]:
    """A line for each class and tier that the generation has."""
    groups = {
        **{n: [i for i in individuals if i.specialist == n] for n in classes.specialist_names},
        **{
            f"{title(name)} Robots": [i for i in individuals if name in i.tiers]
            for name in classes.tiers
        },
    }
    for name, members in list(groups.items())[:ROWS]:
        if members:
            points = [i.fitness for i in members]
            yield (
                f"- {name}: {len(members)} individuals, mean {in_points(fmean(points))} points,"
                f" best {in_points(max(points))}; on the mean {_components(members)}"
            )


def _components(members: Sequence[IndividualRecord]) -> str:
    """The components that say most of some individuals' points."""
    means = {c: fmean(i.components[c] for i in members) for c in members[0].components}
    largest = sorted(means, key=lambda c: -abs(means[c]))[:PARTS]
    return ", ".join(f"{c} {in_points(means[c], '+')}" for c in largest if means[c]) or "nothing"


def _injected(tree: InjectedTree, now: Seen) -> str:
    tiers = ", ".join(f"{title(tier)} Robot" for tier in tree.new.tiers)
    start = (
        f"Generation {tree.generation}, for {tree.target or 'nothing'}"
        f"{', mutated at once' if tree.new.mutation else ''}: {in_points(tree.new.fitness)} points,"
        f" rank {tree.rank} of {len(now.individuals)}{f', {tiers}' if tiers else ''}."
    )
    if tree.best_rank is None:
        end = (
            f"It died out after generation {tree.last}; at most {tree.most_alive} descended from"
            " it at a time."
        )
    else:
        same = "it lives on unchanged" if tree.unchanged else "it lives on in changed trees only"
        n = len(tree.alive)
        alive = "1 living individual descends" if n == 1 else f"{n} living individuals descend"
        end = f"{alive} from it, the best of rank {tree.best_rank}; {same}."
    return f"{start} {end}\n```\n{cut(tree.new.tree)}\n```"


def cut(tree: str) -> str:
    """A tree's text, of TREE characters at most."""
    text = tree.strip()
    return text if len(text) <= TREE else text[: TREE - 3] + "..."


def _decision(past: PastDecision, classes: Classes) -> str:
    g, before, after = past.guidance, past.before, past.after
    by = "" if g.source == "llm" else f" by {g.source}"
    rate = f"rate {g.applied_rate:.2f}" + (f", enforced: crisis of {g.crisis}" if g.crisis else "")
    phase = f"{g.phase}, " if g.phase else ""
    tree = f", a tree for {g.target}" if g.injected else ""
    seen = "; ".join(
        f"{title(tier)} Robots {before.tiers[tier]} -> {after.tiers[tier]}"
        for tier in classes.milestones
    )
    new = "; a new stage, another scale" if before.stage != after.stage else ""
    return (
        f"- after generation {before.generation}{by}: {phase}{rate}{tree}. Then best"
        f" {in_points(before.best)} -> {in_points(after.best)}, mean"
        f" {in_points(before.mean)} -> {in_points(after.mean)};"
        f" {seen}; diversity {before.diversity:.2f} -> {after.diversity:.2f}{new}"
    )


def most_lacking(individuals: Sequence[IndividualRecord], classes: Classes) -> IndividualRecord:
    """The individual that shows the fewest behaviours, the least fit of equals."""
    return min(ranked(individuals)[::-1], key=lambda i: (len(classes.shown(i.counters)), i.fitness))


def _traces(context: RunContext, state: PopulationState, now: Seen) -> tuple[str, int]:
    """The best tree and the most lacking one in the first world in which they were evaluated."""
    best, worst = ranked(now.individuals)[0], most_lacking(now.individuals, context.classes)
    named = [("The fittest tree", best)]
    if worst.tree != best.tree:
        shown = context.classes.shown(worst.counters)
        lacking = ", ".join(name for name in state.lacking if name not in shown)
        named.append((f"The most lacking tree (no {lacking or 'behaviour lacks'})", worst))
    texts = [trace_of(name, i, context, now) for name, i in named]
    return "\n\n".join(texts), len(texts)


def trace_of(name: str, i: IndividualRecord, context: RunContext, now: Seen) -> str:
    """What an individual did in the first world in which it was evaluated, in words."""
    each = len(now.worlds) // len(now.individuals)  # 0: fewer worlds than individuals, all common
    seed = now.worlds[now.individuals.index(i) * each]
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
        f" ({_components([i])}). In {which} of {in_points(outcome.seconds)} s that ended with"
        f" {', '.join(outcome.endings)} it did:"
    )
    if world:
        head = f"{head}\n{world}"
    return "\n".join((head, *lines, "```", cut(i.tree), "```"))
