"""The sections of prompts on the run so far: classes, injected trees, decisions, traces, edits.

They depend on the configuration, the domain and the records of generations only, so a resumed run
and a replay have the same. Their size is limited, and no tree is shown twice in a prompt.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Sequence
from dataclasses import dataclass, replace
from statistics import fmean
from typing import Final

from islandgp.bt.core.language import parse, to_text
from islandgp.bt.core.node import Node
from islandgp.gp.archive import Elite
from islandgp.gp.edits import EditRecord, EditTrial, nodes_with_paths, path_text
from islandgp.gp.population import Origin
from islandgp.gp.record import GuidanceRecord, IndividualRecord
from islandgp.scoring.classes import Classes
from islandgp.scoring.constraints import merit, violation
from islandgp.scoring.generation_stats import GenerationStats
from islandgp.scoring.state import PopulationState
from islandgp.supervision.base import GenerationView, RunContext
from islandgp.supervision.llm.answers import MAX_EXPLANATION
from islandgp.supervision.llm.episode import components, explanation_of, shortened, trace_of
from islandgp.text import in_points

ROWS: Final = 40  # most classes in a prompt
KEPT: Final = 5  # most injected trees and decisions in a prompt
MAX_PAST_EDITS: Final = 8  # most earlier edits in a prompt
NEIGHBOURS: Final = 3  # most individuals in a prompt besides the parents
LINES: Final = 60  # most nodes of a listed tree

RUN_VALUES: Final = ("earnings", "injected", "traces", "decisions")
EDIT_VALUES: Final = ("parents", "neighbours", "past_edits")
"""Variables of prompts that differ between generations."""


@dataclass(frozen=True, slots=True)
class InjectedTree:
    """An injected tree with its descendants."""

    generation: int  # of its first evaluation
    target: str  # its purpose
    new: IndividualRecord  # at its first evaluation, possibly mutated
    rank: int  # by fitness in that generation, from 1
    alive: tuple[IndividualRecord, ...]  # descendants in this generation, including itself
    family: frozenset[str]  # ids of all descendants so far; a search can keep some aside
    last: int  # last generation with any

    def followed_by(self, view: GenerationView) -> InjectedTree:
        """The tree with its descendants in the next generation."""
        alive = tuple(i for i in view.individuals if not self.family.isdisjoint(i.parents))
        last = view.snapshot.generation if alive else self.last
        return replace(self, alive=alive, family=self.family | {i.id for i in alive}, last=last)


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
        if view.guidance is not None and view.guidance.injected:
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
            injected=tuple(trees[-KEPT:]),
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


def _new(i: IndividualRecord, view: GenerationView) -> InjectedTree:
    target = "" if view.guidance is None else view.guidance.target or ""
    generation, rank = view.snapshot.generation, best_rank([i], view.individuals)
    return InjectedTree(generation, target, i, rank, (i,), frozenset({i.id}), generation)


class Shown:
    """Prints each tree once; later it names the place of the first time."""

    def __init__(self) -> None:
        self._names: dict[str, str] = {}

    def __call__(self, tree: str, name: str, comments: str = "") -> str:
        """The tree in a fence, or a sentence that names where it stands above.

        `comments`: the same tree with comments, which is printed instead.
        """
        if (first := self._names.setdefault(tree.strip(), name)) != name:
            return f"Its tree is that of {first}."
        return f"```\n{comments.strip() or shortened(tree)}\n```"


def run_values(
    context: RunContext, state: PopulationState, run: RunHistory, names: Collection[str]
) -> tuple[dict[str, str], int]:
    """The values of RUN_VALUES that `names` has, and the episodes simulated for them.

    Others, and those without data so far, are "".
    """
    values, now, shown, episodes = dict.fromkeys(RUN_VALUES, ""), run.now, Shown(), 0
    if now is None:
        return values, 0
    if "earnings" in names:
        values["earnings"] = "\n".join(_earnings(now.individuals, context.classes))
    if "traces" in names:
        texts, episodes = _traces(context, state, now, shown)
        values["traces"] = "\n\n".join(texts)
    if "injected" in names:
        trees = [_injected(tree, now, context.classes, shown) for tree in run.injected]
        values["injected"] = "\n\n".join(trees)
    if "decisions" in names:
        lines = [_decision(past, context) for past in run.decisions]
        values["decisions"] = "\n".join(lines)
    return values, episodes


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


def _injected(tree: InjectedTree, now: GenerationView, classes: Classes, shown: Shown) -> str:
    tiers = ", ".join(map(classes.tier_title, tree.new.tiers))
    start = (
        f"Generation {tree.generation}, for {tree.target or 'nothing'}"
        f"{', mutated at once' if tree.new.mutation else ''}: {in_points(tree.new.fitness)} points,"
        f" rank {tree.rank} of {len(now.individuals)}{f', {tiers}' if tiers else ''}."
    )
    n = len(tree.alive)
    if n:
        same = any(i.tree == tree.new.tree for i in tree.alive)
        alive = (
            "1 individual of this generation descends"
            if n == 1
            else (f"{n} individuals of this generation descend")
        )
        end = (
            f"{alive} from it, the best of rank {best_rank(tree.alive, now.individuals)}"
            f"{'; it is one of them, unchanged' if same else ''}."
        )
    else:
        end = f"No individual of this generation descends from it, the last one did in {tree.last}."
    return f"{start} {end}\n{shown(tree.new.tree, f'the tree of generation {tree.generation}')}"


def _decision(past: PastDecision, context: RunContext) -> str:
    g, before, after = past.guidance, past.before, past.after
    by = "" if g.source == "llm" else f" by {g.source}"
    enforced = f", enforced by a crisis of {g.crisis}" * bool(g.crisis)
    phase = f"{g.phase}, " if g.phase else ""
    parts = [f"{phase}rate {g.applied_rate:.2f}{enforced}"] * context.by_rate
    parts += [f"a tree for {g.target}"] * g.injected
    milestones = "; ".join(
        f"{context.classes.tier_title(tier)}s {before.tiers[tier]} -> {after.tiers[tier]}"
        for tier in context.classes.milestones
    )
    new = "; a new stage" if before.stage != after.stage else ""
    return (
        f"- for generation {after.generation}{by}: {', '.join(parts) or 'nothing'}. Best"
        f" {in_points(before.fitness_max)} -> {in_points(after.fitness_max)}, mean"
        f" {in_points(before.fitness_mean)} -> {in_points(after.fitness_mean)};"
        f" {milestones}; diversity {before.diversity:.2f} -> {after.diversity:.2f}{new}"
    )


def most_lacking(individuals: Sequence[IndividualRecord], classes: Classes) -> IndividualRecord:
    """The individual with the fewest behaviours; of several the least fit one."""
    return min(
        ranked(individuals)[::-1], key=lambda i: (len(classes.behaviours_of(i.counters)), i.fitness)
    )


def _traces(
    context: RunContext, state: PopulationState, now: GenerationView, shown: Shown
) -> tuple[list[str], int]:
    """Traces of the best and the least capable tree, and the episodes that were run for them.

    They are of the trees' first world in the generation. The best tree is explained, too.
    """
    best, worst = ranked(now.individuals)[0], most_lacking(now.individuals, context.classes)
    comments, episodes = explanation_of(best, context, now)
    name = "The fittest tree"
    texts = [f"{trace_of(name, best, context, now)}\n{shown(best.tree, name.lower(), comments)}"]
    if worst.tree != best.tree:
        behaviours = context.classes.behaviours_of(worst.counters)
        lacking = ", ".join(name for name in state.rarest_behaviours if name not in behaviours)
        name = f"The tree with the fewest behaviours (without {lacking})"
        texts.append(f"{trace_of(name, worst, context, now)}\n{shown(worst.tree, name.lower())}")
    return texts, episodes + len(texts)


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


def edit_values(
    context: RunContext,
    run: RunHistory,
    count: int,
    *,
    traced: bool = True,
    evidence: GenerationView | None = None,
) -> tuple[dict[str, str], int]:
    """The values of EDIT_VALUES, and the episodes simulated for them.

    Args:
        context: of the run.
        run: so far.
        count: parents that are shown, at most.
        traced: True: with a trace of each parent.
        evidence: the generation whose points and traces are shown; None: that of the parents.
    """
    view = run.now
    if view is None:
        return dict.fromkeys(EDIT_VALUES, ""), 0
    parents = parents_of(view, context, count)
    others = parents_of(view, context, count + NEIGHBOURS)[len(parents) :]
    texts = {i.tree for i in parents}
    elites = {e.tree: _elite(e) for e in view.archive if e.tree not in texts}
    near = [f"Individual {i.id}:\n```\n{shortened(i.tree)}\n```" for i in others]
    shown = evidence or view
    known = parents_of(shown, context, count)
    values = {
        "parents": "\n\n".join(
            _parent(i, each, context, shown, traced=traced)
            for i, each in zip(parents, known, strict=False)
        ),
        "neighbours": "\n\n".join(([*elites.values()] or near)[:NEIGHBOURS]),
        "past_edits": "\n".join(map(_past, run.edits)),
    }
    return values, len(parents) * traced


def _elite(e: Elite) -> str:
    points = f"{in_points(e.mean)} points on the mean of its episodes so far"
    return f"Individual {e.id}, of the archive: {points}.\n```\n{shortened(e.tree)}\n```"


def _head(name: str, i: IndividualRecord, context: RunContext) -> str:
    """The points and counts of an individual."""
    counted = context.schema.counters
    tiers = "".join(f", {context.classes.tier_title(tier)}" for tier in i.tiers)
    counts = ", ".join(
        f"{in_points(value)} {counted[name].meaning}" for name, value in i.counters.items() if value
    )
    return f"Individual {name}: {in_points(i.fitness)} points{tiers} ({counts or 'none'})."


def _parent(
    i: IndividualRecord,
    known: IndividualRecord,
    context: RunContext,
    view: GenerationView,
    *,
    traced: bool,
) -> str:
    """The tree of `i`, with the points and the trace of `known`, which is usually the same."""
    tree = parse(i.tree, context.schema.vocabulary)
    trace = [trace_of("It", known, context, view)] if traced else []
    return "\n".join((_head(i.id, known, context), *listing(tree), *trace))


def paths_of(tree: str, context: RunContext) -> list[str]:
    """The places of a tree that are listed."""
    nodes = nodes_with_paths(parse(tree, context.schema.vocabulary))
    return [path_text(path) for path, _ in list(nodes)[:LINES]]


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
