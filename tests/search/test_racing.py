"""Racing keeps trees by their lower bounds, and evaluates those with high upper bounds again."""

from __future__ import annotations

import pytest

from islandgp.bt.core.language import parse, to_text
from islandgp.errors import ConfigError
from islandgp.gp.evidence import estimate
from islandgp.seeding import Streams
from tests.search.searches import NO_ADVICE, evaluated, generations, search_and_plan

PLAIN = (
    "search.policy.random_generations=1",
    "search.policy.library=0",
    "search.policy.milestone=0",
    "search.policy.behaviour=0",
    "search.policy.parsimony=0",
)
"""One generation of random trees, no written trees, and points alone count."""

A, B, C = "PatrolWaypoint", "SeekCharger", "MoveToGarbage"


def survivors(state: object) -> list[str]:
    """The trees of a state's survivors as texts, best first."""
    return [to_text(e.tree).strip() for e in state.memory.entries]  # type: ignore[attr-defined]


def test_survivors_are_ranked_by_the_mean_over_all_their_episodes() -> None:
    """Without caution: a tree with one lucky episode falls behind one that is good each time."""
    search, _ = search_and_plan("racing", *PLAIN, "search.policy.bound_width=0")
    first = [
        evaluated("0.0", 100, tree=A),
        evaluated("0.1", 80, tree=B),
        evaluated("0.2", 0, tree=C),
    ]
    state = search.tell(search.start(), first, NO_ADVICE)
    assert survivors(state) == [A, B, C]
    second = [evaluated("1.0", 20, tree=A), evaluated("1.1", 80, tree=B)]
    state = search.tell(state, second, NO_ADVICE)
    assert survivors(state)[:2] == [B, A]
    assert [len(e.fitness) for e in state.memory.entries[:2]] == [2, 2]


def test_caution_prefers_trees_with_more_episodes() -> None:
    """Of two trees with the same mean the lower bound is that of the one with fewer episodes."""
    search, _ = search_and_plan("racing", *PLAIN, "search.policy.bound_width=3")
    state = search.tell(
        search.start(), [evaluated("0.0", 50, tree=A), evaluated("0.1", 9, tree=C)], NO_ADVICE
    )
    state = search.tell(
        state, [evaluated("1.0", 54, tree=A), evaluated("1.1", 53, tree=B)], NO_ADVICE
    )
    assert survivors(state)[0] == A


def test_promising_survivors_are_evaluated_again_with_their_ids_as_parents() -> None:
    """`again` is the share of the slots, at least one; the tree is unchanged."""
    search, _ = search_and_plan("racing", *PLAIN, "allocation.reevaluated=0.25")
    first = [
        evaluated("0.0", 5, tree=A),
        evaluated("0.1", 50, tree=B),
        evaluated("0.2", 20, tree=C),
    ]
    state = search.tell(search.start(), first, NO_ADVICE)
    population = tuple(search.ask(state, Streams(1)))
    elites = [i for i in population if i.origin == "elite"]
    assert [(i.tree, i.parents) for i in elites] == [
        (parse(B), ("0.1",)),
        (parse(C), ("0.2",)),
        (parse(A), ("0.0",)),
    ]


def test_no_new_tree_was_tried_before() -> None:
    """Only trees that are evaluated again occur in two generations."""
    search, plan = search_and_plan("racing", *PLAIN)
    history, _ = generations(search, plan, 7)
    earlier: set[str] = set()
    for population in history:
        new = [to_text(e.individual.tree) for e in population if e.individual.origin != "elite"]
        assert len({*new}) == len(new)
        assert not earlier & {*new}
        earlier |= {*new}


def test_of_new_trees_that_behaved_the_same_one_survives() -> None:
    """Same points and same terms in the same worlds: the later one is dropped."""
    search, _ = search_and_plan("racing", *PLAIN)
    same = [
        evaluated("0.0", 50, tree=A),
        evaluated("0.1", 50, tree=B),
        evaluated("0.2", 10, tree=C),
    ]
    state = search.tell(search.start(), same, NO_ADVICE)
    assert survivors(state) == [A, C]


def test_each_restart_begins_from_random_trees() -> None:
    """Two restarts of three generations, then one in which their best trees breed together."""
    search, plan = search_and_plan(
        "racing", *PLAIN, "search.policy.restarts=2", "search.policy.joint=0.15"
    )
    history, state = generations(search, plan, 7)
    origins = [{str(e.individual.origin) for e in population} for population in history]
    assert [kinds == {"random"} for kinds in origins] == [
        True,
        False,
        False,
        True,
        False,
        False,
        False,
    ]
    ids = {e.individual.id for population in history[3:6] for e in population}
    for population in history[4:6]:
        assert {p for e in population for p in e.individual.parents} <= ids
    parents = {p.split(".")[0] for e in history[6] for p in e.individual.parents}
    assert parents & {"0", "1", "2"}
    assert parents & {"3", "4", "5"}
    assert state.memory.champions == ()


def test_without_joint_generations_the_last_restart_ends_the_run() -> None:
    """Earlier restarts leave candidates for the best robot only."""
    overrides = (*PLAIN, "gp.generations=6", "search.policy.restarts=2", "search.policy.joint=0")
    search, plan = search_and_plan("racing", *overrides)
    history, _ = generations(search, plan, 6)
    for population in history[4:]:
        parents = {int(p.split(".")[0]) for e in population for p in e.individual.parents}
        assert parents <= {3, 4}


def test_one_restart_is_the_plain_search() -> None:
    """`joint` has no effect then."""
    (a, plan), (b, _) = (
        search_and_plan("racing", *PLAIN),
        search_and_plan("racing", *PLAIN, "search.policy.joint=0.9"),
    )
    assert generations(a, plan, 5)[0] == generations(b, plan, 5)[0]


@pytest.mark.parametrize("override", ["restarts=0", "restarts=1.5", "joint=1", "joint=-0.1"])
def test_restarts_out_of_range(override: str) -> None:
    """One line names the key."""
    with pytest.raises(ConfigError, match=override.split("=")[0]):
        search_and_plan("racing", f"search.policy.{override}")


def test_restarts_longer_than_the_run() -> None:
    """Each restart needs at least one generation after its random ones."""
    with pytest.raises(ConfigError, match="restarts"):
        search_and_plan("racing", "search.policy.restarts=5")


def test_levels_are_nearer_to_plain_means_with_more_shrinkage() -> None:
    """A tree that was evaluated in a rich world only is rated below its mean, or at it."""
    fitness = [{0: 10.0, 1: 30.0}, {0: 20.0, 1: 40.0}, {1: 50.0}]
    levels = [estimate(fitness, shrinkage)[0][2] for shrinkage in (0.0, 0.3, 3.0, 1e9)]
    assert levels == sorted(levels)
    assert levels[0] < 41
    assert levels[-1] == pytest.approx(50)
