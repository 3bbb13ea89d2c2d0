"""Records an episode tick by tick: statuses of nodes, blackboard, points, and scenes."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from itertools import chain
from math import floor, log10
from typing import Final, NamedTuple

from islandgp.bt.core.engine import ABORTED
from islandgp.bt.core.node import AGAIN, FAILURE, RUNNING, SUCCESS, Node, size
from islandgp.domain import Outcome, Scene, Schema
from islandgp.errors import DomainError
from islandgp.evaluation.base import Problem, in_floats
from islandgp.leaves import is_number
from islandgp.time_limit import time_limit

IDLE, FAILED, SUCCEEDED, RUNS, STOPPED = range(5)
"""The last status of a node in a tick; IDLE: it was not ticked."""

_CODES: Final = {FAILURE: FAILED, SUCCESS: SUCCEEDED, RUNNING: RUNS, AGAIN: RUNS, ABORTED: STOPPED}

MAX_NUMBER: Final = 1e300  # above this, differences of numbers are infinite


class Credit(NamedTuple):
    """Points that an event earned."""

    tick: int
    event: str
    component: str
    points: float
    action: str  # that earned them, or ""


@dataclass(frozen=True, slots=True)
class Recording:
    """One episode of `ticks` ticks, at least one."""

    tree: Node
    schema: Schema
    seed: int  # of the world
    stage: int  # index into Table 2
    step_s: float  # simulated s of a tick
    ticks: int
    statuses: tuple[bytes, ...]  # per node in document order, a code per tick
    boards: tuple[tuple[float, ...], ...]  # per tick, a value per key of the vocabulary
    credits: tuple[Credit, ...]  # in order of time
    scenes: tuple[Scene, ...]  # per tick; (): the domain draws nothing
    frames: tuple[tuple[int, bytes], ...]  # a tick and the PNG from then on
    outcome: Outcome

    @property
    def digits(self) -> int:
        """Number of decimals of points in displays."""
        return digits((self.outcome.fitness, *self.outcome.components.values()))


def digits(values: Iterable[float]) -> int:
    """Decimals that show three significant digits of the largest value; 0 to 6."""
    most = max(map(abs, values), default=0.0)
    return min(6, max(0, 2 - floor(log10(most)))) if most > 0 else 0


def record(tree: Node, problem: Problem, *, seed: int, stage: int, limit: float = 0) -> Recording:
    """Runs a tree in the world of `seed`, scored as in the stage of that index, and records it.

    `limit`: seconds that the episode may take, as in `time_limit`; 0: any time.

    Raises:
        TimeLimitError: the episode took longer.
        DomainError: the domain shows something undeclared, or a value that is not a number.
    """
    domain = problem.in_world(stage, seed)
    schema = domain.schema
    recorder = Recorder(tree, schema)
    weights = problem.curriculum.multipliers(stage)
    domain.prepare()
    with time_limit(limit):
        outcome = domain.run_episode(tree, seed, weights, recorder)
    ticks = recorder.finish()
    points = [*outcome.components.values(), *(credit.points for credit in recorder.credits)]
    _must_be_numbers("points", [*points, outcome.fitness])
    _must_be_numbers("the seconds of an episode", [outcome.seconds, domain.step_s])
    scenes = tuple(recorder.drawn) + tuple(recorder.drawn[-1:]) * (ticks - len(recorder.drawn))
    _must_be_drawable(scenes, schema)
    return Recording(
        tree=tree,
        schema=schema,
        seed=seed,
        stage=stage,
        step_s=domain.step_s,
        ticks=ticks,
        statuses=recorder.statuses(),
        boards=tuple(recorder.boards),
        credits=tuple(c._replace(tick=min(c.tick, ticks - 1)) for c in recorder.credits),
        scenes=scenes,
        frames=tuple(recorder.frames),
        outcome=in_floats(outcome),
    )


class Recorder:
    """An observer that records an episode."""

    def __init__(self, tree: Node, schema: Schema) -> None:
        self.boards: list[tuple[float, ...]] = []
        self.credits: list[Credit] = []
        self.drawn: list[Scene] = []  # per tick, up to the last one
        self.frames: list[tuple[int, bytes]] = []
        self._components = schema.components
        self._keys = len(schema.vocabulary.keys)
        self._idle = bytes(size(tree))
        self._now = bytearray(self._idle)  # codes of this tick by node
        self._codes: list[bytes] = []  # of each tick

    def node(self, place: int, status: int) -> None:
        """See `Observer`."""
        self._now[place] = _CODES[status]

    def credit(self, component: str, points: float, event: str, action: str) -> None:
        """See `Observer`."""
        if component in self._components:
            self.credits.append(Credit(len(self.boards), event, component, float(points), action))
        elif points:
            names = ", ".join(self._components)
            raise DomainError(
                f"Expected points for a component of the schema ({names}), found {component!r}"
                f" for the event {event!r}; name one of them."
            )

    def tick(self, board: Sequence[float], scene: Scene | None) -> None:
        """See `Observer`."""
        if len(board) != self._keys:
            raise DomainError(
                f"Expected a value for each of the {self._keys} keys of the vocabulary on the"
                f" blackboard, found {len(board)}; give the observer one for each, in their order."
            )
        if scene is not None:
            if self.drawn and scene.items == self.drawn[-1].items:  # keep them once
                scene = replace(scene, items=self.drawn[-1].items)
            self.drawn += [scene] * (len(self.boards) + 1 - len(self.drawn))
            frame = b"" if scene.frame is None else scene.frame()
            if frame and (not self.frames or frame != self.frames[-1][1]):
                self.frames.append((len(self.boards), frame))
        self.boards.append(tuple(map(float, board)))
        self._codes.append(bytes(self._now))
        self._now[:] = self._idle

    def finish(self) -> int:
        """The number of ticks, once the episode is over; at least one.

        Nodes that were ticked after the last `tick` call belong to a further tick.
        """
        if not self.boards or self._now != self._idle:
            self.tick(self.boards[-1] if self.boards else [0.0] * self._keys, None)
        return len(self.boards)

    def statuses(self) -> tuple[bytes, ...]:
        """The codes of each node, a byte per tick."""
        codes, nodes = b"".join(self._codes), len(self._idle)
        return tuple(codes[place::nodes] for place in range(nodes))


def _must_be_drawable(scenes: Sequence[Scene], schema: Schema) -> None:
    """Raises DomainError for scenes with other styles, numbers of movers, or no finite numbers."""
    counts = {len(scene.movers) for scene in scenes}
    if len(counts) > 1:
        raise DomainError(
            f"Expected as many movers in each tick, found {min(counts)} and {max(counts)}; what"
            " comes and goes belongs to the items of a scene."
        )
    groups = {id(group): group for s in scenes for group in (s.fixed, s.items, s.movers)}
    shapes = {*chain.from_iterable(groups.values())}
    _must_be_numbers("the bounds of a scene", chain(*{scene.bounds for scene in scenes}))
    _must_be_numbers("the places and sizes of shapes", chain(*(shape[1:4] for shape in shapes)))
    if unknown := {shape.style for shape in shapes} - schema.styles.keys():
        styles = ", ".join(schema.styles) or "none"
        raise DomainError(
            f"Expected shapes of the schema's styles ({styles}), found {min(unknown)!r} in a"
            " scene; declare it among the styles."
        )


def _must_be_numbers(subject: str, values: Iterable[float]) -> None:
    """Raises DomainError for NaN, infinity, and numbers near infinity."""
    for number in values:
        if type(number) is float and -MAX_NUMBER < number < MAX_NUMBER:
            continue  # as nearly all are
        if not (is_number(number) and -MAX_NUMBER < float(number) < MAX_NUMBER):
            raise DomainError(f"Expected finite numbers as {subject}, found {number!r:.40}.")
