"""Compiles a tree to a function that ticks it once.

`docs/semantics.md` specifies the nodes. A node is a function of `fresh`: True starts it, False
resumes it where it was RUNNING. So an abort does not visit the subtree: its next tick has
`fresh=True`. Guards are checked on the way down from the root. Only a `set` changes the blackboard
within a tick; what is ticked after it sees the new value.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import SupportsFloat

from islandgp.bt.core.compiler import ABORTED, Actions, Compiler, Tick, Watch
from islandgp.bt.core.condition import Board, condition
from islandgp.bt.core.kinds import KINDS, needs_each_tick
from islandgp.bt.core.node import AGAIN, RUNNING, Node

__all__ = ["ABORTED", "Board", "Tick", "Watch", "compile_tree", "condition"]


def compile_tree(
    tree: Node,
    actions: Actions,
    board: Board,
    key_index: Mapping[str, int],
    *,
    watch: Watch | None = None,
    step_s: SupportsFloat | None = None,
    seed: int = 0,
) -> Callable[[], int]:
    """Compiles a tree to a function that ticks it once.

    Args:
        tree: the root. A node object that occurs twice runs as two nodes.
        actions: a function per action name in the tree, looked up once for each leaf; or a
            function that makes one from the arguments of a leaf. It is called with `fresh`: True
            if the leaf starts now, False if it was RUNNING in the tick before. If it has a method
            `stop`, this is called when a part of the tree with the leaf is stopped, even if the
            leaf was not running.
        board: a value per key; the caller may change them between ticks only. A `set` writes it.
        key_index: index of each key in `board`, as `Vocabulary.key_index`.
        watch: called for each node that is ticked, children before parents, and with ABORTED for
            each running node that is stopped. None is fastest. An aborted action is called with
            `fresh` True at its next start.
        step_s: seconds between two ticks, > 0; required if the tree counts seconds. A tree that
            `needs_each_tick` has to be ticked in each step.
        seed: of the orders that a random_selector draws, e.g. that of the episode.

    Returns:
        The tick function. It returns FAILURE, SUCCESS, RUNNING or AGAIN. After RUNNING a caller may
        skip ticks as long as no condition changes its truth and each running action stays RUNNING;
        after AGAIN it must not skip the next tick (see `node.AGAIN`).

    Raises:
        KeyError: an action of the tree is missing in `actions`, or a key in `key_index`.
        DomainError: the tree counts seconds, and `step_s` is None.
    """
    compiler = Compiler(KINDS, actions, board, key_index, watch, step_s, seed)
    root = compiler.compile(tree, None)
    fresh, timed = True, needs_each_tick(tree)

    def tick() -> int:
        nonlocal fresh
        if timed:
            compiler.now += 1
        status = root(fresh)
        fresh = status < RUNNING
        if compiler.changed_midtick:
            # The effect of an aborted action, such as driving, ends on the next tick.
            compiler.changed_midtick = False
            return AGAIN if status == RUNNING else status
        return status

    return tick
