"""A simplified tree does the same as the original: rule by rule, on scripts, and on the island."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable

import pytest
from hypothesis import HealthCheck, given
from hypothesis import strategies as st

from islandgp.bt.analysis.simplify import simplify
from islandgp.bt.core.engine import ABORTED, compile_tree
from islandgp.bt.core.language import parse, to_text
from islandgp.bt.core.node import FAILURE, RUNNING, SUCCESS, Node, size, walk
from islandgp.bt.core.printer import condition_text
from islandgp.domains.island.vocabulary import VOCABULARY
from tests.bt.stage import short_tree
from tests.composed import composed
from tests.profiles import examples
from tests.strategies import few_boards, few_numbers, nodes
from tests.trees.worlds import Trace, island_trace, random_trees

TREES = nodes(few_numbers(), max_leaves=14, max_repeats=3, pairs=True)
BOARDS = st.lists(few_boards(), min_size=2, max_size=14)
RESULTS = st.lists(st.sampled_from([FAILURE, SUCCESS, RUNNING, RUNNING]), min_size=1, max_size=40)


def trace(tree: Node, boards: list[list[float]], results: list[int]) -> Trace:
    """What a tree does on these boards: per tick its calls, what it aborts, and its status.

    An action takes the next result, or if it can't return that one, RUNNING or SUCCESS.
    """
    board = list(boards[0])
    leaves = {i: n.action for i, n in enumerate(walk(tree)) if n.action}
    calls: list[tuple[str, bool, int]] = []
    aborted: list[str] = []
    count = 0

    def action(name: str) -> Callable[[bool], int]:
        can = VOCABULARY.action(name).statuses

        def act(fresh: bool) -> int:
            nonlocal count
            status = results[count % len(results)]
            count += 1
            if status not in can:
                status = RUNNING if RUNNING in can else SUCCESS
            calls.append((name, fresh, status))
            return status

        return act

    def watch(place: int, status: int) -> None:
        if status == ABORTED and place in leaves:
            aborted.append(leaves[place])

    actions = {name: action(name) for name in leaves.values()}
    tick = compile_tree(tree, actions, board, VOCABULARY.key_index, watch=watch, step_s=1.0)
    ticks: Trace = []
    for values in boards:
        board[:] = values
        status = min(tick(), RUNNING)  # AGAIN is RUNNING
        # Aborts of one tick come in document order per subtree, so their order is not compared.
        ticks.append((tuple(calls), tuple(sorted(aborted)), status))
        calls.clear()
        aborted.clear()
    return ticks


@examples(max_examples=500, deadline=None, suppress_health_check=[HealthCheck.too_slow])
@given(tree=TREES, boards=BOARDS, results=RESULTS)
def test_same_trace_on_scripts(tree: Node, boards: list[list[float]], results: list[int]) -> None:
    """Any tree and its simplified form call the same actions, abort the same, end the same."""
    short = simplify(tree, VOCABULARY).tree
    assert trace(short, boards, results) == trace(tree, boards, results)


@examples(max_examples=200, deadline=None)
@given(tree=TREES)
def test_simplifying_twice_changes_nothing(tree: Node) -> None:
    """The simplified tree is never larger, is in the language, and is its own simplified form."""
    short, reasons = simplify(tree, VOCABULARY)
    assert size(short) <= size(tree)
    assert _length(short) <= _length(tree)
    assert (short != tree) == bool(reasons)
    assert simplify(short, VOCABULARY) == (short, ())
    assert parse(to_text(short)) == short


def _length(tree: Node) -> int:
    """The number of nodes, and of words in guards."""
    guards = [node.guard for node in walk(tree) if node.guard]
    words = [len(condition_text(each.condition).split()) for each in guards]
    return size(tree) + sum(words) + 2 * sum(each.abort != "both" for each in guards)


RULES = {
    "a part of a condition that the others decide": (
        "when p and (p or q) and not x < 3 { A }",
        "when p and x >= 3 { A }",
    ),
    "a part that a guard above decides": (
        "when p { selector { when p and q abort self { A } B } }",
        "when p { selector { when q abort self { A } B } }",
    ),
    "a part that was true at the start only": (
        "when p abort none { selector { when p and q abort self { A } B } }",
        "when p abort none { selector { when p and q abort self { A } B } }",
    ),
    "double inverter": ("inverter { inverter { A } }", "A"),
    "one child": ("selector { sequence { A } B }", "selector { A B }"),
    "one child keeps its guard from being observed": (
        "selector { sequence { when p { A } } B }",
        "selector { when p abort self { A } B }",
    ),
    "one child in the last place": (
        "selector { B sequence { when p { A } } }",
        "selector { B when p { A } }",
    ),
    "selector in a selector": (
        "selector { A selector { B when p { D } } }",
        "selector { A B when p { D } }",
    ),
    "not last, with a guard that would be observed for longer": (
        "selector { selector { when p { B } D } A }",
        "selector { selector { when p { B } D } A }",
    ),
    "not last, without such a guard": (
        "selector { selector { B when p { D } } A }",
        "selector { B when p abort self { D } A }",
    ),
    "behind what never fails": ("selector { when p { A } G B }", "selector { when p { A } G }"),
    "behind what never succeeds": (
        "sequence { when x < 1 { when x > 2 { A } } B }",
        "when x < 1 { when x > 2 { A } }",
    ),
    "a branch that never does anything": (
        "selector { when x < 1 abort self { when x > 2 abort self { A } } B }",
        "B",
    ),
    "a guard that can't hold but can call back stays": (
        "selector { when x < 1 { when x > 2 abort self { A } } B E }",
        "selector { when x < 1 { when x > 2 abort self { A } } B E }",
    ),
    "repeater 1": ("repeater 1 { A }", "A"),
    "repeaters multiply": ("repeater 3 { repeater 4 { A } }", "repeater 12 { A }"),
    "repeaters multiply up to 100": ("repeater 11 { repeater 10 { A } }",) * 2,
    "a guard twice": ("when p abort none { when p abort self { A } }", "when p { A }"),
    "what the branches before exclude": (
        "selector { when x > 1 { G } when x > 2 { A } when x > 1 { B } D }",
        "selector { when x > 1 { G } D }",
    ),
    "what the branches before leave": (
        "selector { when p { G } when not p { C } A }",
        "selector { when p { G } C }",
    ),
    "a guard that only tests at its start excludes nothing later on": (
        "selector { when p abort none { G } when p { A } D }",
    )
    * 2,
    "a guard above what may fail excludes nothing": ("selector { when p { A } when p { E } D }",)
    * 2,
    "an action that ends in a tick leaves its guard true in this tick": (
        "sequence { when p { B } when not p { A } D }",
        "sequence { when p { B } when not p { A } }",
    ),
    "an action that runs does not": ("sequence { when p abort lower { A } when not p { D } }",) * 2,
    "reactive children follow each other in a tick": (
        "reactive_selector { when p abort none { G } when p { A } D }",
        "reactive_selector { when p abort none { G } D }",
    ),
    "abort self above what ends at once": ("when p abort self { B }", "when p { B }"),
    "abort none above what ends at once": ("when p abort none { B }", "when p { B }"),
    "abort none above what runs": ("when p abort none { A }",) * 2,
    "abort lower without a later branch": (
        "selector { D when p abort lower { A } }",
        "selector { D when p abort none { A } }",
    ),
    "abort lower with a later branch": ("selector { when p abort lower { A } D }",) * 2,
    "a guard that follows": ("when x < 1 { when x < 2 { A } }", "when x < 1 { A }"),
    "a guard that follows, but observed": ("selector { when x < 1 { when x < 2 { A } } B }",) * 2,
    "a guard that follows, further in": (
        "when x < 1 { sequence { A when x < 2 { B } } }",
        "when x < 1 { sequence { A B } }",
    ),
    "a guard that held at the start only": (
        "when x < 1 abort none { sequence { A when x < 2 { B } } }",
    )
    * 2,
    "a condition that always holds": ("when x >= 0 { A }", "A"),
}


@pytest.mark.parametrize("name", RULES)
def test_rule(name: str) -> None:
    """Each rule rewrites its example as documented, and not where the meaning would change."""
    before, after = RULES[name]
    assert simplify(short_tree(before), VOCABULARY).tree == short_tree(after)


@pytest.mark.parametrize(
    ("operator", "simplified"),
    [("<", "< 2"), ("<=", "<= 1"), (">", "> 1"), (">=", ">= 2"), ("==", ""), ("!=", "always")],
)
def test_thresholds_of_whole_numbers_are_rounded(operator: str, simplified: str) -> None:
    """The rounded comparison has the same value for each whole number."""
    tree = parse(
        f"selector {{ when lap {operator} 1.5 {{ MoveToGarbage }} SeekCharger }}", VOCABULARY
    )
    text = " ".join(to_text(simplify(tree, VOCABULARY).tree).split())
    if simplified in ("", "always"):
        assert "lap" not in text
        assert ("MoveToGarbage" in text) == bool(simplified)
    else:
        assert f"when lap {simplified} {{" in text


@pytest.mark.slow
def test_on_the_island() -> None:
    """Random trees and their simplified forms do the same, tick by tick, in two worlds."""
    assert _compare(trees=16, worlds=2, seconds=60) >= 3


@pytest.mark.slow
def test_500_trees_on_five_worlds() -> None:
    """500 random trees and their simplified forms do the same on five worlds, whole episodes."""
    assert _compare(trees=500, worlds=5, seconds=420) >= 100


def _compare(*, trees: int, worlds: int, seconds: float) -> int:
    """How many of the random trees became shorter; fails where one behaves differently."""
    island = composed()
    shorter: Counter[bool] = Counter()
    for tree in random_trees(island, trees):
        short, reasons = simplify(tree, VOCABULARY)
        shorter[bool(reasons)] += 1
        for seed in range(worlds) if reasons else ():
            expected = island_trace(island, tree, seed, seconds)
            assert island_trace(island, short, seed, seconds) == expected, to_text(tree)
    return shorter[True]
