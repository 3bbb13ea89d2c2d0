"""What `check` and `simplify` conclude from earlier siblings is true of the engine."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

import numpy as np
import pytest

from islandgp.bt.analysis.context import (
    NodeContext,
    child_contexts,
    end_facts,
    ends_at_once,
    root_context,
)
from islandgp.bt.analysis.lint import warnings
from islandgp.bt.analysis.simplify import simplify
from islandgp.bt.core.condition import WHOLE, Condition, ConditionExpr, combine, condition, terms
from islandgp.bt.core.engine import ABORTED, compile_tree
from islandgp.bt.core.kinds import ABORTS
from islandgp.bt.core.language import to_text
from islandgp.bt.core.node import (
    RUNNING,
    CountArgs,
    Node,
    ParallelArgs,
    SecondsArgs,
    guarded,
    leaf,
    size,
)
from islandgp.domains.island.vocabulary import VOCABULARY
from tests.profiles import cases
from tests.trees.test_simplify import trace

TICKS = 25


def pick(rng: np.random.Generator, options: list[str]) -> str:
    return options[int(rng.integers(len(options)))]


def random_term(rng: np.random.Generator) -> Condition:
    if rng.random() < 0.4:
        return Condition("foundGarbage", pick(rng, ["is", "not"]), 0.0)
    return Condition(
        "lap", pick(rng, ["<", "<=", ">", ">=", "==", "!="]), float(rng.integers(1, 4))
    )


def random_tree(rng: np.random.Generator, depth: int) -> Node:
    """A tree of composites and guards on two keys, with some of each other kind."""
    if depth <= 1 or rng.random() < 0.2:
        return leaf(pick(rng, [*VOCABULARY.actions]))
    draw, child = rng.random(), partial(random_tree, rng, depth - 1)
    if draw < 0.4:
        expr: ConditionExpr = random_term(rng)
        if rng.random() < 0.2:
            expr = combine(pick(rng, ["and", "or"]), [expr, random_term(rng)])
        return guarded(expr, child(), pick(rng, [*ABORTS]))
    if draw < 0.8:
        kinds = ["selector"] * 4 + ["sequence"] * 2 + ["reactive_selector", "reactive_sequence"]
        return Node(pick(rng, kinds), (), tuple(child() for _ in range(rng.integers(2, 5))))
    if draw < 0.9:
        kind = pick(rng, ["inverter", "force_success", "force_failure", "until_failure"])
        return Node(kind, (), (child(),))
    if draw < 0.93:
        return Node(pick(rng, ["repeater", "retry"]), CountArgs(2.0), (child(),))
    if draw < 0.96:
        kinds = ["wait", "timeout", "cooldown", "every"]
        return Node(pick(rng, kinds), SecondsArgs(2.0), (child(),))
    kind = pick(rng, ["parallel", "pipeline", "round_robin"])
    args = ParallelArgs(pick(rng, ["one", "all"]), pick(rng, ["one", "all"]))
    return Node(kind, args if kind == "parallel" else (), (child(), child()))


def random_boards(rng: np.random.Generator) -> list[list[float]]:
    """A blackboard for each tick; few values change from one to the next."""
    board, boards = [50.0, 10.0, 0.0, 0.0, 0.0], list[list[float]]()
    lap, found = VOCABULARY.key_index["lap"], VOCABULARY.key_index["foundGarbage"]
    for _ in range(TICKS):
        if rng.random() < 0.5:
            board[lap] = float(rng.integers(5))
        if rng.random() < 0.3:
            board[found] = float(rng.integers(2))
        boards.append(list(board))
    return boards


def contexts_of(tree: Node, context: NodeContext) -> list[tuple[Node, NodeContext]]:
    """Each node with its context, in document order."""
    inner = zip(tree.children, child_contexts(tree, context), strict=True)
    return [(tree, context), *(each for child, here in inner for each in contexts_of(child, here))]


def check_facts(tree: Node, boards: list[list[float]], results: list[int]) -> None:
    """Fails where a node is ticked or ends on a blackboard that its context excludes."""
    places, board = contexts_of(tree, root_context(tree, VOCABULARY)), list(boards[0])
    running: set[int] = set()
    count = 0

    def holds(expr: ConditionExpr) -> bool:
        if any(term.operator == WHOLE for term in terms(expr)):
            return True
        return condition(expr, board, VOCABULARY.key_index)()

    def action(name: str) -> Callable[[bool], int]:
        statuses = sorted(VOCABULARY.action(name).statuses)

        def act(_: bool) -> int:
            nonlocal count
            count += 1
            return statuses[results[count % len(results)] % len(statuses)]

        return act

    def watch(place: int, status: int) -> None:
        node, context = places[place]
        fresh = place not in running
        running.discard(place)
        if status == ABORTED:
            return
        assert all(map(holds, context.at_start if fresh else context.always)), place
        if status >= RUNNING:
            running.add(place)
            assert not ends_at_once(node, context), place
        else:
            facts = end_facts(node, context, status)
            assert facts is not None, place
            assert all(map(holds, facts)), place

    actions = {name: action(name) for name in VOCABULARY.actions}
    tick = compile_tree(tree, actions, board, VOCABULARY.key_index, watch=watch, step_s=1.0)
    for values in boards:
        board[:] = values
        tick()


def compare(seed: int) -> tuple[bool, bool]:
    """Fails where the analysis of a random tree is wrong.

    Returns:
        Whether `check` reports a branch that never runs, and whether
        `simplify` makes the tree shorter.
    """
    rng = np.random.default_rng(seed)
    tree = random_tree(rng, int(rng.integers(3, 6)))
    short = simplify(tree, VOCABULARY).tree
    for _ in range(3):
        boards = random_boards(rng)
        results = [int(each) for each in rng.integers(0, 6, size=41)]
        check_facts(tree, boards, results)
        assert trace(short, boards, results) == trace(tree, boards, results), to_text(tree)
    found = warnings(to_text(tree), VOCABULARY)
    reported = any(w.code == "unreachable" for w in found)
    return reported, size(short) < size(tree)


def test_facts_are_true_of_the_engine() -> None:
    """Thousands of random trees, tick by tick, on changing blackboards and results of actions.

    Each node is ticked and ends only where its context allows it, so no branch that is reported as
    never running ever runs; and a simplified tree calls and aborts the same actions.
    """
    found = [compare(seed) for seed in range(cases(1500))]
    reported, shorter = (sum(column) for column in zip(*found, strict=True))
    assert reported > len(found) / 50
    assert shorter > len(found) / 50


@pytest.mark.slow
def test_facts_of_many_trees_are_true_of_the_engine() -> None:
    """The same for other trees."""
    for seed in range(10**6, 10**6 + 20_000):
        compare(seed)
