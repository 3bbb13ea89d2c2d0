"""Trees from the best policy of a small world that was seen, by value iteration.

Where actions never fail, they teach no needs: what counts is where each of them leads. If all keys
have few values, the states that the episodes visited and the transitions between them are a Markov
decision process (Sutton and Barto 2018, Reinforcement Learning, section 4.4). Its best policy is a
priority list with a guard for each action, in the states in which it is the best.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Final

import numpy as np

from islandgp.bt.core.condition import Condition, ConditionExpr, combine
from islandgp.bt.core.language import parse
from islandgp.bt.core.node import Node, guarded, selector
from islandgp.bt.core.vocabulary import Vocabulary
from islandgp_plans.action_models import ActionRecord, Board, Cell, small_world

MAX_STATES: Final = 100
MAX_KEYS: Final = 3
DISCOUNT: Final = 0.99
SWEEPS: Final = 300  # of value iteration


def best_policy(
    records: Mapping[str, ActionRecord], vocabulary: Vocabulary, *, optimistic: bool
) -> Node | None:
    """The tree of the best policy; None if the world is not small, or no action earned points.

    Args:
        records: of the actions.
        vocabulary: of the domain.
        optimistic: actions that were never tried in a state are taken to be the best, as in R-max.
    """
    if not small_world(vocabulary) or len(vocabulary.keys) > MAX_KEYS:
        return None
    actions = [text for text, record in records.items() if record.successes]
    cells = {text: (*records[text].successes, *records[text].failures) for text in actions}
    states = list(dict.fromkeys(cell.start for each in cells.values() for cell in each))
    most = max((cell.points for each in cells.values() for cell in each), default=0.0)
    if not 1 < len(states) <= MAX_STATES or most <= 0:
        return None
    values = _values(cells, states, most if optimistic else 0.0)
    best = values.argmax(axis=1)
    chosen = sorted(set(best.tolist()), key=lambda a: int(np.sum(best == a)))
    leaves = [parse(actions[a], vocabulary) for a in chosen]
    guards = [
        combine("or", [_state(s, vocabulary) for s, b in zip(states, best, strict=True) if b == a])
        for a in chosen
    ]
    nodes = [guarded(guard, leaf) for guard, leaf in zip(guards, leaves, strict=True)]
    return selector(*nodes[:-1], leaves[-1]) if len(nodes) > 1 else leaves[0]


def _values(
    cells: Mapping[str, Sequence[Cell]], states: Sequence[Board], untried: float
) -> np.ndarray:
    """The value of each action in each state, of shape (states, actions)."""
    index = {state: k for k, state in enumerate(states)}
    n = len(states)
    chance = np.zeros((len(cells), n, n))
    points = np.zeros((n, len(cells)))
    tried = np.zeros((n, len(cells)))
    for a, each in enumerate(cells.values()):
        for cell in each:
            s = index[cell.start]
            tried[s, a] += sum(count for _, count in cell.ends)
            points[s, a] += cell.points * cell.count
            for end, count in cell.ends:
                if end in index:  # others ended the episode
                    chance[a, s, index[end]] += count
    times = np.maximum(tried, 1)
    chance /= times.T[:, :, None]
    values = np.zeros(n)
    for _ in range(SWEEPS):
        of_actions = points / times + DISCOUNT * (chance @ values).T
        of_actions[tried == 0] = untried
        values = of_actions.max(axis=1)
    result: np.ndarray = of_actions
    return result


def _state(board: Board, vocabulary: Vocabulary) -> ConditionExpr:
    """The condition that the blackboard is in a state."""
    terms = []
    for (name, key), value in zip(vocabulary.keys.items(), board, strict=True):
        if key.flag:
            terms.append(Condition(name, "is" if value else "not", 0.0))
        else:
            number = key.number_of(key.words[int(value)]) if key.words else value
            terms.append(Condition(name, "==", number))
    return combine("and", terms)
