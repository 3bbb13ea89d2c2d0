"""What holds for every tree: it runs as the reference does, and a quiet tick changes nothing."""

from __future__ import annotations

from collections.abc import Callable, Iterator

from hypothesis import given
from hypothesis import strategies as st

from islandgp.bt.core.condition import condition
from islandgp.bt.core.engine import compile_tree
from islandgp.bt.core.node import FAILURE, RUNNING, SUCCESS, Node, guard_of, leaf, walk
from islandgp.domains.island.vocabulary import VOCABULARY
from tests.bt.reference import Reference
from tests.profiles import examples
from tests.strategies import few_boards, few_numbers, nodes

Call = tuple[str, bool, int]  # (leaf, fresh, status)

PLACES = VOCABULARY.key_index
TREES = nodes(few_numbers(), max_leaves=10, max_repeats=3)
QUIET = nodes(few_numbers(), max_leaves=10, max_repeats=3, timed=False)  # a clock is never quiet
BOARDS = st.lists(few_boards(), min_size=2, max_size=12)
RESULTS = st.lists(st.sampled_from([FAILURE, SUCCESS, RUNNING, RUNNING]), min_size=1, max_size=40)


class Actions:
    """Leaves that give one result after the other, and write down how they were called."""

    def __init__(self, tree: Node, results: list[int]) -> None:
        self.calls: list[Call] = []
        self.frozen = False  # every action stays RUNNING, and no result is used up
        self._results = results
        self._next = 0
        names = [node.action for node in walk(tree) if node.action]
        self.table = {name: self._leaf(name) for name in names}

    def _leaf(self, name: str) -> Callable[[bool], int]:
        def act(fresh: bool) -> int:
            status = RUNNING
            if not self.frozen:
                status = self._results[self._next % len(self._results)]
                self._next += 1
            self.calls.append((name, fresh, status))
            return status

        return act

    def take(self) -> list[Call]:
        calls, self.calls = self.calls, []
        return calls


def with_unique_names(node: Node, numbers: Iterator[int]) -> Node:
    """The tree with a unique name for each leaf, so that calls identify leaves."""
    if node.action:
        return leaf(f"leaf {next(numbers)}")
    return node._replace(
        children=tuple(with_unique_names(child, numbers) for child in node.children)
    )


@examples(max_examples=600, deadline=None)
@given(tree=TREES, boards=BOARDS, results=RESULTS)
def test_engine_is_the_reference(tree: Node, boards: list[list[float]], results: list[int]) -> None:
    """The compiled tree calls the same actions and reports the same events as the reference."""
    tree = with_unique_names(tree, iter(range(100)))
    board = list(boards[0])
    events: list[tuple[int, int]] = []
    expected_events: list[tuple[int, int]] = []
    actions, expected_actions = Actions(tree, results), Actions(tree, results)
    tick = compile_tree(
        tree, actions.table, board, PLACES, watch=lambda *event: events.append(event), step_s=1.0
    )
    reference = Reference(
        tree,
        expected_actions.table,
        board,
        PLACES,
        watch=lambda *event: expected_events.append(event),
    )
    for values in boards:
        board[:] = values
        assert tick() == reference.tick()
        assert actions.take() == expected_actions.take()
        # The reference aborts before it ticks, the engine on the way.
        assert sorted(events) == sorted(expected_events)
        events.clear()
        expected_events.clear()


@examples(max_examples=600, deadline=None)
@given(tree=QUIET, boards=BOARDS, quiet=BOARDS, results=RESULTS)
def test_quiet_ticks_change_nothing(
    tree: Node, boards: list[list[float]], quiet: list[list[float]], results: list[int]
) -> None:
    """After RUNNING, ticks that change no condition's truth resume what was RUNNING, no more.

    So a caller may leave such ticks out, which the island does.
    """
    tree = with_unique_names(tree, iter(range(100)))
    board, other_board = list(boards[0]), list(boards[0])
    expressions = [guard_of(node).condition for node in walk(tree) if node.guard]
    guards = [condition(each, board, PLACES) for each in expressions]
    actions, other_actions = Actions(tree, results), Actions(tree, results)
    tick = compile_tree(tree, actions.table, board, PLACES, step_s=1.0)
    other_tick = compile_tree(tree, other_actions.table, other_board, PLACES, step_s=1.0)
    for values in boards:
        board[:] = other_board[:] = values
        status = tick()
        calls = actions.take()
        assert other_tick() == status
        assert other_actions.take() == calls
        running = [leaf for leaf, _, result in calls if result == RUNNING]
        truths = [guard() for guard in guards]
        for quiet_values in (values, *quiet):
            board[:] = quiet_values
            if status != RUNNING or [guard() for guard in guards] != truths:
                continue
            actions.frozen = True
            assert tick() == RUNNING
            assert actions.take() == [(leaf, False, RUNNING) for leaf in running]
            actions.frozen = False
