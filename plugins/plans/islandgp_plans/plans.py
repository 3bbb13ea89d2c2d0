"""Racing with plans: what actions need and give is learned, and chained into trees.

Each episode is observed. From its samples the search learns models of the actions
(`action_models`), and about half of the new trees are made from these:

- `achieve`: a plan for an action that earns points, in front of a survivor's branches;
- `repair`: a plan for the needs of an action of a survivor, before that action;
- `maintain`: a plan for an action that raises a number, such as a charge, when it is low;
- `probe`: a plan for a combination of conditions in which an action that never succeeded was
  tried least, and then that action;
- `policy`: in a world with few states, the best policy by value iteration (`policies`).

The others are made as in `racing`, without children that would act as their mother (`neutral`).
Backchaining as in Colledanchise and Ogren's PA-BT; the repair of failed actions as in BETR-XP-LLM
(Styrud et al. 2024, arXiv 2409.13356).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, ClassVar, Final

import numpy as np
from pydantic import Field

from islandgp.bt.analysis.simplify import simplify
from islandgp.bt.core.condition import Condition
from islandgp.bt.core.kinds import kind_of
from islandgp.bt.core.language import parse
from islandgp.bt.core.node import FAILURE, Limits, Node, replace_at, selector, walk, within
from islandgp.bt.core.printer import head
from islandgp.bt.core.vocabulary import Vocabulary
from islandgp.gp.evidence import digest
from islandgp.gp.plan import Plan
from islandgp.gp.population import Evaluated, Origin, Proposal
from islandgp.gp.random_trees import weighted
from islandgp.search.base import SearchState
from islandgp.search.breeding import GenerationPlan, Pick, new_child
from islandgp.search.racing import Racing, RacingMemory, RacingSettings
from islandgp_plans.action_models import (
    ActionModel,
    ActionRecord,
    ActionSample,
    Learner,
    all_leaves,
    recorded,
    small_world,
    without_numbers,
)
from islandgp_plans.action_observer import ActionObserver
from islandgp_plans.neutral import Screen
from islandgp_plans.planning import Planner, Rule, branches
from islandgp_plans.policies import best_policy

TRIES: Final = 10  # attempts to make a tree from a plan
CHILDREN: Final = 15  # attempts to make a child that does not act as its mother
MAX_SAMPLES: Final = 60  # of a survivor that are kept
CONJUNCTIONS: Final = 40  # that a probe compares
OPTIMISTIC: Final = 0.5  # chance that a policy explores what was never tried
OTHER_STATE: Final = 0.5  # chance that a known action is probed under one more condition
PROBE_WEIGHT: Final = 3.0  # of probes while nothing earns points; the others have weight 1
PROBED: Final = 3  # most actions that a probe tries


class PlansSettings(RacingSettings, frozen=True):
    """Those of racing, and the share of plans."""

    planned: float = Field(ge=0, le=1)  # share of new trees that are made from plans
    planned_stuck: float = Field(ge=0, le=1)  # the same while an action has never succeeded


@dataclass(frozen=True, slots=True)
class PlansMemory:
    """Racing's memory, and the records of actions."""

    racing: RacingMemory
    actions: dict[str, ActionRecord] = field(default_factory=dict)  # by text of the leaf
    visited: dict[str, tuple[ActionSample, ...]] = field(default_factory=dict)
    """Samples of the last evaluation of each survivor, by digest."""


class Plans(Racing):
    """See the module."""

    Settings = PlansSettings  # type: ignore[assignment] # with more fields
    Memory: ClassVar[Any] = PlansMemory
    observer: ClassVar[Any] = ActionObserver
    settings: PlansSettings

    @staticmethod
    def suits(vocabulary: Vocabulary, stuck: bool) -> str:  # noqa: ARG004 # of all searches
        """Why it suits a domain: chains of actions earn points, if nothing else has; or ""."""
        return "it learns what each action needs and gives, and chains actions" if stuck else ""

    def __init__(self, settings: PlansSettings, plan: Plan, library: Sequence[Node]) -> None:
        super().__init__(settings, plan, library)
        self.learner = Learner(plan.vocabulary)

    def plan_next(self, state: SearchState) -> GenerationPlan:
        """See `BreedingSearch`."""
        memory: PlansMemory = state.memory
        contents = super().plan_next(replace(state, memory=memory.racing))
        maker = PlanMaker(self.plan, self.models(memory), memory, contents.pick)
        stuck = bool(maker.unknown)
        share = self.settings.planned_stuck if stuck else self.settings.planned
        screen = Screen(self.plan.vocabulary, memory.visited)

        def propose(rng: np.random.Generator) -> Proposal | None:
            if rng.random() < share and (planned := maker.tree(rng)) is not None:
                return planned
            if contents.pick is None:
                return None
            for _ in range(CHILDREN):
                mother, fathers = contents.pick(rng)
                child = new_child(rng, mother, fathers, self.plan.space, self.settings.breeding)
                if not screen.neutral(child.tree, mother.tree):
                    break
            return child

        return replace(contents, propose=propose)

    def models(self, memory: PlansMemory) -> dict[str, ActionModel]:
        """The models of the actions, by text of the leaf; those never tried have declarations."""
        leaves = {head(leaf): leaf for leaf in all_leaves(self.plan.vocabulary)}
        leaves |= {t: parse(t, self.plan.vocabulary) for t in memory.actions if t not in leaves}
        return {
            text: self.learner.learn(text, leaf, memory.actions.get(text, ActionRecord()))
            for text, leaf in leaves.items()
        }

    def findings(self, memory: PlansMemory) -> list[str]:
        """See `Search`: a sentence for each action, those of one name together."""
        models = self.models(memory)
        return [models[text].sentence for text in sorted(memory.actions)]

    def update(self, state: SearchState, evaluated: Sequence[Evaluated]) -> PlansMemory:  # type: ignore[override] # another memory
        """See `BreedingSearch`."""
        before: PlansMemory | None = state.memory
        racing = super().update(
            replace(state, memory=None if before is None else before.racing), evaluated
        )
        actions = {} if before is None else before.actions
        samples = (sample for e in evaluated for sample in e.outcome.observed)
        visited = {} if before is None else dict(before.visited)
        for e in evaluated:
            known = [sample for sample in e.outcome.observed if sample.start]
            visited[digest(e.individual.tree)] = tuple(known[:MAX_SAMPLES])
        survivors = [digest(entry.tree) for entry in racing.entries]
        return PlansMemory(
            racing,
            recorded(actions, samples, self.plan.vocabulary),
            {name: visited[name] for name in survivors if name in visited},
        )


Made = tuple[Node, tuple[str, ...]]
"""A tree, and the ids of its parents."""

Maker = Callable[[np.random.Generator], Made | None]


class PlanMaker:
    """Makes trees from plans in one generation."""

    def __init__(
        self,
        plan: Plan,
        models: dict[str, ActionModel],
        memory: PlansMemory,
        pick: Pick | None,
    ) -> None:
        self.space, self.models, self.memory, self.pick = plan.space, models, memory, pick
        known = {text: m for text, m in models.items() if m.starts or m.gives}
        self.planner = Planner(plan.vocabulary, known)
        self.goals = [m for m in known.values() if m.points > 0]
        leaves = {head(leaf): leaf for leaf in all_leaves(plan.vocabulary)}
        self.unknown = {
            text: leaf
            for text, leaf in leaves.items()
            if not (text in known and known[text].understood)
        }
        self.reachable = self.planner.reachable()
        self.learner = Learner(plan.vocabulary)
        self.small = small_world(plan.vocabulary)

    def tree(self, rng: np.random.Generator) -> Proposal | None:
        """A tree from a plan, or None if none could be made."""
        makers: dict[str, Maker] = {"probe": self.probe} if self.unknown else {}
        if self.pick is not None or self.goals:
            makers["achieve"] = self.achieve
        if self.pick is not None:
            makers |= {"repair": self.repair, "maintain": self.maintain}
        if self.small:
            makers["policy"] = self.policy
        weights = dict.fromkeys(makers, 1.0)
        if "probe" in makers and not self.goals:  # nothing earns points yet
            weights["probe"] = PROBE_WEIGHT
        if self.small:  # as often as all others together
            weights["policy"] = float(len(makers))
        for _ in range(TRIES if makers else 0):
            name = weighted(rng, weights)
            if (proposal := makers[name](rng)) is None:
                continue
            tree, parents = proposal
            tree = simplify(self.space.repaired(tree), self.space.vocabulary).tree
            if within(tree, self.space.limits):
                origin = Origin.COPY if parents else Origin.RANDOM
                return Proposal(tree, origin, parents, name)
        return None

    def _mother(self, rng: np.random.Generator) -> tuple[Node | None, tuple[str, ...]]:
        if self.pick is None:
            return None, ()
        mother, _ = self.pick(rng)
        return mother.tree, (mother.id,)

    def achieve(self, rng: np.random.Generator) -> Made | None:
        """A plan for an action that earns points, before the branches of a mother that fit."""
        if not self.goals:
            return None
        points = np.array([goal.points for goal in self.goals])
        goal = self.goals[int(rng.choice(len(self.goals), p=points / points.sum()))]
        mother, parents = self._mother(rng)
        return self._in_front(rng, self.planner.plan(rng, goal), mother, goal.leaf), parents

    def policy(self, rng: np.random.Generator) -> Made | None:
        """The best policy of a small world."""
        optimistic = rng.random() < OPTIMISTIC
        tree = best_policy(self.memory.actions, self.space.vocabulary, optimistic=optimistic)
        return None if tree is None else (tree, ())

    def maintain(self, rng: np.random.Generator) -> Made | None:
        """A plan for an action that moves a number, when it is low (or high)."""
        options = [
            (model, key, up)
            for model in self.planner.models.values()
            for key, up in (model.raises or {}).items()
        ]
        mother, parents = self._mother(rng)
        if not options or mother is None:
            return None
        model, key, up = options[rng.integers(len(options))]
        of = self.space.vocabulary.keys[key]
        share = rng.uniform(0.15, 0.6)
        level = of.low + (share if up > 0 else 1 - share) * (of.high - of.low)
        level = round(of.low + round((level - of.low) / of.step) * of.step, 9) + 0.0
        due = Condition(key, "<" if up > 0 else ">", level)
        rules = [*self.planner.before(rng, model.needs, (due,), ()), Rule((due,), model.leaf)]
        return self._in_front(rng, rules, mother, None), parents

    def repair(self, rng: np.random.Generator) -> Made | None:
        """A mother with the achievers of an action's needs before that action."""
        mother, parents = self._mother(rng)
        if mother is None:
            return None
        needy = []
        for i, node in enumerate(walk(mother)):
            if node.action:
                text = head(without_numbers(node, self.space.vocabulary))
                if (model := self.planner.models.get(text)) and model.needs:
                    needy.append((i, node, model))
        if not needy:
            return None
        i, node, model = needy[rng.integers(len(needy))]
        rules = self.planner.before(rng, model.needs, (), ())
        if not rules:
            return None
        children = [*branches(rules, self._abort(rng)), node]
        return replace_at(mother, i, selector(*children)), parents

    def probe(self, rng: np.random.Generator) -> Made | None:
        """A plan for conditions in which unknown actions were tried least, and these actions."""
        names = list(self.unknown)
        chosen = [names[k] for k in rng.permutation(len(names))[:PROBED]]
        conditions: list[Condition] = []
        if chosen[0] in self.planner.models:  # it succeeded, but from few states
            conditions += self.planner.models[chosen[0]].needs
            if self.reachable and rng.random() < OTHER_STATE:
                conditions.append(self.reachable[rng.integers(len(self.reachable))])
        elif self.reachable:
            conditions += self._least_tried(rng, chosen[0])
        rules = self.planner.before(rng, conditions, (), ())
        rules += [Rule((), self.unknown[text]) for text in chosen]
        nodes = list(branches(rules, self._abort(rng)))
        return (selector(*nodes) if len(nodes) > 1 else nodes[0]), ()

    def _least_tried(self, rng: np.random.Generator, text: str) -> list[Condition]:
        """Of some conjunctions, the one in which an action was tried in the fewest cells."""
        cells = self.memory.actions.get(text, ActionRecord()).failures
        boards = np.array([cell.start for cell in cells]) if cells else None
        best: tuple[float, list[Condition]] | None = None
        for _ in range(CONJUNCTIONS):
            n = min(len(self.reachable), int(rng.integers(1, 4)))
            picked = [self.reachable[k] for k in rng.permutation(len(self.reachable))[:n]]
            if len({term.key for term in picked}) < n:
                continue
            tried = 0.0
            if boards is not None:
                holds = [self.learner.holds(term, boards) for term in picked]
                tried = float(np.sum(np.logical_and.reduce(holds)))
            cost = tried + 0.1 * n + 0.2 * rng.random()
            if best is None or cost < best[0]:
                best = cost, picked
        return best[1] if best else []

    def _abort(self, rng: np.random.Generator) -> str:
        return "none" if rng.random() < 0.7 else "both"

    def _in_front(
        self,
        rng: np.random.Generator,
        rules: Sequence[Rule],
        mother: Node | None,
        last: Node | None,
    ) -> Node:
        """The rules as the first branches of a selector, and those of the mother that fit."""
        nodes = list(branches(rules, self._abort(rng)))
        limits: Limits = self.space.limits
        if mother is not None:
            is_list = kind_of(mother).advance_status == FAILURE
            for branch in mother.children if is_list else (mother,):
                if branch in nodes:
                    continue
                if within(selector(*nodes, branch), limits):
                    nodes.append(branch)
        elif last is not None:
            nodes.append(last)
        return selector(*nodes) if len(nodes) > 1 else nodes[0]
