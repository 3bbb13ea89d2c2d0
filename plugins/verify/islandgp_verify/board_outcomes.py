"""The outcomes of nodes by blackboard, computed from the outcomes of their children."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TypeAlias

from islandgp.bt.core.kinds import kind_of
from islandgp.bt.core.node import FAILURE, RUNNING, SUCCESS, Node, ParallelArgs
from islandgp_verify.boards import ANY_BOARD, NO_BOARD, Boards, BoardSets

Outcomes: TypeAlias = tuple[Boards, Boards, Boards]
"""The blackboards on which a node can end a tick with FAILURE, SUCCESS and RUNNING (or AGAIN)."""


def repeated(sets: BoardSets, node: Node, child: Outcomes, *, last: bool) -> Outcomes:
    """The outcomes of a counting node, from its child's; `last`: one more counted end ends it."""
    counted = kind_of(node).counts
    if last or counted is None:
        return child
    outcomes = list(child)
    outcomes[counted] = NO_BOARD
    return outcomes[0], outcomes[1], sets.either(child[counted], child[RUNNING])


def turned(sets: BoardSets, decorator: Node, child: Outcomes) -> Outcomes:
    """The outcomes of a decorator that maps its child's statuses, from those of its child."""
    outcomes = [NO_BOARD, NO_BOARD, child[RUNNING]]
    for status, end in enumerate(kind_of(decorator).ends):
        outcomes[end] = sets.either(outcomes[end], child[status])
    return ANY_BOARD if kind_of(decorator).may_fail else outcomes[0], outcomes[1], outcomes[2]


def parallel_outcomes(
    sets: BoardSets, parallel: ParallelArgs, children: Sequence[Outcomes]
) -> Outcomes:
    """The outcomes of a parallel, from those of its children."""
    needed = parallel.needed(len(children))
    counts: dict[tuple[int, ...], Boards] = {(0, 0, 0): ANY_BOARD}  # by FAILURE, SUCCESS, RUNNING
    for outcomes in children:
        extended: dict[tuple[int, ...], Boards] = {}
        for count, boards in counts.items():
            for status, ends in enumerate(outcomes):
                key = tuple(number + (at == status) for at, number in enumerate(count))
                extended[key] = sets.either(extended.get(key, NO_BOARD), sets.both(boards, ends))
        counts = extended
    result = [NO_BOARD] * 3
    for (failed, succeeded, running), boards in counts.items():
        decided = SUCCESS if succeeded >= needed[0] else RUNNING if running else FAILURE
        status = FAILURE if failed >= needed[1] else decided
        result[status] = sets.either(result[status], boards)
    return result[0], result[1], result[2]


def parallel_status(parallel: ParallelArgs, statuses: Sequence[int]) -> int:
    """The status of a parallel whose children have these statuses, as `closures.parallel`."""
    success, failure = parallel.needed(len(statuses))
    succeeded, failed = statuses.count(SUCCESS), statuses.count(FAILURE)
    if failed < failure and succeeded < success and succeeded + failed < len(statuses):
        return RUNNING
    return SUCCESS if failed < failure and succeeded >= success else FAILURE
