"""A machine of a tree runs as the engine does, and what one walk proves is true."""

from __future__ import annotations

from collections import deque

import pytest
from every_tick import all_boards, every_tick
from hypothesis import assume, given, settings

from islandgp.bt.core.kinds import TIMED, kind_of
from islandgp.bt.core.language import parse
from islandgp.bt.core.node import Node, guard_of, walk
from islandgp.domains.island.vocabulary import VOCABULARY
from islandgp_verify.boards import NO_BOARD, BoardSets
from islandgp_verify.invariants import boards_of_nodes
from islandgp_verify.machine import Machine
from islandgp_verify.moves import Memory, Search, SpentError
from tests.bt.stage import short_tree
from tests.profiles import examples
from tests.strategies import few_numbers, nodes

MOST_TICKS = 4_000


def machine_of(tree: Node) -> Machine:
    """A machine with the island's vocabulary."""
    return Machine(tree, VOCABULARY, BoardSets(VOCABULARY.keys))


def reached(machine: Machine, boards: list[list[float]]) -> set[tuple[int, int]]:
    """The actions that a machine ticks in any state, by place, with the index of the blackboard."""
    search = Search(machine, 10**9)
    ticked: set[tuple[int, int]] = set()
    memories: set[Memory | None] = {None}
    waiting: deque[Memory | None] = deque([None])
    while waiting:
        memory = waiting.popleft()
        for index, board in enumerate(boards):
            for move in search.moves(memory, board):
                ticked |= {(place, index) for place, _ in move.calls}
                if move.memory not in memories:
                    memories.add(move.memory)
                    waiting.append(move.memory)
    return ticked


def compare(tree: Node) -> tuple[int, int]:
    """Fails where a machine does not go as the engine does, or a proof excludes what it does.

    Clocks and reactive composites have proofs but no moves: `check_rule` explores no such tree.
    Returns the pairs of an action and a blackboard that can meet, and those that one walk through
    the tree does not exclude.
    """
    boards = all_boards(tree, VOCABULARY)
    ticked = every_tick(tree, boards, VOCABULARY, MOST_TICKS)
    assume(ticked is not None)
    assert ticked is not None
    machine = machine_of(tree)
    if not any(kind_of(node).reactive or node.kind in TIMED for node in walk(tree)):
        assert reached(machine, boards) == ticked
    sets = boards_of_nodes(machine)
    possible = {
        (place, index)
        for place in machine.statuses
        for index, board in enumerate(boards)
        if machine.sets.has(sets[place], board)
    }
    assert ticked <= possible
    return len(ticked), len(possible)


@examples(max_examples=80, deadline=None)
@given(nodes(few_numbers(), always=False, max_leaves=5, max_repeats=2, nav2=False, if_else=False))
def test_all_ticks_are_those_of_the_engine(tree: Node) -> None:
    """In all sequences of ticks actions meet the same blackboards; no proof excludes one."""
    compare(tree)


@pytest.mark.slow
@settings(max_examples=4_000, deadline=None)
@given(nodes(few_numbers(), always=False, max_leaves=7, max_repeats=3, nav2=False, if_else=False))
def test_all_ticks_of_many_trees_are_those_of_the_engine(tree: Node) -> None:
    """The same for more and larger trees."""
    compare(tree)


def never_on(text: str, action: str, condition: str) -> bool:
    """Whether one walk proves that an action is not ticked where a condition holds; see `stage`."""
    tree = short_tree(text)
    name = short_tree(action).args[0]
    machine = machine_of(tree)
    forbidden = machine.sets.of(guard_of(short_tree(f"when {condition} {{ A }}")).condition)
    sets = boards_of_nodes(machine)
    places = [place for place in machine.statuses if machine.nodes[place].args[0] == name]
    return all(machine.sets.both(sets[place], forbidden) == NO_BOARD for place in places)


# Tree, action, condition. A, D, E, F return anything, B ends at once, C and G never fail.
HOLD = [
    ("when p { A }", "A", "not p"),
    ("when p abort self { sequence { B A } }", "A", "not p"),
    ("when p { repeater 3 { A } }", "A", "not p"),
    ("when x > 3 { inverter { when x < 9 { A } } }", "A", "x == 9 or x <= 3"),
    # A branch of a selector starts where those before it fail.
    ("selector { when p { C } A }", "A", "p"),
    ("selector { when p abort lower { C } A }", "A", "p"),
    ("selector { when x < 20 abort lower { sequence { C G } } when q { B } A }", "A", "x < 10"),
    ("selector { when x < 20 abort lower { sequence { C G } } when q { B } A }", "B", "x < 10"),
    ("selector { when p { when q { C } } A }", "A", "p and q"),
    ("sequence { inverter { when p { C } } A }", "A", "p"),
    ("selector { when p { C } selector { when q { B } A } }", "A", "p"),
    # An action that ends at once hands over in the tick in which it starts.
    ("when p abort none { sequence { B B } }", "B", "not p"),
    ("selector { G when q { B } A }", "A", "p or not p"),
]
DO_NOT = [
    ("when p abort none { A }", "A", "not p"),
    ("when p abort lower { A }", "A", "not p"),
    ("selector { when p { B } A }", "A", "p"),
    ("selector { when p abort self { C } A }", "A", "p"),
    ("selector { when p abort none { C } A }", "A", "p"),
    ("parallel { when p { C } A }", "A", "p"),
    ("selector { when p { when q abort self { C } } A }", "A", "p and q"),
    ("when p abort none { sequence { B A } }", "A", "not p"),
]


@pytest.mark.parametrize(
    ("text", "action", "condition"), HOLD, ids=[f"{t} {c}" for t, _, c in HOLD]
)
def test_proofs(text: str, action: str, condition: str) -> None:
    """One walk proves what follows from guards, and from those of the branches before."""
    assert never_on(text, action, condition)


@pytest.mark.parametrize(
    ("text", "action", "condition"), DO_NOT, ids=[f"{t} {c}" for t, _, c in DO_NOT]
)
def test_no_proofs(text: str, action: str, condition: str) -> None:
    """It proves nothing of guards that are asked at the start only, or do not call back."""
    assert not never_on(text, action, condition)


def test_work_is_bounded() -> None:
    """A search with no steps left refuses to go on."""
    search = Search(machine_of(parse("parallel { PatrolWaypoint SeekCharger }")), 3)
    with pytest.raises(SpentError):
        list(search.moves(None, [0.0] * 5))
