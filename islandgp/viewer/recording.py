"""Records an episode tick by tick: statuses of nodes, blackboard, points, and scenes."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from itertools import chain
from math import floor, log10
from typing import Final, NamedTuple

from islandgp.bt.core.engine import ABORTED
from islandgp.bt.core.node import AGAIN, FAILURE, RUNNING, SUCCESS, Node, size
from islandgp.domain import Outcome, Scene, Schema, Shape, prepare
from islandgp.errors import DomainError
from islandgp.evaluation.base import Problem, in_floats
from islandgp.leaves import is_number
from islandgp.time_limit import TimeLimit

IDLE, FAILED, SUCCEEDED, RUNS, STOPPED = range(5)
"""The last status of a node in a tick; IDLE: it was not ticked."""

_CODES: Final = {FAILURE: FAILED, SUCCESS: SUCCEEDED, RUNNING: RUNS, AGAIN: RUNS, ABORTED: STOPPED}

Bounds = tuple[float, float, float, float]
"""Least x, least y, greatest x, greatest y."""


MAX_NUMBER: Final = 1e300
"""Above this, differences of numbers are infinite."""


class Credit(NamedTuple):
    """Points that an event earned."""

    tick: int
    event: str
    component: str
    points: float
    action: str  # that earned them, or ""


class ItemSpan(NamedTuple):
    """A shape that does not move, and the ticks in which it exists."""

    shape: Shape
    begin: int  # first tick in which it exists
    end: int  # first tick in which it no longer exists


@dataclass(frozen=True, slots=True)
class SceneTrack:
    """The drawn things of an episode, over its ticks."""

    bounds: Bounds  # of all ticks
    fixed: tuple[Shape, ...]
    items: tuple[ItemSpan, ...]  # by begin
    movers: tuple[tuple[Shape, ...], ...]
    """Each moving shape at each tick; the last one is the robot, which is drawn on top."""
    frames: tuple[tuple[int, bytes], ...]  # a tick and the PNG from then on

    def shapes(self) -> Iterator[Shape]:
        """All shapes drawn; movers once per tick."""
        return chain(self.fixed, (item.shape for item in self.items), *self.movers)

    def styles(self) -> set[str]:
        """The styles that occur."""
        return {shape.style for shape in self.shapes()}


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
    scenes: SceneTrack | None  # None: the domain draws nothing
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

    `limit`: seconds that the episode may take, as in `TimeLimit`; 0: any time.

    Raises:
        TimeLimitError: the episode took longer.
        DomainError: the domain shows something undeclared, or a value that is not a number.
    """
    domain = problem.in_world(stage, seed)
    schema = domain.schema
    recorder = Recorder(tree, schema)
    weights = problem.curriculum.multipliers(stage)
    prepare(domain)
    with TimeLimit(limit):
        outcome = domain.run_episode(tree, seed, weights, recorder)
    ticks = recorder.finish()
    points = [*outcome.components.values(), *(credit.points for credit in recorder.credits)]
    _must_be_numbers("points", [*points, outcome.fitness])
    _must_be_numbers("the seconds of an episode", [outcome.seconds, domain.step_s])
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
        scenes=recorder.camera.track(ticks, schema) if recorder.camera.scenes else None,
        outcome=in_floats(outcome),
    )


class Recorder:
    """An observer that records an episode."""

    def __init__(self, tree: Node, schema: Schema) -> None:
        self.boards: list[tuple[float, ...]] = []
        self.credits: list[Credit] = []
        self.camera = SceneRecorder()
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
            self.camera.see(scene, len(self.boards))
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


class SceneRecorder:
    """Collects scenes; an unchanged shape is stored once."""

    def __init__(self) -> None:
        self.scenes = 0
        self._bounds: set[Bounds] = set()
        self._fixed: tuple[Shape, ...] = ()
        self._items: tuple[Shape, ...] = ()  # of the last scene
        self._present: dict[tuple[Shape, int], int] = {}  # since when; equal things are numbered
        self._gone: list[ItemSpan] = []
        self._movers: list[tuple[Shape, ...]] = []  # per tick
        self._frames: list[tuple[int, bytes]] = []

    def see(self, scene: Scene, tick: int) -> None:
        """Add the scene of a tick."""
        if not self.scenes:
            self._fixed = scene.fixed
        self._bounds.add(scene.bounds)
        self.scenes += 1
        if scene.items != self._items:
            self._see_items(scene.items, tick)
        frame = b"" if scene.frame is None else scene.frame()
        if frame and (not self._frames or frame != self._frames[-1][1]):
            self._frames.append((tick, frame))
        self._movers += [scene.movers] * (tick + 1 - len(self._movers))

    def _see_items(self, items: tuple[Shape, ...], tick: int) -> None:
        self._items = items
        counts: dict[Shape, int] = {}
        present: dict[tuple[Shape, int], int] = {}
        for item in items:
            number = counts[item] = counts.get(item, 0) + 1
            present[item, number] = self._present.get((item, number), tick)
        for key in self._present.keys() - present.keys():
            self._gone.append(ItemSpan(key[0], self._present[key], tick))
        self._present = present

    def track(self, ticks: int, schema: Schema) -> SceneTrack:
        """The track of an episode of `ticks` ticks. Raises DomainError for wrong scenes."""
        open_spans = [ItemSpan(shape, since, ticks) for (shape, _), since in self._present.items()]
        items = sorted([*self._gone, *open_spans], key=lambda item: (item.begin, item.shape))
        lows, highs = zip(*((b[:2], b[2:]) for b in self._bounds), strict=True)
        track = SceneTrack(
            bounds=(*map(min, zip(*lows, strict=True)), *map(max, zip(*highs, strict=True))),
            fixed=self._fixed,
            items=tuple(items),
            movers=self._columns(ticks),
            frames=tuple(self._frames),
        )
        _must_be_numbers("the bounds of a scene", track.bounds)
        places = chain.from_iterable(shape[1:4] for shape in track.shapes())
        _must_be_numbers("the places and sizes of shapes", places)
        if unknown := track.styles() - schema.styles.keys():
            styles = ", ".join(schema.styles) or "none"
            raise DomainError(
                f"Expected shapes of the schema's styles ({styles}), found {min(unknown)!r} in a"
                " scene; declare it among the styles."
            )
        return track

    def _columns(self, ticks: int) -> tuple[tuple[Shape, ...], ...]:
        """Each mover at each tick. Raises DomainError if their number changes."""
        movers = self._movers + self._movers[-1:] * (ticks - len(self._movers))
        most, least = max(map(len, movers)), min(map(len, movers))
        if most != least:
            raise DomainError(
                f"Expected as many movers in each tick, found {least} and {most}; what comes and"
                " goes belongs to the items of a scene."
            )
        return tuple(zip(*movers, strict=True))


def _must_be_numbers(subject: str, values: Iterable[float]) -> None:
    """Raises DomainError for NaN, infinity, and numbers near infinity."""
    for number in values:
        if type(number) is float and -MAX_NUMBER < number < MAX_NUMBER:
            continue  # as nearly all are
        if not (is_number(number) and -MAX_NUMBER < float(number) < MAX_NUMBER):
            raise DomainError(f"Expected finite numbers as {subject}, found {number!r:.40}.")
