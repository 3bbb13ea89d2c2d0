"""Plans from learned models of actions: guarded priority lists by backchaining.

For each unmet condition of an action its achiever comes before it, recursively, as in Colledanchise
and Ogren's PA-BT (Colledanchise, Almeida and Ogren 2019, arXiv 1611.00230). A plan is a flat list
of rules: the first rule whose guard holds acts.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Final, NamedTuple

import numpy as np

from islandgp.bt.core.condition import OPPOSITE, Condition, combine
from islandgp.bt.core.node import Node, guarded
from islandgp.bt.core.vocabulary import Vocabulary
from islandgp_plans.action_models import ActionModel

MAX_LEVELS: Final = 8  # of achievers for needs of achievers
MAX_RULES: Final = 40

Context = tuple[Condition, ...]


class Rule(NamedTuple):
    """An action and when it is due, unless an earlier rule is."""

    when: Context
    leaf: Node


def negation(term: Condition) -> Condition:
    """The opposite of a single condition, as a single condition."""
    return term._replace(operator=OPPOSITE[term.operator])


@dataclass(frozen=True)
class Planner:
    """Plans from models of actions."""

    vocabulary: Vocabulary
    models: Mapping[str, ActionModel]  # those that have succeeded

    def plan(self, rng: np.random.Generator, goal: ActionModel) -> list[Rule]:
        """Rules that lead to the start of an action, and the action when it can succeed."""
        rules = self.before(rng, goal.needs, (), (), goal.facts)
        return [*rules, Rule(tuple(goal.needs), goal.leaf)]

    def before(
        self,
        rng: np.random.Generator,
        needs: Sequence[Condition],
        context: Context,
        pursued: tuple[Condition, ...],
        facts: Collection[Condition] = (),
    ) -> list[Rule]:
        """Rules that make the conditions true, in an order that keeps what was reached.

        Args:
            rng: the generator is consumed.
            needs: the conditions.
            context: conditions under which the rules are due.
            pursued: conditions that hold already or that earlier rules make true.
            facts: conditions that hold wherever all needs do. As soon as the earlier needs are met,
                those on the same keys are taken as met.
        """
        open_needs = [n for n in needs if n not in context and n not in pursued]
        rules: list[Rule] = []
        keys: set[str] = set()
        for need in self.ordered(rng, open_needs, pursued, facts):
            met = tuple(fact for fact in facts if set(fact.keys) <= keys)
            rules += self.achieve(rng, need, context, (*pursued, *met))
            pursued = (*pursued, need)
            keys |= set(need.keys)
        return rules

    def achieve(
        self,
        rng: np.random.Generator,
        need: Condition,
        context: Context,
        pursued: tuple[Condition, ...],
    ) -> list[Rule]:
        """Rules that make one condition true; [] if no action is known to."""
        if len(context) >= MAX_LEVELS or need in pursued:
            return []
        options = self.achievers(need)
        if not options:
            return []
        unmet: Context = (*context, negation(need))
        below = (*pursued, need)
        ways = list(dict.fromkeys(extra for extra, _ in options))
        if () in ways:  # an action that reaches it from everywhere
            options = [o for o in options if o[0] == ()]
            weights = np.array([1.0 + model.succeeded for _, model in options]) ** 0.5
            chosen = [options[int(rng.choice(len(options), p=weights / weights.sum()))]]
        else:  # one for each word
            chosen = [next(o for o in options if o[0] == way) for way in ways]
        common = [n for n in chosen[0][1].needs if all(n in m.needs for _, m in chosen)]
        facts = chosen[0][1].facts if len(chosen) == 1 else ()
        rules = self.before(rng, common, unmet, below, facts)
        for extra, model in chosen:
            own = [n for n in model.needs if n not in common]
            rules += self.before(rng, own, (*unmet, *extra), below)
            rules.append(Rule((*unmet, *extra), model.leaf))
        return rules

    def achievers(self, need: Condition) -> list[tuple[Context, ActionModel]]:
        """Actions that make a condition true, each with a condition under which it does."""
        found: list[tuple[Context, ActionModel]] = [
            ((), model) for model in self.models.values() if self._gives(model, need)
        ]
        if found or not need.other or need.operator != "==":
            return found
        for key, other in ((need.key, need.other), (need.other, need.key)):
            found = [
                ((given._replace(key=other),), model)
                for model in self.models.values()
                for given in model.gives
                if given.key == key and given.operator == "==" and not given.other
            ]
            if found:
                break
        return found

    def _gives(self, model: ActionModel, need: Condition) -> bool:
        return any(implies(given, need) for given in model.gives) or self._number_moves(model, need)

    def _number_moves(self, model: ActionModel, need: Condition) -> bool:
        up = (model.raises or {}).get(need.key, 0)
        return not need.other and up == {">": 1, ">=": 1, "<": -1, "<=": -1}.get(need.operator)

    def ordered(
        self,
        rng: np.random.Generator,
        needs: Sequence[Condition],
        pursued: tuple[Condition, ...],
        facts: Collection[Condition],
    ) -> list[Condition]:
        """The conditions in an order in which reaching one seldom destroys those before it."""
        met = {*pursued, *needs, *facts}
        moved = {need: self._touched(need, met - {need}) for need in needs}
        left, order = list(needs), []
        while left:
            # The first destroys others, and others do not destroy it.
            costs = [
                0.5 * rng.random()
                + sum(
                    bool(moved[other] & {*n.keys}) - bool(moved[n] & {*other.keys})
                    for other in left
                    if other != n
                )
                for n in left
            ]
            order.append(left.pop(int(np.argmin(costs))))
        return order

    def _touched(self, need: Condition, met: Collection[Condition]) -> set[str]:
        """Keys that change on the way to a condition if others are met, recursively."""
        touched: set[str] = set()
        todo, seen = [need], set(met)
        while todo:
            goal = todo.pop()
            if goal in seen:
                continue
            seen.add(goal)
            for _, model in self.achievers(goal):
                touched |= model.changes
                todo += model.needs
        return touched

    def reachable(self) -> list[Condition]:
        """The conditions that some action is known to make true."""
        terms = {given: None for model in self.models.values() for given in model.gives}
        words: dict[str, set[float]] = {}
        for term in terms:
            if term.operator == "==" and not term.other:
                words.setdefault(term.key, set()).add(term.number)
        for key, values in words.items():
            if len(values) > 1:
                for other in self.vocabulary.comparable(key):
                    a, b = sorted((key, other))
                    terms[Condition(a, "==", 0.0, b)] = None
        return list(terms)


def implies(given: Condition, need: Condition) -> bool:
    """True if a known effect makes a condition true: it is the same, or another word."""
    if given == need:
        return True
    same = given.key == need.key and not given.other and not need.other
    return same and given.operator == "==" and need.operator == "!=" and given.number != need.number


def branches(rules: Sequence[Rule], abort: str) -> Iterator[Node]:
    """The rules as children of a selector; the same rule twice counts once."""
    for rule in dict.fromkeys(rules):
        terms = tuple(dict.fromkeys(rule.when))
        yield guarded(combine("and", terms), rule.leaf, abort) if terms else rule.leaf
