"""Operators on guarded branches: what each promises for any tree, any words and any limits."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from dataclasses import replace
from math import floor, log10, pi

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from islandgp.bt.core.condition import combine, terms
from islandgp.bt.core.kinds import ABORTS
from islandgp.bt.core.language import parse, to_text
from islandgp.bt.core.node import (
    Limits,
    Node,
    asked_in,
    depth,
    guard_of,
    leaf,
    replace_at,
    size,
    walk,
    within,
)
from islandgp.bt.core.vocabulary import Action, Vocabulary, number
from islandgp.domains.island.vocabulary import VOCABULARY
from islandgp.gp import branches
from islandgp.gp.branches import branch_crossover, branches_of, fine, random_list
from islandgp.gp.random_trees import TreeSpace
from islandgp.gp.variation import MUTATIONS, MutationSettings, mutate
from tests.composed import composed
from tests.profiles import cases, examples
from tests.strategies import few_boards, nodes
from tests.trees.test_simplify import trace

LIMITS = Limits(max_depth=8, max_nodes=50)
TREES = nodes(max_leaves=14)
SEEDS = st.integers(0, 2**32 - 1)
NEW = ("guard", "wrap", "extend", "condition", "fulfil", "tune")
SPACE = TreeSpace(composed().gp.trees, VOCABULARY, LIMITS)
SETTINGS = composed().gp.mutation

BARE = {name: Action(action.meaning) for name, action in VOCABULARY.actions.items()}
BLIND = Vocabulary("blind", BARE, {})
LONELY = Vocabulary("lonely", {"Wait": Action("waits")}, VOCABULARY.keys)
ODD = Vocabulary(
    "odd",
    {"Wait": Action("waits")},
    {
        "angle": number("an angle", -pi, pi, step=pi / 7),
        "tiny": number("a small number", 1e-6, 3e-6, step=1e-7),
        "large": number("a large number", -5e5, 1e6, step=1e3),
    },
)
VOCABULARIES = {v.domain: v for v in (VOCABULARY, BLIND, LONELY, ODD)}


def changed(operator: str, tree: Node, seed: int, space: TreeSpace = SPACE) -> Node:
    """What an operator itself makes of a tree, before limits are looked at."""
    return MUTATIONS[operator](np.random.default_rng(seed), tree, space, SETTINGS)


def places(tree: Node) -> Iterator[tuple[int, Node]]:
    """Each node with its number."""
    return iter(enumerate(walk(tree)))


def check_names(tree: Node, vocabulary: Vocabulary) -> None:
    """A tree is in the language, and uses declared words alone."""
    assert parse(to_text(tree), vocabulary) == tree


def test_all_are_tried_here() -> None:
    """Every mutation of this module is in the table, and in these tests."""
    names = {name for name, call in MUTATIONS.items() if call.__module__ == branches.__name__}
    assert names == set(NEW)


LISTS = ("selector", "reactive_selector")


@pytest.mark.parametrize("operator", NEW)
@examples(max_examples=60)
@given(tree=TREES, seed=SEEDS)
def test_a_tree_with_declared_words(operator: str, tree: Node, seed: int) -> None:
    """What comes out reads back as the same tree, and the same seed gives the same tree."""
    new = changed(operator, tree, seed)
    check_names(new, VOCABULARY)
    assert changed(operator, tree, seed) == new


@examples(max_examples=200)
@given(tree=TREES, seed=SEEDS)
def test_guard_adds_one_branch(tree: Node, seed: int) -> None:
    """A selector has one guarded branch more, not as its last one; else a new selector is above."""
    new = changed("guard", tree, seed)
    if all(node.kind not in LISTS for node in walk(tree)):
        assert new.kind == "selector"
        assert new.children[1:] == (tree,)
        assert new.children[0].kind == "when"
        return
    without = {
        replace_at(new, i, node._replace(children=node.children[:at] + node.children[at + 1 :])): b
        for i, node in places(new)
        if node.kind in LISTS and len(node.children) > 1
        for at, b in enumerate(node.children[:-1])
    }
    assert tree in without
    assert without[tree].kind == "when"


@examples(max_examples=150)
@given(tree=TREES, seed=SEEDS)
def test_wrap_puts_one_guard_above_a_node(tree: Node, seed: int) -> None:
    """Without that guard it is the tree that it was."""
    new = changed("wrap", tree, seed)
    assert size(new) == size(tree) + 1
    assert tree in [replace_at(new, i, node.children[0]) for i, node in places(new) if node.guard]


@examples(max_examples=150)
@given(tree=TREES, seed=SEEDS)
def test_extend_changes_one_action(tree: Node, seed: int) -> None:
    """Another action, or a sequence of actions, is in one's place, or beside it in a sequence."""
    assume(any(node.action for node in walk(tree)))
    new = changed("extend", tree, seed)
    restored = []
    for i, node in places(new):
        if node.action or actions_alone(node):
            restored += [replace_at(new, i, old) for old in walk(tree) if old.action]
        if node.kind == "sequence" and len(node.children) == 2:
            restored += [replace_at(new, i, child) for child in node.children]
    assert tree in restored


def actions_alone(node: Node) -> bool:
    """Whether the node is a sequence of actions, each behind one that it is declared to follow."""
    names = [child.action for child in node.children if child.action]
    if node.kind != "sequence" or len(names) != len(node.children):
        return False
    return all(
        any(name in VOCABULARY.action(later).after for later in names[at + 1 :])
        for at, name in enumerate(names[:-1])
    )


@examples(max_examples=200)
@given(tree=TREES, seed=SEEDS)
def test_condition_changes_one_guard(tree: Node, seed: int) -> None:
    """Another abort rule; a term more, less or another one; or the guard is gone."""
    new = changed("condition", tree, seed)
    guards = [(i, node) for i, node in places(tree) if node.guard]
    if not guards:
        assert new == tree
        return
    if size(new) < size(tree):
        assert new in [
            replace_at(tree, i, node.children[0])
            for i, node in guards
            if len(list(terms(guard_of(node).condition))) == 1
        ]
        return
    different = [(a, b) for a, b in zip(walk(tree), walk(new), strict=True) if a.args != b.args]
    assert len(different) <= 1  # none: the new term is the old one
    for old, other in different:
        assert old.kind == other.kind == "when"
        before, after = (Counter(terms(guard_of(n).condition)) for n in (old, other))
        if old.args[1] != other.args[1]:
            assert old.args[0] == other.args[0]
            assert other.args[1] in ABORTS
        else:
            assert (before - after).total() <= 1
            assert (after - before).total() <= 1


def test_condition_joins_no_more_terms_than_there_may_be() -> None:
    """Three at most, of what grows."""
    tree = parse("when foundGarbage { PatrolWaypoint }")
    counts = set()
    for seed in range(400):
        tree = changed("condition", tree, seed)
        if tree.kind != "when":
            tree = parse("when foundGarbage { PatrolWaypoint }")
        counts.add(len(list(terms(guard_of(tree).condition))))
    assert counts == {1, 2, 3}


@examples(max_examples=150)
@given(tree=TREES, seed=SEEDS)
def test_fulfil_asks_what_the_action_declares(tree: Node, seed: int) -> None:
    """The guard's condition is `to_start` and `to_succeed` of the action below it."""
    new = changed("fulfil", tree, seed)
    needy = {"MoveToGarbage", "PickupGarbage", "ExecuteCharge", "MoveToHumanoid"}
    needy |= {"DeliverToClearingPoint"}
    if not any(node.kind == "action" and node.args[0] in needy for node in walk(tree)):
        assert new == tree
        return
    [guard] = [
        node
        for i, node in places(new)
        if node.guard
        and node.children[0].kind == "action"
        and replace_at(new, i, node.children[0]) == tree
        and node.args == (_needed(str(node.children[0].args[0])), "none")
    ][:1]
    assert guard.children[0].args[0] in needy


def _needed(action: str) -> object:
    declared = VOCABULARY.action(action)
    conditions = list(dict.fromkeys((*declared.to_start, *declared.to_succeed)))
    return combine("and", conditions) if conditions else None


@pytest.mark.parametrize(
    ("action", "guard"),
    [
        ("PickupGarbage", "foundGarbage and robotCurrentExtraCapacity >= 1"),
        ("ExecuteCharge", "batteryLevel < 95 and batteryLevel >= 100"),
        ("DeliverToClearingPoint", "robotCurrentExtraCapacity <= 29"),
    ],
)
def test_fulfil_by_hand(action: str, guard: str) -> None:
    """The declarations of the island, as guards."""
    expected = parse(f"when {guard} abort none {{ {action} }}")
    assert changed("fulfil", parse(action), 0) == expected


def shape(tree: Node) -> Node:
    """The tree with 0 for each number of a condition."""
    for i, node in places(tree):
        if node.guard:
            expr = guard_of(node).condition
            for k, term in enumerate(terms(expr)):
                zero = branches.with_term(expr, k, term._replace(number=0.0))
                assert zero is not None
                expr = zero
            tree = replace_at(tree, i, node._replace(args=(expr, node.args[1])))
    return tree


@examples(max_examples=200)
@given(tree=TREES, seed=SEEDS)
def test_tune_moves_numbers_alone(tree: Node, seed: int) -> None:
    """Nodes, keys and operators stay; a number that moved is in its key's range."""
    new = changed("tune", tree, seed)
    assert shape(new) == shape(tree)
    for old, term in zip(asked_in(tree), asked_in(new), strict=True):
        key = VOCABULARY.keys[term.key]
        assert term == old or (not key.flag and key.low <= term.number <= key.high)


@pytest.mark.parametrize("name", ODD.keys)
def test_tuned_numbers_of_odd_ranges(name: str) -> None:
    """They stay in the range, reach its ends, and have about 200 to 2,000 different values."""
    key = ODD.keys[name]
    rng = np.random.default_rng(0)
    numbers = {fine(float(x), key) for x in rng.uniform(key.low, key.high, 20_000)}
    assert all(key.low <= x <= key.high for x in numbers)
    assert 190 <= len(numbers) <= 2010
    assert (fine(-1e12, key), fine(1e12, key)) == (key.low, key.high)
    unit = 10 ** floor(log10((key.high - key.low) / branches.FINE))
    inside = [x for x in numbers if key.low < x < key.high]
    assert all(abs(x / unit - round(x / unit)) < 1e-3 for x in inside)


def test_tune_leaves_the_grid_and_sometimes_moves_all() -> None:
    """The sizes of steps differ, and a part of the changes concerns every number."""
    text = "when batteryLevel < 50 { when lap < 2 { PatrolWaypoint } }"
    tree, batteries, both = parse(text), set[float](), 0
    for seed in range(400):
        battery, lap = asked_in(changed("tune", tree, seed))
        batteries.add(battery.number)
        both += battery.number != 50 and lap.number != 2
    assert any(b % 5 for b in batteries)
    assert min(abs(b - 50) for b in batteries if b != 50) <= 1
    assert max(abs(b - 50) for b in batteries) >= 20
    assert 40 < both < 160


@pytest.mark.parametrize("operator", NEW)
@pytest.mark.parametrize("domain", VOCABULARIES)
def test_branches_fit_small_vocabularies(operator: str, domain: str) -> None:
    """Without keys there is no guard; with one action there is no other; numbers stay in range."""
    space = replace(SPACE, vocabulary=VOCABULARIES[domain])
    action = next(iter(space.actions))
    for seed in range(cases(60)):
        tree = Node("selector", (), (leaf(action), leaf(action)))
        for step in range(8):
            tree = changed(operator, tree, 8 * seed + step, space)
            check_names(tree, space.vocabulary)
            if not within(tree, Limits(30, 300)):
                break
        assert space.keys or all(node.kind != "when" for node in walk(tree))
        for term in asked_in(tree):
            key = space.vocabulary.keys[term.key]
            slack = 0 if operator == "tune" else 1e-9  # random thresholds have nine decimals
            assert key.flag or key.low - slack <= term.number <= key.high + slack


@pytest.mark.parametrize("domain", VOCABULARIES)
def test_tight_limits(domain: str) -> None:
    """As `mutate` uses them, no operator breaks gp.max_depth=2 and gp.max_nodes=3."""
    tight = Limits(2, 3)
    space = TreeSpace(SPACE.settings, VOCABULARIES[domain], tight)
    tree = leaf(next(iter(space.actions)))
    for seed in range(cases(300)):
        for operator in NEW:
            settings = MutationSettings(operators={operator: 1}, subtree_depth=1, number_sd=0.2)
            rng = np.random.default_rng(seed)
            tree, _ = mutate(rng, tree, rate=1.0, space=space, settings=settings)
            assert within(tree, tight)


@examples(max_examples=200)
@given(
    mother=TREES, father=TREES, seed=SEEDS, spare=st.tuples(st.integers(0, 6), st.integers(0, 30))
)
def test_branch_crossover(mother: Node, father: Node, seed: int, spare: tuple[int, int]) -> None:
    """A branch of the father is between the mother's, or in one's place, within the limits."""
    limits = Limits(depth(mother) + spare[0], size(mother) + spare[1])
    child = branch_crossover(np.random.default_rng(seed), mother, father, limits)
    assert within(child, limits)
    check_names(child, VOCABULARY)
    if child == mother:
        return
    possible = {Node("selector", (), (branch, mother)) for branch in branches_of(father)}
    for i, node in places(mother):
        if node.kind in LISTS:
            for branch in branches_of(father):
                for at in range(len(node.children)):
                    head, tail = node.children[:at], node.children[at:]
                    for children in ((*head, branch, *tail), (*head, branch, *tail[1:])):
                        possible.add(replace_at(mother, i, node._replace(children=children)))
    assert child in possible


def test_branch_crossover_is_likely_to_do_something() -> None:
    """With room for a branch there is a child that differs."""
    mother = parse("selector { when lap < 2 { SeekCharger } PatrolWaypoint }")
    father = parse("selector { when foundGarbage { MoveToGarbage } ExecuteCharge }")
    children = {
        branch_crossover(np.random.default_rng(s), mother, father, LIMITS) for s in range(60)
    }
    assert mother not in children
    assert len(children) > 4
    full = Limits(8, size(mother))
    assert branch_crossover(np.random.default_rng(0), mother, father, full) == mother


@pytest.mark.parametrize("domain", VOCABULARIES)
@examples(max_examples=40)
@given(seed=SEEDS)
def test_random_lists(domain: str, seed: int) -> None:
    """A selector of two to five guarded branches of one to three actions, and an action."""
    space = replace(SPACE, vocabulary=VOCABULARIES[domain])
    tree = random_list(np.random.default_rng(seed), space)
    check_names(tree, space.vocabulary)
    *guarded, last = tree.children
    assert tree.kind == "selector"
    assert last.kind == "action" or {node.kind for node in last.children} == {"action"}
    assert 2 <= len(guarded) <= 5
    for branch in guarded:
        assert (branch.kind == "when") == bool(space.keys)
        body = branch.children[0] if branch.guard else branch
        actions = [body] if body.kind == "action" else list(body.children)
        assert {node.kind for node in actions} == {"action"}
        assert 1 <= len(actions) <= 6


def test_random_lists_act() -> None:
    """A half of the guards asks what the first action declares that it needs to start."""
    declared = guards = 0
    for seed in range(300):
        for branch in random_list(np.random.default_rng(seed), SPACE).children[:-1]:
            first = next(node for node in walk(branch) if node.action)
            conditions = VOCABULARY.action(first.action).to_start
            if conditions:
                guards += 1
                declared += branch.args[0] == combine("and", conditions)
    assert 0.4 < declared / guards < 0.65


def test_random_lists_prepare_their_actions() -> None:
    """Most pickups come right behind a drive to garbage, as they declare."""
    pickups = prepared = 0
    for seed in range(300):
        names = [
            node.action
            for node in walk(random_list(np.random.default_rng(seed), SPACE))
            if node.action
        ]
        for before, name in zip(["", *names], names, strict=False):
            pickups += name == "PickupGarbage"
            prepared += name == "PickupGarbage" and before == "MoveToGarbage"
    assert 0.65 < prepared / pickups < 0.85


@examples(max_examples=20)
@given(board=few_boards(), seed=SEEDS)
def test_random_lists_run(board: list[float], seed: int) -> None:
    """The engine ticks them on any blackboard."""
    tree = random_list(np.random.default_rng(seed), SPACE)
    assert len(trace(tree, [board, board], [1])) == 2
