"""`search=decision_list`: lists with sums of keys, by CMA-ES."""

from __future__ import annotations

import re
from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest

from islandgp.bt.core.arithmetic import Formula
from islandgp.bt.core.condition import Condition, condition
from islandgp.bt.core.language import parse, to_text
from islandgp.bt.core.node import FAILURE, RUNNING, SUCCESS, asked_in
from islandgp.bt.core.parameters import real
from islandgp.bt.core.vocabulary import Action, Vocabulary, flag, number
from islandgp.gp.population import Origin
from islandgp.plain import from_json, to_json
from islandgp.search.base import SearchState
from islandgp.seeding import Streams
from islandgp_numbers.decision_list import Lists, groups_of, orders_of
from tests.search.searches import NO_ADVICE, evaluated, search_and_plan

VOCABULARY = Vocabulary(
    "lander",
    {name: Action("", frozenset({SUCCESS}), uses=("engine",)) for name in ("Left", "Main", "Rest")},
    {
        "height": number("", 0, 2),
        "climb": number("", -10, 10),
        "legs": flag(""),
        "angle": number("", -1, 1),
    },
)

GROUPS = groups_of(VOCABULARY)


def lists() -> Lists:
    return Lists(VOCABULARY, next(orders_of(GROUPS, [moves[-1] for moves in GROUPS])))


def test_a_list_is_in_canonical_form() -> None:
    """Keys are scaled to [-1, 1]; of a guard the largest weight is 1, in the vocabulary's order."""
    numbers = np.array([0.5, 2.0, -0.1, 5.0, -1.0, 0.0, 0.001, 2.5])
    assert to_text(lists().tree(numbers, 2)) == (
        "selector {\n"
        "  when height + 0.4 * climb - 0.2 * angle > 2 { Left }\n"
        "  when height < 0.75 { Main }\n"
        "  Rest\n"
        "}\n"
    )


def test_a_tree_does_what_the_numbers_say() -> None:
    """With all digits, a guard holds where its scaled sum is above its offset."""
    rng, made = np.random.default_rng(0), lists()
    for _ in range(50):
        numbers, board = rng.normal(size=made.size), rng.uniform([0, -10, 0, -1], [2, 10, 1, 1])
        (first, _, _) = made.tree(numbers, 15).children
        scaled = np.array([board[0] - 1, board[1] / 10, board[3]])
        assert first.guard is not None
        holds = condition(first.guard.condition, board.tolist(), VOCABULARY.key_index)()
        assert holds == (numbers[:3] @ scaled > 0.1 * numbers[3])


def test_orders_and_groups() -> None:
    """The default is last, so 6 orders are 2; resources and extremes make lists of their own."""
    assert len([*orders_of(GROUPS, [GROUPS[0][-1]])]) == 2
    torque = {"torque": real("", -1, 1, default=1)}
    swimmer = Vocabulary(
        "swimmer",
        {
            n: Action("", frozenset({SUCCESS}), arguments=torque, uses=(n,))
            for n in ("Front", "Rear")
        },
        VOCABULARY.keys,
    )
    groups = groups_of(swimmer)
    assert [[to_text(move).strip() for move in moves] for moves in groups] == [
        ["Front(torque: -1)", "Front"],
        ["Rear(torque: -1)", "Rear"],
    ]
    tree = Lists(swimmer, next(orders_of(groups, [moves[-1] for moves in groups]))).tree(
        np.ones(8), 2
    )
    assert parse(to_text(tree), swimmer) == tree
    assert [tree.kind, *(child.kind for child in tree.children)] == ["sequence", *["selector"] * 2]
    both = Vocabulary("both", {n: Action("", frozenset({FAILURE, RUNNING})) for n in "AB"}, {})
    assert len(groups_of(both)) == 1


def error(tree: Any, truth: Condition) -> float:
    """The share of blackboards on which the first guard differs from the truth."""
    rng = np.random.default_rng(1)
    boards = rng.uniform([-2.4, -3, -0.2, -3], [2.4, 3, 0.2, 3], (200, 4)).tolist()
    index = {name: at for at, name in enumerate(("position", "speed", "angle", "turning"))}
    return sum(
        condition(tree.children[0].guard.condition, b, index)() != condition(truth, b, index)()
        for b in boards
    ) / len(boards)


def generations(search: Any, plan: Any) -> Iterator[tuple[Any, list[float]]]:
    """All generations of a search that earns points for the truth."""
    truth = Condition("angle", ">", 0.05)
    state = search.start()
    for _ in range(plan.gp.generations):
        individuals = tuple(search.ask(state, Streams(3)))
        fitness = [-error(i.tree, truth) for i in individuals]
        yield individuals, fitness
        told = [evaluated(i.id, f) for i, f in zip(individuals, fitness, strict=True)]
        state = search.tell(state, told, NO_ADVICE)
        state = SearchState(state.generation, from_json(search.Memory, to_json(state.memory)))


def test_it_finds_the_guard_prunes_it_and_confirms_it() -> None:
    """Numbers get better, guards have few keys and digits in the end, the last trees are elites."""
    wide = ("domain=cartpole", "gp.population=10", "gp.generations=40", "search.policy.keys=2")
    search, plan = search_and_plan("decision_list", *wide)
    steps = [*generations(search, plan)]
    assert max(steps[0][1]) < max(steps[-1][1])
    assert max(steps[-1][1]) > -0.06
    for individual in steps[-1][0]:
        (term,) = asked_in(individual.tree)
        assert len(term.keys) <= 2
        text = str(term.key) if isinstance(term.key, Formula) else term.key
        assert all(len(word.strip("0.-")) <= 2 for word in text.split() if word[0].isdigit())
        assert individual.origin == Origin.ELITE
    assert [i.tree for i in steps[-1][0]] == [i.tree for i in steps[-2][0]]


def test_the_best_single_action_ends_every_list() -> None:
    """The first generation is the four actions of LunarLander alone; the lists are tried next."""
    search, _ = search_and_plan("decision_list", "domain=lunarlander", "gp.generations=30")
    state = search.start()
    actions = search.ask(state, Streams(1))
    names = sorted(to_text(i.tree).strip() for i in actions)
    assert names == ["FireLeft", "FireMain", "FireRight", "Rest"]
    told = [evaluated(i.id, -float(to_text(i.tree) != "FireMain\n")) for i in actions]
    state = search.tell(state, told, NO_ADVICE)
    orders = set()
    for _ in range(4):
        individuals = search.ask(state, Streams(1))
        orders |= {tuple(re.findall("Fire[A-Z][a-z]+|Rest", to_text(i.tree))) for i in individuals}
        state = search.tell(state, [evaluated(i.id) for i in individuals], NO_ADVICE)
    assert {order[-1] for order in orders} == {"FireMain"}
    assert len(orders) == 4


def test_what_it_needs() -> None:
    """One line for a domain without numbers or choices, and for phases that overlap."""
    from islandgp.errors import ConfigError

    for overrides, message in (
        (("search.policy.pruning=0.1",), "expected screening <= pruning"),
        (("search.policy.finals=0.8",), "screening \\+ finals below 1"),
        (
            ("gp.max_nodes=3", "gp.trees.children=[1,3]"),
            "expected a list of all actions within gp.max_nodes",
        ),
    ):
        with pytest.raises(ConfigError, match=message):
            search_and_plan("decision_list", "domain=cartpole", *overrides)
