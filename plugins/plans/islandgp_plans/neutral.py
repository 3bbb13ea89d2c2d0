"""Finds children that would act as their mother did, without an episode.

A third of the children of `racing` behave exactly as their mother in the same world, for example if
a number in a guard moves between two values that never occur. Both trees are ticked on the
blackboards on which the mother's actions started in her last evaluation, once with all actions
running and once with actions ending as they did there. If they call the same actions, the child is
taken as neutral. It may still differ where the blackboard changes while an action runs.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from islandgp.bt.core.engine import Tick, compile_tree
from islandgp.bt.core.node import FAILURE, RUNNING, SUCCESS, ActionArgs, Node
from islandgp.bt.core.printer import head
from islandgp.bt.core.vocabulary import Vocabulary
from islandgp.gp.evidence import digest
from islandgp_plans.action_models import ActionSample, without_numbers

Calls = tuple[ActionArgs, ...]


class Screen:
    """Compares children with their mothers on what the mothers visited."""

    def __init__(
        self, vocabulary: Vocabulary, visited: Mapping[str, Sequence[ActionSample]]
    ) -> None:
        """`visited` has the samples of the last evaluation of each mother, by digest."""
        self._vocabulary, self._visited = vocabulary, visited
        self._calls: dict[str, list[Calls]] = {}  # of mothers

    def neutral(self, child: Node, mother: Node) -> bool:
        """True if a child calls the same actions as its mother wherever she was."""
        name = digest(mother)
        if not (samples := self._visited.get(name, ())):
            return False
        if name not in self._calls:
            self._calls[name] = calls(mother, samples, self._vocabulary)
        return calls(child, samples, self._vocabulary) == self._calls[name]


def calls(tree: Node, samples: Sequence[ActionSample], vocabulary: Vocabulary) -> list[Calls]:
    """The actions that a tree calls in its first tick, on the blackboard of each sample.

    Args:
        tree: any tree of the vocabulary.
        samples: with known starts.
        vocabulary: of the domain.

    Returns:
        For each distinct start the actions called if all run, then, again for each start, those
        called if actions end as in the samples.
    """
    ended = {(s.action, s.start): SUCCESS if s.succeeded else FAILURE for s in samples}
    starts = dict.fromkeys(s.start for s in samples)
    return [
        _first_tick(tree, start, ended if ends else {}, vocabulary)
        for ends in (False, True)
        for start in starts
    ]


def _first_tick(
    tree: Node,
    board: tuple[float, ...],
    ended: dict[tuple[str, tuple[float, ...]], int],
    vocabulary: Vocabulary,
) -> Calls:
    called: list[ActionArgs] = []

    def leaf_of(args: ActionArgs) -> Tick:
        status = RUNNING
        if ended:
            text = head(without_numbers(Node("action", args), vocabulary))
            status = ended.get((text, board), RUNNING)

        def tick(_fresh: bool) -> int:
            called.append(args)
            return status

        return tick

    compile_tree(tree, leaf_of, board, vocabulary.key_index, step_s=1.0)()
    return tuple(called)
