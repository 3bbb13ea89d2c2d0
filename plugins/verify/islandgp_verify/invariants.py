"""The blackboards on which the nodes of a tree can be ticked, found by one walk through the tree.

The sets may be too large, but never too small: they can prove that a node is not ticked on a
blackboard, but not that it is. They are more precise than the conditions of `context`, which
follow the same rules.
"""

from __future__ import annotations

from functools import cache
from typing import NamedTuple

from islandgp.bt.core.kinds import advance_status, is_opaque, kind_of
from islandgp.bt.core.node import FAILURE, RUNNING, SUCCESS, ParallelArgs, count_of
from islandgp_verify.board_outcomes import Outcomes, parallel_outcomes, repeated, turned
from islandgp_verify.boards import ANY_BOARD, NO_BOARD, Boards
from islandgp_verify.machine import Machine


class NodeBoards(NamedTuple):
    """The blackboards on which a node can be ticked."""

    starts: Boards  # in ticks in which it starts
    resumes: Boards  # in ticks in which it is resumed


def boards_of_nodes(machine: Machine) -> list[Boards]:
    """The blackboards on which each node of a tree can be ticked.

    Args:
        machine: the tree.

    Returns:
        A set for each node, in document order. It holds all blackboards on which the node is
        ticked in some sequence of ticks, and perhaps others.
    """
    finder = _Finder(machine)
    boards: list[Boards] = []
    # In document order a child comes after its parent.
    waiting = {0: NodeBoards(ANY_BOARD, ANY_BOARD)}
    for place in range(len(machine.nodes)):
        own = waiting.pop(place)
        if machine.sets.both(own.starts, machine.fresh(place)[RUNNING]) == NO_BOARD:
            own = NodeBoards(own.starts, NO_BOARD)  # it always ends in the tick in which it starts
        boards.append(machine.sets.either(*own))
        waiting.update(zip(machine.children[place], finder.inside(place, own), strict=True))
    return boards


class _Branch(NamedTuple):
    """The blackboards of a branch of a selector or sequence."""

    ticked: NodeBoards
    reachable: Boards  # on which its composite may return to it
    advances: Boards  # on which it ends and the next branch starts


class _Finder:
    """Computes the blackboards of a node's children from those of the node."""

    def __init__(self, machine: Machine) -> None:
        self._machine = machine
        self._sets = machine.sets
        self._resumed_outcomes = cache(self._outcomes)

    def inside(self, place: int, node_boards: NodeBoards) -> list[NodeBoards]:
        """The blackboards on which the children of a node can be ticked."""
        node, (starts, resumes) = self._machine.nodes[place], node_boards
        if is_opaque(node):
            starts = self._sets.either(*node_boards)
            return [NodeBoards(starts, starts)] * len(self._machine.children[place])
        if kind_of(node).reactive:
            return [NodeBoards(each, each) for each in self._in_turn(place, node_boards)[0]]
        if kind_of(node).advance_status is not None:
            return [branch.ticked for branch in self._branches(place, node_boards)]
        if node.guard:
            holds = self._machine.holds[place]
            starts = self._sets.both(starts, holds)
            if node.guard.checks_itself:
                resumes = self._sets.both(resumes, holds)
        if kind_of(node).counts is not None and count_of(node) > 1:
            starts = self._sets.either(starts, resumes)
        if kind_of(node).delayed:
            starts = resumes
        return [NodeBoards(starts, resumes)] * len(self._machine.children[place])

    def _in_turn(self, place: int, node_boards: NodeBoards) -> tuple[list[Boards], Outcomes]:
        """The blackboards of the children of a reactive composite, and its outcomes."""
        advance = advance_status(self._machine.nodes[place])
        entered, outcomes = self._sets.either(*node_boards), [NO_BOARD] * 3
        ticked: list[Boards] = []
        for child in self._machine.children[place]:
            ticked.append(entered)
            ends = self._machine.either(self._machine.fresh(child), self._resumed_outcomes(child))
            for status in (1 - advance, RUNNING):
                reached = self._sets.both(entered, ends[status])
                outcomes[status] = self._sets.either(outcomes[status], reached)
            entered = self._sets.both(entered, ends[advance])
        outcomes[advance] = entered
        return ticked, (outcomes[0], outcomes[1], outcomes[2])

    def _branches(self, place: int, node_boards: NodeBoards) -> list[_Branch]:
        """The branches of a composite, in order."""
        both, either = self._sets.both, self._sets.either
        calls = self._calls_back(place)
        entered, quiet = node_boards.starts, ANY_BOARD
        branches: list[_Branch] = []
        for at, child in enumerate(self._machine.children[place]):
            branch = self._branch(
                place, child, both(quiet, entered), both(quiet, node_boards.resumes)
            )
            if at in calls and branch.advances != NO_BOARD:
                # A later branch can be running, and the composite may return to this one.
                called_boards = both(quiet, node_boards.resumes, calls[at])
                starts = both(quiet, either(entered, called_boards))
                branch = self._branch(place, child, starts, both(quiet, node_boards.resumes))
                branch = branch._replace(reachable=called_boards)
            branches.append(branch)
            entered = branch.advances
            quiet = both(quiet, self._quiet_behind(child, entered))
        return branches

    def _branch(self, place: int, child: int, starts: Boards, resumes: Boards) -> _Branch:
        both, fresh = self._sets.both, self._machine.fresh(child)
        advance = advance_status(self._machine.nodes[place])
        fresh_ends = both(starts, fresh[advance])
        if both(starts, fresh[RUNNING]) == NO_BOARD:
            return _Branch(NodeBoards(starts, NO_BOARD), NO_BOARD, fresh_ends)
        resumed_ends = both(resumes, self._resumed_outcomes(child)[advance])
        return _Branch(
            NodeBoards(starts, resumes), NO_BOARD, self._sets.either(fresh_ends, resumed_ends)
        )

    def _calls_back(self, place: int) -> dict[int, Boards]:
        """The blackboards on which an observed guard can become true, by branch."""
        interrupts: dict[int, Boards] = {}
        for branch, guard in self._machine.observed[place]:
            holds = self._machine.holds[guard]
            interrupts[branch] = self._sets.either(interrupts.get(branch, NO_BOARD), holds)
        return interrupts

    def _quiet_behind(self, child: int, entered: Boards) -> Boards:
        """A superset of the blackboards on which a branch after a child is ticked.

        `entered` are the blackboards on which the child ends and the next branch starts.

        Take the first guards of the child, as long as they interrupt. If they never hold together
        on `entered`, they do not hold together while a later branch is ticked:

        1. When the child ends, let g be the first of them that is false. It was evaluated since
           the child started. Otherwise a guard before it was false when the child ended,
           and so was observed; it is true now, so it has become true, and the composite has gone
           back and started the child again.
        2. So g is observed and false. As soon as it becomes true, the composite goes back to the
           child or to a branch before it.
        """
        together, one_fails = ANY_BOARD, NO_BOARD
        for guard in self._machine.guards(child):
            args = self._machine.nodes[guard].guard
            if args is None or not args.interrupts:
                break
            together = self._sets.both(together, self._machine.holds[guard])
            one_fails = self._sets.either(one_fails, self._machine.fails[guard])
            if self._sets.both(entered, together) == NO_BOARD:
                return one_fails
        return ANY_BOARD

    def _outcomes(self, place: int) -> Outcomes:
        """The outcomes of a node that is resumed, with any memory."""
        machine, node = self._machine, self._machine.nodes[place]
        children = machine.children[place]
        kind = kind_of(node)
        if not children:
            return machine.fresh(place)
        if is_opaque(node):
            return ANY_BOARD, ANY_BOARD, ANY_BOARD
        if kind.reactive:
            return self._in_turn(place, NodeBoards(ANY_BOARD, ANY_BOARD))[1]
        if kind.advance_status is not None:
            return self._of_composite(place)
        if isinstance(node.args, ParallelArgs):
            needed = node.args.needed(len(children))
            each = [self._in_parallel(child, needed) for child in children]
            return parallel_outcomes(self._sets, node.args, each)
        inside = self._resumed_outcomes(children[0])
        if node.guard:
            return machine.guarded(place, inside) if node.guard.checks_itself else inside
        if kind.delayed:
            failure, success, _ = machine.either(inside, machine.fresh(children[0]))
            return failure, success, ANY_BOARD
        if kind.counts is None:
            return turned(self._sets, node, inside)
        if count_of(node) == 1:
            return inside
        restarts = machine.either(inside, machine.fresh(children[0]))
        return machine.either(restarts, repeated(self._sets, node, restarts, last=False))

    def _in_parallel(self, child: int, needed: tuple[int, int]) -> Outcomes:
        """The outcomes of a child of a running parallel; the child may have ended before."""
        fresh, resumed = self._machine.fresh(child), self._resumed_outcomes(child)
        outcomes = list(resumed)
        for status, count in zip((SUCCESS, FAILURE), needed, strict=True):
            # If one such end is enough, the parallel would have ended too.
            if count > 1 and (fresh[status], resumed[status]) != (NO_BOARD, NO_BOARD):
                outcomes[status] = ANY_BOARD
        return outcomes[0], outcomes[1], outcomes[2]

    def _of_composite(self, place: int) -> Outcomes:
        both, either = self._sets.both, self._sets.either
        advance = advance_status(self._machine.nodes[place])
        branches = self._branches(place, NodeBoards(ANY_BOARD, ANY_BOARD))
        outcomes = [NO_BOARD] * 3
        entered = NO_BOARD  # on which the branch starts in a tick in which its composite is resumed
        for child, branch in zip(self._machine.children[place], branches, strict=True):
            entered = both(branch.ticked.starts, either(entered, branch.reachable))
            each = [both(entered, boards) for boards in self._machine.fresh(child)]
            if branch.ticked.resumes != NO_BOARD:
                later = (
                    both(branch.ticked.resumes, boards) for boards in self._resumed_outcomes(child)
                )
                each = [either(*pair) for pair in zip(each, later, strict=True)]
            entered = each[advance]
            for status in (1 - advance, RUNNING):
                outcomes[status] = either(outcomes[status], each[status])
        outcomes[advance] = entered  # by the last branch
        return outcomes[0], outcomes[1], outcomes[2]
