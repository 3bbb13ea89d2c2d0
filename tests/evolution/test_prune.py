"""Shortening a tree: what goes, what stays, and the episodes that it takes."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import count, islice

import pytest
from hypothesis import given
from hypothesis import strategies as st

from islandgp.bt.analysis.shorter import (
    freed_forms,
    removable,
    rounded,
    rounded_forms,
    shorter_forms,
    without,
)
from islandgp.bt.core.language import parse, to_text
from islandgp.bt.core.node import Node, size, walk
from islandgp.domain import Outcome
from islandgp.domains.island.vocabulary import VOCABULARY
from islandgp.evolution.prune import FIRST, Keep, PruneResult, Shortened, Standard, prune, thinned
from islandgp.scoring.constraints import Bound
from tests.profiles import examples
from tests.samples import CLASSES, outcome
from tests.strategies import nodes

JUNK = """
selector {
  when lap == 2 { selector { DeliverToClearingPoint MoveToHumanoid PatrolWaypoint } }
  when foundGarbage and batteryLevel > 12.34 abort lower {
    sequence { MoveToGarbage PickupGarbage repeater 3 { SeekCharger } }
  }
  when isHumanoidWantToClear { PatrolWaypoint }
  when foundGarbage { PatrolWaypoint }
  PatrolWaypoint
}
"""


def tree_of(text: str) -> Node:
    """The tree in a text."""
    return parse(text, VOCABULARY)


class Simulator:
    """Points depend on the actions of a tree; each episode is counted."""

    def __init__(self, points: dict[str, float], noise: float = 0.0) -> None:
        self.points = points
        self.noise = noise
        self.episodes = 0

    def __call__(self, trees: Sequence[Node], worlds: Sequence[int]) -> list[list[Outcome]]:
        """The outcomes of each tree in each world."""
        self.episodes += len(trees) * len(worlds)
        return [[self.outcome(tree, world) for world in worlds] for tree in trees]

    def run(self, tree: Node, world: int, observer: object) -> Outcome:  # noqa: ARG002
        """An episode in which no node is seen to run."""
        self.episodes += 1
        return self.outcome(tree, world)

    def outcome(self, tree: Node, world: int) -> Outcome:
        """Points for each action that the tree has, and counters of two behaviours."""
        actions = {node.action for node in walk(tree)}
        fitness = sum(points for name, points in self.points.items() if name in actions)
        shaken = self.noise * (hash((to_text(tree), world)) % 1000 / 500 - 1)
        has = {name: float(name in actions) for name in ("PickupGarbage", "ExecuteCharge")}
        return outcome(fitness + shaken, pickups=has["PickupGarbage"], charges=has["ExecuteCharge"])


def result_of(text: str, simulator: Simulator, **changes: object) -> PruneResult:
    """The result of pruning with a tolerance of 1 %, 2,000 episodes and 20 worlds."""
    keep = Keep(0.01, CLASSES, {})
    seeds = count()
    arguments = {"keep": keep, "episodes": 2000, "most_worlds": 20, **changes}
    return prune(
        tree_of(text),
        VOCABULARY,
        simulator,
        simulator.run,
        lambda n: list(islice(seeds, n)),
        **arguments,
    )  # type: ignore[arg-type] # the changes are those of the arguments


@given(tree=nodes(), place=st.integers(0, 30))
@examples(100)
def test_a_shorter_form_is_a_tree_of_the_language(tree: Node, place: int) -> None:
    """Every form has at most the nodes of the tree, says how many it saves, and can be printed."""
    forms = shorter_forms(tree)
    assert len({form.tree for form in forms}) == len(forms)
    for form in forms[place : place + 5]:
        assert form.tree != tree
        assert form.nodes == size(tree) - size(form.tree) >= 0
        assert parse(to_text(form.tree)) == form.tree
    assert [form.nodes for form in forms] == sorted((f.nodes for f in forms), reverse=True)


def test_a_single_action_has_no_shorter_form() -> None:
    """Nothing is left to go."""
    assert shorter_forms(tree_of("PatrolWaypoint")) == []
    assert rounded_forms(tree_of("PatrolWaypoint")) == []


def test_equal_branches_are_joined() -> None:
    """Neighbouring guards above equal children become one guard."""
    tree = tree_of("selector { when lap > 2 { SeekCharger } when foundGarbage { SeekCharger } }")
    joined = tree_of("when lap > 2 or foundGarbage { SeekCharger }")
    assert joined in [form.tree for form in shorter_forms(tree)]


def test_a_repetition_goes_at_once() -> None:
    """Children that follow each other twice are kept once."""
    twice = tree_of("sequence { SeekCharger ExecuteCharge SeekCharger ExecuteCharge }")
    forms = [form.tree for form in shorter_forms(twice)]
    assert tree_of("sequence { SeekCharger ExecuteCharge }") in forms


def test_a_guard_lets_its_action_end() -> None:
    """Charging succeeds at 100 %, so a guard below that stops it; it can be told not to."""
    tree = tree_of("selector { when batteryLevel < 15 { ExecuteCharge } PatrolWaypoint }")
    (form,) = freed_forms(tree, VOCABULARY)
    assert form.tree == tree_of(
        "selector { when batteryLevel < 15 abort lower { ExecuteCharge } PatrolWaypoint }"
    )
    assert freed_forms(form.tree, VOCABULARY) == []


def test_a_node_can_be_removed_if_its_parent_can_do_without() -> None:
    """A composite that is left with one child is replaced by it; the child of a guard stays."""
    tree = tree_of(
        "selector { when lap > 2 { SeekCharger } sequence { ExecuteCharge MoveToGarbage } }"
    )
    guard = "when lap > 2 { SeekCharger }"
    assert {place: without(tree, {place}) for place in removable(tree)} == {
        1: tree_of("sequence { ExecuteCharge MoveToGarbage }"),
        3: tree_of(guard),
        4: tree_of(f"selector {{ {guard} MoveToGarbage }}"),
        5: tree_of(f"selector {{ {guard} ExecuteCharge }}"),
    }


@given(tree=nodes(), chosen=st.sets(st.integers(0, 30)))
@examples(100)
def test_several_nodes_can_be_removed_at_once(tree: Node, chosen: set[int]) -> None:
    """What is left is a tree of the language; nothing is left if all children of the root go."""
    places = chosen.intersection(removable(tree))
    rest = without(tree, places)
    if rest is None:
        assert len(places) >= len(tree.children) > 1
    else:
        assert parse(to_text(rest)) == rest
        assert size(rest) <= size(tree) - len(places)


@pytest.mark.parametrize(
    ("number", "digits", "short"),
    [(36.74, 1, 40.0), (36.74, 2, 37.0), (0, 1, 0), (-0.0123, 1, -0.01), (25, 2, 25)],
)
def test_rounding_keeps_significant_digits(number: float, digits: int, short: float) -> None:
    """Numbers of any size keep that many digits."""
    assert rounded(number, digits) == short


def test_what_has_no_effect_goes() -> None:
    """Only the actions that earn points are left, without a guard."""
    simulator = Simulator({"PickupGarbage": 100.0, "PatrolWaypoint": 50.0})
    result = result_of(JUNK, simulator)
    assert {node.action for node in walk(result.best)} - {""} == {
        "PickupGarbage",
        "PatrolWaypoint",
    }
    assert size(result.best) == 3
    assert result.front[0].tree == result.best
    assert all(step.difference >= -1.5 for step in result.steps)
    assert [size(step.tree) for step in result.steps] == sorted(
        (size(step.tree) for step in result.steps), reverse=True
    )


class NeedsGuard(Simulator):
    """A tree without a guard earns nothing."""

    def outcome(self, tree: Node, world: int) -> Outcome:
        """See `Simulator`."""
        guarded = any(node.kind == "when" for node in walk(tree))
        return super().outcome(tree, world) if guarded else outcome(0)


@pytest.mark.timeout(60)
def test_it_ends_if_simplifying_undoes_a_change() -> None:
    """`abort lower` below a first child frees nothing: simplified, the tree is as it was before."""
    text = """selector {
      sequence { MoveToGarbage when not foundGarbage { PickupGarbage } }
      SeekCharger
    }"""
    points = {"MoveToGarbage": 1.0, "PickupGarbage": 1.0, "SeekCharger": 1.0}
    assert result_of(text, NeedsGuard(points)).best == tree_of(text)


def test_a_behaviour_is_kept_although_it_earns_nothing() -> None:
    """An action whose counter is a behaviour stays; so does what a constraint asks for."""
    text = "sequence { ExecuteCharge PickupGarbage SeekCharger }"
    result = result_of(text, Simulator({"PickupGarbage": 100.0}))
    assert result.best == tree_of("sequence { ExecuteCharge PickupGarbage }")
    keep = Keep(0.01, CLASSES, {"distance": Bound(at_least=1.0)})
    same = result_of(text, Simulator({"PickupGarbage": 100.0}), keep=keep)
    assert same.best == result.best  # it broke the constraint before, and no more now


def test_a_constraint_that_is_kept_stays_kept() -> None:
    """A shorter tree that breaks a constraint is not chosen."""

    class Waiting(Simulator):
        def outcome(self, tree: Node, world: int) -> Outcome:
            waits = any(node.action == "SeekCharger" for node in walk(tree))
            return outcome(super().outcome(tree, world).fitness, inactive=0.0 if waits else 9.0)

    keep = Keep(0.01, CLASSES, {"inactive": Bound(at_most=3.0)})
    text = "sequence { SeekCharger PatrolWaypoint MoveToHumanoid }"
    result = result_of(text, Waiting({"PatrolWaypoint": 100.0}), keep=keep)
    assert result.best == tree_of("sequence { SeekCharger PatrolWaypoint }")


@pytest.mark.parametrize(("tolerance", "nodes"), [(0.0, 3), (0.005, 3), (0.2, 1)])
def test_the_tolerance_decides(tolerance: float, nodes: int) -> None:
    """An action that earns a tenth of the points stays, unless that much may be lost."""
    text = "sequence { PatrolWaypoint MoveToHumanoid }"
    simulator = Simulator({"PatrolWaypoint": 90.0, "MoveToHumanoid": 10.0})
    result = result_of(text, simulator, keep=Keep(tolerance, CLASSES, {}))
    assert size(result.best) == nodes


def test_a_tree_that_earns_nothing_stays_as_it_is() -> None:
    """Where every tree has 0 points there is nothing to compare."""
    result = result_of(JUNK, Simulator({}))
    assert (len(result.steps), result.best, result.earns_nothing) == (1, tree_of(JUNK), True)


@given(episodes=st.integers(0, 700), worlds=st.integers(FIRST, 40))
@examples(30)
def test_episodes_are_limited_and_counted(episodes: int, worlds: int) -> None:
    """No more than allowed are spent, and the result says how many."""
    simulator = Simulator({"PickupGarbage": 100.0, "PatrolWaypoint": 50.0}, noise=20.0)
    result = result_of(JUNK, simulator, episodes=episodes, most_worlds=worlds)
    assert result.episodes == simulator.episodes <= episodes
    assert size(result.best) <= size(tree_of(JUNK))


def test_few_episodes_leave_the_tree() -> None:
    """Below one comparison nothing is tried."""
    simulator = Simulator({"PickupGarbage": 100.0})
    result = result_of(JUNK, simulator, episodes=50)
    assert (result.best, simulator.episodes) == (tree_of(JUNK), 0)


def test_a_loss_in_a_few_worlds_is_hopeless_only_beyond_its_error() -> None:
    """A form is rejected early if its loss exceeds the tolerance by a standard error."""
    standard = Standard([outcome(100.0)] * 8, Keep(0.01, CLASSES, {}))
    assert standard.is_hopeless([outcome(50.0)] * 4)
    assert not standard.is_hopeless([outcome(99.5)] * 4)
    assert not standard.is_hopeless([outcome(value) for value in (20.0, 170.0, 90.0, 100.0)])
    assert standard.keeps([outcome(99.0)] * 8)
    assert not standard.keeps([outcome(98.9)] * 8)


@given(sizes=st.lists(st.integers(1, 6), min_size=1), most=st.integers(1, 8))
@examples(50)
def test_a_thinned_front_has_the_shortest_tree(sizes: Sequence[int], most: int) -> None:
    """At most that many trees of different sizes, the shortest first."""
    steps = [
        Shortened(tree_of(f"sequence {{ {'PatrolWaypoint ' * n}}}"), "", 0.0)
        for n in sorted(sizes, reverse=True)
    ]
    front = thinned(steps, most)
    sizes_left = [size(step.tree) for step in front]
    assert sizes_left == sorted(set(sizes_left))
    assert len(sizes_left) == min(most, len({size(step.tree) for step in steps}))
    assert sizes_left[0] == size(steps[-1].tree)
