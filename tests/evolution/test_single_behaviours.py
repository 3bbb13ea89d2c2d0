"""The search for a tree of each single behaviour, in a world that can be worked out by hand."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import cache

import pytest

from islandgp.bt.core.engine import compile_tree
from islandgp.bt.core.language import parse, to_text
from islandgp.bt.core.node import FAILURE, RUNNING, SUCCESS, Limits, Node, size, walk, within
from islandgp.bt.core.vocabulary import Action, Vocabulary, flag
from islandgp.domain import Outcome
from islandgp.evaluation.base import Job
from islandgp.evolution.single_behaviours import (
    CHILDREN,
    COMPACT,
    POOL,
    ROUNDS,
    WORLDS,
    single_behaviours,
)
from islandgp.gp.random_trees import TreeSpace
from islandgp.scoring.classes import Classes
from tests.composed import composed
from tests.profiles import sweep

TICKS = 20  # of an episode
STORE = Vocabulary(
    "store",
    {
        "Pick": Action("takes an item, one a tick"),
        "Put": Action("puts down an item that was taken, one a tick"),
        "Rest": Action("goes on for ever"),
        "Fly": Action("is never possible"),
    },
    {"holding": flag("there is an item")},
)
CLASSES = Classes.model_validate(
    {
        "behaviours": {"picking": "picks", "putting": "puts", "flying": "flights"},
        "specialists": {"of": ["picking"], "dominance_ratio": 2, "idle": "idle", "mixed": "mixed"},
        "tiers": {"good": {}},
        "milestones": ["good"],
    }
)


def episode(tree: Node) -> Outcome:
    """What a tree does in TICKS ticks of the store."""
    board, counters = [0.0], {"picks": 0.0, "puts": 0.0, "flights": 0.0}
    used: set[str] = set()  # in this tick

    def once(name: str, counter: str, change: int) -> Callable[[bool], int]:
        def act(_fresh: bool) -> int:
            if name in used or board[0] + change < 0:
                return FAILURE
            used.add(name)
            board[0] += change
            counters[counter] += 1
            return SUCCESS

        return act

    actions = {
        "Pick": once("Pick", "picks", 1),
        "Put": once("Put", "puts", -1),
        "Rest": lambda _fresh: RUNNING,
        "Fly": lambda _fresh: FAILURE,
    }
    tick = compile_tree(tree, actions, board, STORE.key_index)
    for _ in range(TICKS):
        used.clear()
        tick()
    return Outcome({"points": 0.0}, counters, float(TICKS), ("time",))


class Store:
    """See `Evaluator`."""

    def __init__(self) -> None:
        self.jobs: list[Job] = []

    def evaluate(self, jobs: Sequence[Job]) -> list[Outcome]:
        """See `Evaluator`."""
        self.jobs += jobs
        return [episode(parse(job.tree, STORE)) for job in jobs]

    def close(self) -> None:
        """See `Evaluator`."""


def search(limits: Limits | None = None) -> tuple[dict[str, Node], list[Job]]:
    """The trees by behaviour, and the episodes that it took."""
    gp, store = composed().gp, Store()
    space = TreeSpace(gp.trees, STORE, limits or gp.limits)
    results = single_behaviours(CLASSES, space, gp.mutation, store, [3])
    trees = {}
    for _, name, tree, episodes in results:
        assert episodes == len(store.jobs)
        trees |= {name: tree} if tree is not None else {}
    return trees, store.jobs


@cache
def searched() -> tuple[dict[str, Node], list[Job]]:
    """With the paper's limits."""
    return search()


def sorted_actions(tree: Node) -> list[str]:
    """The actions of a tree, sorted."""
    return sorted(node.action for node in walk(tree) if node.action)


def test_each_behaviour_has_its_smallest_tree() -> None:
    """One that shows it in every tick, without a node that could be left out."""
    trees, _ = searched()
    assert to_text(trees["picking"]) == "Pick\n"
    assert (size(trees["putting"]), sorted_actions(trees["putting"])) == (3, ["Pick", "Put"])
    assert episode(trees["putting"]).counters["puts"] == TICKS


def test_nodes_keep_the_fewest_children_of_their_kind() -> None:
    """A recovery has two children also in the trees with one branch less."""
    gp, store = composed().gp, Store()
    kinds = gp.trees.model_copy(update={"kinds": {"recovery": 1.0}})
    space = TreeSpace(kinds, STORE, gp.limits)
    results = single_behaviours(CLASSES, space, gp.mutation, store, [3])
    by_behaviour = {name: tree for _, name, tree, _ in results}
    trees = [parse(job.tree, STORE) for job in store.jobs]
    assert any(node.kind == "recovery" for tree in trees for node in walk(tree))
    assert by_behaviour["picking"] is not None


def test_what_no_tree_showed_is_left_out() -> None:
    """Nobody can fly, however long the search takes."""
    assert list(searched()[0]) == ["picking", "putting"]


@pytest.mark.slow
def test_the_search_is_a_function_of_its_arguments() -> None:
    """Asked again it tries the same trees in the same worlds, and finds the same."""
    assert search() == searched()


def test_the_search_is_bounded() -> None:
    """At most as many episodes as its constants allow, and those of taking nodes away."""
    _, jobs = searched()
    behaviours = len(CLASSES.behaviours)
    smaller = behaviours * COMPACT.max_nodes * 2 * COMPACT.max_nodes  # fewer nodes at each step
    assert len(jobs) <= WORLDS * (POOL + behaviours * ROUNDS * CHILDREN + smaller)
    assert len(set(jobs)) == len(jobs), "no episode is run twice"


def test_all_trees_meet_the_same_worlds() -> None:
    """In the stage that was asked for."""
    _, jobs = searched()
    assert {job.stage for job in jobs} == {3}
    worlds = {job.seed for job in jobs}
    assert len(worlds) == WORLDS
    assert {(job.tree, seed) for job in jobs for seed in worlds} == {
        (job.tree, job.seed) for job in jobs
    }


@pytest.mark.slow
@sweep("limits", [Limits(8, 50), Limits(2, 3), Limits(50, 1)], quick=1)
def test_trees_are_compact(limits: Limits) -> None:
    """Within section 2.4.6, and within the run's limits where those are narrower."""
    trees, jobs = search(limits)
    for tree in (*trees.values(), *(parse(job.tree) for job in jobs)):
        assert within(tree, COMPACT)
        assert within(tree, limits)
    assert "picking" in trees
