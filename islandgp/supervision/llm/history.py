"""The sections of prompts on the run so far: classes, injected trees, decisions, traces, edits.

Their texts are in `prompts/history.jinja`.

They depend on the configuration, the domain and the records of generations only, so a resumed run
and a replay have the same. Their size is limited, and no tree is shown twice in a prompt.
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
from islandgp.supervision.base import GenerationView, RunContext
from islandgp.supervision.llm.episode import (
    components,
    describe_episode,
    explanation_of,
    shortened,
    world_of,
)
from islandgp.supervision.llm.prompts import about, environment

ROWS: Final = 40  # most classes in a prompt
KEPT: Final = 5  # most injected trees and decisions in a prompt
MAX_PAST_EDITS: Final = 8  # most earlier edits in a prompt
NEIGHBOURS: Final = 3  # most individuals in a prompt besides the parents
LINES: Final = 60  # most nodes of a listed tree

RUN_VALUES: Final = ("earnings", "injected", "traces", "decisions", "learned")
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

    @property
    def change(self) -> str:
        """The branch, donor or number of the edit, in one line."""
        e = self.edit
        change = e.branch or (f"donor {e.donor} at {e.donor_at!r}" if e.donor else f"{e.number}")
        return " ".join(change.split())


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


def run_texts(context: RunContext, view: GenerationView | None) -> Any:
    """The macros of `history.jinja` for a generation."""
    values = {"run": context, "view": view, "best_rank": best_rank, "mean": fmean}
    template = environment().get_template("history.jinja")
    return template.make_module({**values, "components": components})


@dataclass(frozen=True, slots=True)
class Sections:
    """Makes the sections of prompts that differ between generations.

    Their values are by variable, "" without data so far, beside the episodes simulated for them.
    """

    context: RunContext  # of the run
    run: RunHistory  # so far
    view: GenerationView  # whose points and traces are shown

    @property
    def _texts(self) -> Any:
        return run_texts(self.context, self.view)

    def of_run(self, rarest: Sequence[str], names: Collection[str]) -> tuple[dict[str, str], int]:
        """The values of RUN_VALUES that `names` has, others being "".

        `rarest` are the behaviours, the rarest first.
        """
        values, shown, episodes = dict.fromkeys(RUN_VALUES, ""), Shown(), 0
        texts, classes, members = self._texts, self.context.classes, self.view.individuals
        if "earnings" in names:
            groups = {
                n: [i for i in members if i.specialist == n] for n in classes.specialist_names
            }
            for name in classes.tiers:
                groups[f"{classes.tier_title(name)}s"] = [i for i in members if name in i.tiers]
            values["earnings"] = texts.earnings(dict([*groups.items()][:ROWS]))
        if "traces" in names:
            values["traces"], episodes = self._traces(rarest, shown)
        if "injected" in names:
            values["injected"] = texts.injected(self.run.injected, shown)
        if "decisions" in names:
            values["decisions"] = texts.decisions(self.run.decisions)
        if "learned" in names:
            values["learned"] = "\n".join(f"- {s}" for s in self.view.learned[:ROWS])
        return values, episodes

    def _traces(self, rarest: Sequence[str], shown: Shown) -> tuple[str, int]:
        """Traces of the best and the least capable tree, and the episodes that were run for them.

        They are of the trees' first world in the generation. The best tree is explained, too.
        """
        classes = self.context.classes
        best = ranked(self.view.individuals)[0]
        worst = most_lacking(self.view.individuals, classes)
        comments, episodes = explanation_of(best, self.context, self.view)
        name = "The fittest tree"
        texts = [f"{self._trace(name, best)}\n{shown(best.tree, name.lower(), comments)}"]
        if worst.tree != best.tree:
            behaviours = classes.behaviours_of(worst.counters)
            lacking = ", ".join(name for name in rarest if name not in behaviours)
            name = f"The tree with the fewest behaviours (without {lacking})"
            texts.append(f"{self._trace(name, worst)}\n{shown(worst.tree, name.lower())}")
        return "\n\n".join(texts), episodes + len(texts)

    def _trace(self, name: str, i: IndividualRecord) -> str:
        """A description of an individual's episode in the first world of its evaluation."""
        domain, seed = world_of(i, self.context, self.view)
        tree = parse(i.tree, self.context.schema.vocabulary)
        outcome, lines = describe_episode(domain, tree, seed, self.view.multipliers)
        return str(self._texts.trace(name, i, outcome, filter(None, (about(domain, seed), *lines))))

    def of_edits(
        self, now: GenerationView, count: int, *, traced: bool = True
    ) -> tuple[dict[str, str], int]:
        """The values of EDIT_VALUES.

        Args:
            now: with the trees to edit; usually the generation that is shown.
            count: parents that are shown, at most.
            traced: True: with a trace of each parent.
        """
        texts, vocabulary = self._texts, self.context.schema.vocabulary
        parents = parents_of(now, self.context, count)
        others = parents_of(now, self.context, count + NEIGHBOURS)[len(parents) :]
        own = {i.tree for i in parents}
        elites = {e.tree: e for e in now.archive if e.tree not in own}.values()
        near = [f"Individual {i.id}:\n```\n{shortened(i.tree)}\n```" for i in others]
        near = [texts.elite(e, shortened(e.tree)) for e in elites] or near
        shown = [
            texts.parent(
                *(i.id, known, listing(parse(i.tree, vocabulary))),
                self._trace("", known) if traced else "",
            )
            for i, known in zip(parents, parents_of(self.view, self.context, count), strict=False)
        ]
        values = {
            "parents": "\n\n".join(shown),
            "neighbours": "\n\n".join(near[:NEIGHBOURS]),
            "past_edits": "\n".join(
                texts.past_edit(p.generation, p.edit, p.change, p.trial) for p in self.run.edits
            ),
        }
        return values, len(parents) * traced


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
