"""A stage for engine tests: trees with short names, actions that follow a script.

In a stage's text, A to G are actions, `p` and `q` are flags, `x` is a number and `n` a whole one.
"""

from __future__ import annotations

import re
from collections.abc import Callable

from islandgp.bt.core.engine import compile_tree
from islandgp.bt.core.language import parse
from islandgp.bt.core.node import FAILURE, RUNNING, SUCCESS, Node
from islandgp.domains.island.vocabulary import VOCABULARY

_ACTIONS = dict(zip("ABCDEFG", VOCABULARY.actions, strict=True))
_KEYS = {"p": "foundGarbage", "q": "isHumanoidWantToClear", "x": "batteryLevel", "n": "lap"}
_LETTERS = {"F": FAILURE, "S": SUCCESS, "R": RUNNING}


def short_text(text: str) -> str:
    """A text with the island's names in place of the short ones."""
    names = _ACTIONS | _KEYS
    return re.sub(r"\b[A-Gnpqx]\b", lambda word: names[word[0]], text)


def short_tree(text: str) -> Node:
    """A tree from its short text."""
    return parse(short_text(text), VOCABULARY)


class Stage:
    """A compiled tree whose actions follow a script.

    A script has a letter a call, F, S or R; the last letter goes on for ever,
    and an action without a script is always RUNNING.
    """

    def __init__(self, text: str, board: str = "", **scripts: str) -> None:
        self.events: list[tuple[int, int]] = []  # (place, status) as watched in the last tick
        self._calls: list[str] = []
        self._board = [0.0] * len(VOCABULARY.keys)
        self._set(**dict.fromkeys(board, 1.0))
        actions = {
            name: self._action(letter, scripts.get(letter, "R"))
            for letter, name in _ACTIONS.items()
        }
        self._tick = compile_tree(
            short_tree(text),
            actions,
            self._board,
            VOCABULARY.key_index,
            watch=lambda *event: self.events.append(event),
            step_s=1.0,
        )

    def tick(self, **changes: float) -> tuple[str, int]:
        """Ticks once after changing the board.

        Returns:
            The actions called, "A B!" with a mark for a fresh start, and the root's status.
        """
        self._set(**changes)
        self._calls.clear()
        self.events.clear()
        status = self._tick()
        return " ".join(self._calls), status

    def _set(self, **values: float) -> None:
        for letter, value in values.items():
            self._board[VOCABULARY.key_index[_KEYS[letter]]] = value

    def _action(self, letter: str, script: str) -> Callable[[bool], int]:
        coming = list(script)

        def act(fresh: bool) -> int:
            self._calls.append(letter + ("!" if fresh else ""))
            return _LETTERS[coming.pop(0) if len(coming) > 1 else coming[0]]

        return act
