"""Crossover and mutation: what holds for every tree, and what each operator does."""

from __future__ import annotations

from collections import Counter
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from pydantic import ValidationError

from islandgp.bt.core.condition import Condition
from islandgp.bt.core.kinds import KINDS
from islandgp.bt.core.language import parse, to_text
from islandgp.bt.core.node import (
    Limits,
    Node,
    depth,
    guard_of,
    levels,
    replace_at,
    size,
    walk,
    within,
)
from islandgp.bt.core.vocabulary import Action, Vocabulary
from islandgp.domains.island.vocabulary import VOCABULARY
from islandgp.gp.random_trees import (
    TreeSettings,
    TreeSpace,
    grow,
    random_args,
    random_tree,
    weighted,
)
from islandgp.gp.selection import tournament
from islandgp.gp.variation import CROSSOVERS, MUTATIONS, MutationSettings, mutate
from tests.composed import composed
from tests.profiles import examples
from tests.samples import evaluated, outcome
from tests.strategies import nodes

LIMITS = Limits(max_depth=8, max_nodes=50)
TREES = nodes(max_leaves=16).filter(lambda tree: within(tree, LIMITS))
SEEDS = st.integers(0, 2**32 - 1)
ALL_ROUNDER = """
selector {
  when batteryLevel < 25 abort lower { sequence { SeekCharger ExecuteCharge } }
  parallel success one { MoveToHumanoid PatrolWaypoint }
  repeater 3 { sequence { MoveToGarbage PickupGarbage } }
  inverter { when foundGarbage { DeliverToClearingPoint } }
}
"""

WITHOUT_RESOURCES = replace(
    VOCABULARY,
    actions={name: replace(action, uses=()) for name, action in VOCABULARY.actions.items()},
)
PAPER = {name for name, kind in KINDS.items() if kind.paper}


def tree_settings() -> TreeSettings:
    """The paper's."""
    return composed().gp.trees


def space(limits: Limits = LIMITS, trees: TreeSettings | None = None) -> TreeSpace:
    """Trees of the island."""
    return TreeSpace(trees or tree_settings(), WITHOUT_RESOURCES, limits)


def only(operator: str) -> MutationSettings:
    """Mutation by one operator alone."""
    return composed().gp.mutation.model_copy(update={"operators": {operator: 1.0}})


def mutated(seed: int, tree: Node, operator: str, limits: Limits = LIMITS) -> Node:
    """One mutation, as the loop does it."""
    new, _ = mutate(
        np.random.default_rng(seed),
        tree,
        rate=1.0,
        space=space(limits),
        settings=only(operator),
    )
    return new


def check_valid(tree: Node) -> None:
    """A tree is valid when the language can print it and parses it back as the same."""
    assert parse(to_text(tree), VOCABULARY) == tree


@pytest.mark.parametrize("operator", MUTATIONS)
@examples(max_examples=60)
@given(tree=TREES, seed=SEEDS)
def test_mutation_keeps_limits_and_validity(operator: str, tree: Node, seed: int) -> None:
    """An operator on a tree within the limits gives a tree within the limits."""
    new = mutated(seed, tree, operator)
    assert within(new, LIMITS)
    check_valid(new)


@examples(max_examples=60)
@given(tree=TREES, seed=SEEDS)
def test_mutation_at_the_limits(tree: Node, seed: int) -> None:
    """Limits that the tree just meets still hold."""
    tight = Limits(max_depth=depth(tree), max_nodes=size(tree))
    for operator in MUTATIONS:
        assert within(mutated(seed, tree, operator, tight), tight)


@examples(max_examples=150)
@given(mother=TREES, father=TREES, seed=SEEDS)
def test_crossover_keeps_limits_and_validity(mother: Node, father: Node, seed: int) -> None:
    """A child of trees within the limits is a tree within the limits, made of their subtrees."""
    child = CROSSOVERS["subtree"](np.random.default_rng(seed), mother, father, LIMITS)
    assert within(child, LIMITS)
    check_valid(child)
    donated = set(walk(father))
    cuts = [
        replace_at(mother, at, donor) == child for at in range(size(mother)) for donor in donated
    ]
    assert child == mother or any(cuts)


@examples(max_examples=60)
@given(mother=TREES, father=TREES, seed=SEEDS)
def test_crossover_at_the_limits(mother: Node, father: Node, seed: int) -> None:
    """A donor that does not fit is not taken."""
    tight = Limits(max_depth=depth(mother), max_nodes=size(mother))
    assert within(CROSSOVERS["subtree"](np.random.default_rng(seed), mother, father, tight), tight)


@examples(max_examples=60)
@given(tree=TREES, seed=SEEDS)
def test_rate_0_changes_nothing(tree: Node, seed: int) -> None:
    """At rate 0 the same tree comes back, and no operator is named."""
    settings = composed().gp.mutation
    rng = np.random.default_rng(seed)
    assert mutate(rng, tree, rate=0.0, space=space(), settings=settings) == (tree, "")


@examples(max_examples=60)
@given(tree=TREES, seed=SEEDS)
def test_named_mutation_changes_the_tree(tree: Node, seed: int) -> None:
    """When an operator is named the tree is another one; when none is, it is the same."""
    settings = composed().gp.mutation
    rng = np.random.default_rng(seed)
    new, name = mutate(rng, tree, rate=1.0, space=space(), settings=settings)
    assert (new != tree) == (name in MUTATIONS)


def test_rate_is_the_share_that_mutates() -> None:
    """Over many trees the share of mutated ones is the rate."""
    tree, settings = parse(ALL_ROUNDER), composed().gp.mutation
    hits = 0
    for seed in range(1000):
        rng = np.random.default_rng(seed)
        hits += mutate(rng, tree, rate=0.3, space=space(), settings=settings)[1] != ""
    assert 260 < hits < 340


def test_a_higher_rate_mutates_the_same_and_more() -> None:
    """A tree that mutates at a low rate mutates in the same way at a higher one."""
    tree, settings = parse(ALL_ROUNDER), composed().gp.mutation
    for seed in range(200):
        low, high = (
            mutate(
                np.random.default_rng(seed),
                tree,
                rate=rate,
                space=space(),
                settings=settings,
            )
            for rate in (0.2, 0.6)
        )
        assert low[1] == "" or low == high


def test_what_each_operator_does() -> None:
    """Each operator changes a tree in its own way, and in no other."""
    old = parse(ALL_ROUNDER)
    leaves = Counter(n for n in walk(old) if n.action)
    shape = [len(n.children) for n in walk(old)]
    for seed in range(200):
        swapped = mutated(seed, old, "swap")
        assert swapped != old
        assert Counter(n for n in walk(swapped) if n.action) == leaves
        assert size(mutated(seed, old, "delete")) < size(old)
        assert size(mutated(seed, old, "insert")) > size(old)
        assert [len(n.children) for n in walk(mutated(seed, old, "node"))] == shape
        nudged = mutated(seed, old, "parameter")
        assert [n.kind for n in walk(nudged)] == [n.kind for n in walk(old)]
        changed = [(a, b) for a, b in zip(walk(old), walk(nudged), strict=True) if a.args != b.args]
        assert len(changed) == 1


def test_an_operator_without_a_node_to_change_returns_the_tree() -> None:
    """An operator that finds nothing to work on leaves the tree alone."""
    leaf = parse("PatrolWaypoint")
    for operator in ("parameter", "delete", "swap"):
        assert mutated(0, leaf, operator) == leaf


def test_numbers_stay_on_their_grid() -> None:
    """A nudged threshold stays in its key's range, on its key's grid."""
    tree = parse("when batteryLevel < 95 { PatrolWaypoint }")
    thresholds = set()
    for seed in range(300):
        key, op, number, *_ = guard_of(mutated(seed, tree, "parameter")).condition
        if (key, op) == ("batteryLevel", "<"):
            thresholds.add(number)
    assert len(thresholds) > 8
    assert all(0 <= float(n) <= 100 and float(n) % 5 == 0 for n in thresholds)


def test_a_kind_without_weight_never_appears() -> None:
    """`gp.trees.kinds` holds for mutation as for random trees."""
    trees = tree_settings()
    fewer_kinds = trees.model_copy(update={"kinds": {**trees.kinds, "parallel": 0.0, "when": 0.0}})
    start = parse("selector { sequence { PatrolWaypoint SeekCharger } inverter { SeekCharger } }")
    kinds = Counter()
    for seed in range(300):
        rng = np.random.default_rng(seed)
        new, _ = mutate(
            rng, start, rate=1.0, space=space(trees=fewer_kinds), settings=composed().gp.mutation
        )
        kinds.update(n.kind for n in walk(new))
    assert set(kinds) == {"action", "selector", "sequence", "inverter", "repeater"}


@examples(max_examples=100)
@given(seed=SEEDS)
def test_random_trees(seed: int) -> None:
    """Random trees are valid, within the limits, and as deep as configured."""
    tree = random_tree(np.random.default_rng(seed), space())
    assert within(tree, LIMITS)
    assert 2 <= depth(tree) <= 5
    check_valid(tree)


@pytest.mark.parametrize("limits", [Limits(2, 3), Limits(1, 1), Limits(3, 4), Limits(50, 1)])
def test_random_trees_in_narrow_limits(limits: Limits) -> None:
    """However narrow the limits are, a tree within them is found."""
    for seed in range(50):
        assert within(random_tree(np.random.default_rng(seed), space(limits)), limits)


def test_random_trees_use_the_whole_language() -> None:
    """Every node kind, action, key and operator turns up."""
    uses: Counter[object] = Counter()
    for seed in range(400):
        for node in walk(random_tree(np.random.default_rng(seed), space())):
            uses[node.kind] += 1
            uses.update(guard_of(node).condition if node.guard else node.args)
    expected = [
        *PAPER,
        *VOCABULARY.actions,
        *VOCABULARY.keys,
        "<",
        "<=",
        ">",
        ">=",
        "==",
        "!=",
        "is",
        "not",
    ]
    assert [word for word in expected if not uses[word]] == []


def test_random_trees_without_keys() -> None:
    """A domain may have nothing to ask for: then no tree has a `when`, by no operator either."""
    bare = {name: Action(action.meaning) for name, action in VOCABULARY.actions.items()}
    blind = TreeSpace(tree_settings(), Vocabulary("blind", bare, {}), LIMITS)
    kinds: Counter[str] = Counter()
    for seed in range(200):
        rng = np.random.default_rng(seed)
        tree = random_tree(rng, blind)
        for operator in MUTATIONS:
            tree, _ = mutate(rng, tree, rate=1.0, space=blind, settings=only(operator))
        kinds.update(n.kind for n in walk(tree))
    assert set(kinds) == PAPER - {"when"}


def test_thresholds_of_random_trees_lie_on_the_grid() -> None:
    """From a key's least value to its greatest, in its steps."""
    thresholds: dict[str, set[float]] = {}
    rng = np.random.default_rng(0)
    for _ in range(2000):
        expr, _ = random_args(rng, "when", space())
        assert isinstance(expr, Condition)
        thresholds.setdefault(expr.key, set()).add(expr.number)
    assert thresholds["batteryLevel"] == set(range(0, 101, 5))
    assert thresholds["lap"] == set(range(6))
    assert thresholds["foundGarbage"] == {0}


def test_grow_depth() -> None:
    """`grow` never passes its depth; depth 1 is an action."""
    for seed in range(100):
        rng = np.random.default_rng(seed)
        assert depth(grow(rng, space(), 3)) <= 3
        assert grow(rng, space(), 1).kind == "action"


def test_weighted() -> None:
    """Keys are drawn by their weights; one without weight never is."""
    rng = np.random.default_rng(0)
    counts = Counter(weighted(rng, {"a": 0.0, "b": 1.0, "c": 3.0, "d": 0.0}) for _ in range(4000))
    assert set(counts) == {"b", "c"}
    assert 850 < counts["b"] < 1150


def test_replace_at() -> None:
    """A node's number is its place in document order."""
    tree = parse("selector { sequence { SeekCharger ExecuteCharge } PatrolWaypoint }")
    new = parse("MoveToGarbage")
    texts = [list(walk(replace_at(tree, i, new)))[i] for i in range(size(tree))]
    assert texts == [new] * 5
    assert replace_at(tree, 3, new) == parse(
        "selector { sequence { SeekCharger MoveToGarbage } PatrolWaypoint }"
    )
    assert levels(tree) == [1, 2, 3, 3, 2]
    with pytest.raises(IndexError):
        replace_at(tree, 5, new)


def test_tournament() -> None:
    """The fittest of three individuals, drawn with replacement, wins."""
    population = [evaluated(f"0.{i}", outcome(fitness=float(i))) for i in range(10)]
    wins: Counter[str] = Counter()
    for seed in range(500):
        wins[tournament(np.random.default_rng(seed), population, 3).individual.id] += 1
    # The chance that the best of ten is among three draws is 1 - 0.9^3 = 0.271.
    assert 100 < wins["0.9"] < 171
    assert wins["0.0"] < 10


@pytest.mark.parametrize(
    "operators", [{"sutbree": 1.0}, {"subtree": -1.0}, {"subtree": 0.0}, {}, {"swap": float("inf")}]
)
def test_operators_that_cannot_be(operators: dict[str, float]) -> None:
    """Unknown operators, weights below 0 and no weight at all are refused by name."""
    with pytest.raises(ValidationError, match="expected weights >= 0 for some of subtree, node"):
        MutationSettings(operators=operators, subtree_depth=3, number_sd=0.1)


@pytest.mark.parametrize("kinds", [{"action": 1.0}, {"sequence": -1.0}, {"sequence": 0.0}, {}])
def test_kinds_that_cannot_be(kinds: dict[str, float]) -> None:
    """Random trees need at least one kind of inner node."""
    values = {**tree_settings().model_dump(), "kinds": kinds}
    with pytest.raises(ValidationError, match="expected weights >= 0 for some of"):
        TreeSettings.model_validate(values)
