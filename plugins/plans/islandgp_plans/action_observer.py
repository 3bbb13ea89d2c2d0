"""Observes the actions of an episode: where each started, how it ended, and what it earned."""

from __future__ import annotations

from collections import Counter, defaultdict
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

from islandgp.bt.core.engine import ABORTED
from islandgp.bt.core.node import FAILURE, RUNNING, SUCCESS, Node, walk
from islandgp.bt.core.printer import head
from islandgp.bt.core.vocabulary import Vocabulary
from islandgp.domain import Scene
from islandgp_plans.action_models import ActionSample, cell_of, small_world, without_numbers

WAITING: Final = -1
MAX_CELLS: Final = 12  # of an episode, by action and result


@dataclass(slots=True)
class _Execution:
    """An execution of a leaf."""

    action: str
    start: tuple[float, ...]
    known_start: bool  # False: an action before it in the same tick may have changed the world
    points: float = 0.0
    status: int = RUNNING  # WAITING after its first tick
    known_end: bool = True


_Start = tuple[str, bool, tuple[float, ...], tuple[float, ...], bool]
"""Action, success, the blackboard at its start, in a small world that after its end, and `last`."""
_Cell = tuple[str, bool, tuple[int, ...], tuple[float, ...], bool]
"""The same, with the cell of the start."""


class ActionObserver:
    """An `EpisodeObserver` of one episode. The samples are a function of the episode alone.

    The blackboard is read once a tick. So the start of an action is that of its first tick if no
    other one ran or succeeded before it in this tick, else that of its second tick. Its end is
    known if no other one succeeded after it.
    """

    scenes = False

    def __init__(self, tree: Node, vocabulary: Vocabulary) -> None:
        self._vocabulary, self._small = vocabulary, small_world(vocabulary)
        self._leaves = {
            place: (node.action, head(without_numbers(node, vocabulary)))
            for place, node in enumerate(walk(tree))
            if node.action
        }
        self._calls: list[tuple[int, int]] = []  # of the tick: place and status
        self._credits: defaultdict[str, float] = defaultdict(float)  # by action, not yet attributed
        self._running: dict[int, _Execution] = {}  # by place
        self._ended: list[_Execution] = []  # in the last tick
        self._seen: dict[_Start, tuple[tuple[float, ...], float, int]] = {}

    def node(self, place: int, status: int) -> None:
        """See `Observer`."""
        if place not in self._leaves:
            return
        if status == ABORTED:
            self._running.pop(place, None)
        else:
            self._calls.append((place, status))

    def credit(self, component: str, points: float, event: str, action: str) -> None:  # noqa: ARG002 -- the protocol's
        """See `Observer`."""
        self._credits[action] += points

    def tick(self, board: Sequence[float], scene: Scene | None) -> None:  # noqa: ARG002 -- the protocol's
        """See `Observer`."""
        now = tuple(board)
        ended, self._ended = self._ended, []
        untouched = True
        for place, status in self._calls:
            name, text = self._leaves[place]
            execution = self._running.pop(place, None) or _Execution(text, now, untouched)
            if not execution.known_start and execution.status == WAITING:
                execution.start, execution.known_start = now, True
            execution.points += self._credits.pop(name, 0.0)
            untouched = untouched and status == FAILURE
            for earlier in self._ended if status == SUCCESS else ():
                earlier.known_end = False
            if status >= RUNNING:
                execution.status = WAITING
                self._running[place] = execution
            else:
                execution.status = status
                self._ended.append(execution)
        for execution in ended:
            execution.points += self._credits.pop(execution.action.partition("(")[0], 0.0)
            self._keep(execution, now)
        self._calls.clear()
        self._credits.clear()

    def result(self) -> tuple[ActionSample, ...]:
        """The samples of the episode, which has ended; one for each cell of the blackboard."""
        for execution in self._ended:
            execution.points += self._credits.pop(execution.action.partition("(")[0], 0.0)
            self._keep(execution, (), last=True)
        self._ended = []
        samples: dict[_Cell, ActionSample] = {}
        cells: Counter[tuple[str, bool]] = Counter()
        for (action, succeeded, start, _, last), (end, points, count) in self._seen.items():
            place = cell_of(start, self._vocabulary) if start else ()
            cell = (action, succeeded, place, end if self._small else (), last)
            if (known := samples.get(cell)) is not None:
                n = known.times + count
                mean = known.points + (points - known.points * count) / n
                samples[cell] = known._replace(points=mean, times=n)
            elif self._small or cells[action, succeeded] < MAX_CELLS:
                cells[action, succeeded] += 1
                samples[cell] = ActionSample(
                    action, succeeded, start, end, points / count, count, last
                )
        return tuple(samples.values())

    def _keep(self, execution: _Execution, after: tuple[float, ...], *, last: bool = False) -> None:
        start = execution.start if execution.known_start else ()
        end = after if execution.known_end and start else ()
        succeeded = execution.status == SUCCESS
        last = last and execution.known_end
        kind = (execution.action, succeeded, start, end if self._small else (), last)
        before, points, count = self._seen.get(kind, ((), 0.0, 0))
        self._seen[kind] = (before or end, points + execution.points, count + 1)
