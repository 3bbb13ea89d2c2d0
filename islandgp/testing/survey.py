"""What episodes of a domain under test show: outcomes, ranges, statuses, credits and faults."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Hashable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Final

from islandgp.bt.core.engine import ABORTED
from islandgp.bt.core.language import to_text
from islandgp.bt.core.node import AGAIN, FAILURE, SUCCESS, Node, size, walk
from islandgp.domain import Domain, Observer, Outcome, Scene, Schema, SimulatorDomain, prepare
from islandgp.errors import IslandError, TimeLimitError
from islandgp.plugin import raised_in
from islandgp.time_limit import TimeLimit

SEEDS: Final = (0, 1, 2**32 - 1)  # of the worlds of all trees
SHOWN: Final = 200  # characters of a tree in a message
FIRST_TICKS: Final = 500  # that are compared for effects of two actions on each other


@dataclass(frozen=True, slots=True)
class ObservedRun:
    """A tree's episodes."""

    tree: Node
    watched: Outcome  # in the world of the first of SEEDS
    plain: tuple[Outcome, ...]  # not watched, of each of SEEDS
    recorder: EpisodeRecorder


@dataclass(frozen=True, slots=True)
class Survey:
    """Results of all trees in one domain."""

    domain: Domain
    make: Callable[[], Domain]  # makes further instances
    timeout: float  # of an episode, s; 0: none
    runs: list[ObservedRun] = field(default_factory=list)  # of the trees that raised no exception
    visits: list[ObservedRun] = field(default_factory=list)  # some of them in further worlds
    faults: dict[tuple[str, str], EpisodeFault] = field(default_factory=dict)  # by type and place

    def run(
        self,
        tree: Node,
        seed: int,
        weights: Mapping[str, float] | None = None,
        observer: Observer | None = None,
        *,
        domain: Domain | None = None,
    ) -> Outcome:
        """An episode within the time limit."""
        domain = domain or self.domain
        prepare(domain)
        with TimeLimit(self.timeout):
            outcome = domain.run_episode(tree, seed, weights or {}, observer)
        assert isinstance(outcome, Outcome), f"Expected an Outcome, found {outcome!r:.80}"
        return outcome

    def look(self, tree: Node) -> ObservedRun | None:
        """Runs a tree in each world of SEEDS and keeps the results; None if it failed.

        Raises:
            TimeLimitError: an episode took too long; it is kept as well.
        """
        return self._kept(tree, SEEDS[0], SEEDS, self.runs)

    def visit(self, tree: Node, seed: int) -> None:
        """Runs a tree in a further world. Raises as `look`."""
        self._kept(tree, seed, (), self.visits)

    def _kept(
        self, tree: Node, seed: int, seeds: Sequence[int], runs: list[ObservedRun]
    ) -> ObservedRun | None:
        recorder = EpisodeRecorder(tree, self.domain.schema)
        try:
            watched = self.run(tree, seed, {}, recorder)
            outcomes = []
            for seed in seeds:
                outcomes.append(self.run(tree, seed))
        except (Exception, SystemExit) as error:  # a simulator may call sys.exit
            key = type(error).__name__, raised_in(error) or fault_text(error)
            before = self.faults.get(key)
            if before is None or size(tree) < size(before.tree):
                self.faults[key] = EpisodeFault(fault_text(error), seed, tree)
            if isinstance(error, TimeLimitError):
                raise
            return None
        run = ObservedRun(tree, watched, tuple(outcomes) or (watched,), recorder)
        runs.append(run)
        return run

    def recorders(self) -> list[EpisodeRecorder]:
        """The observations of each tree in the first world."""
        return [run.recorder for run in self.runs]


@dataclass(frozen=True, slots=True)
class EpisodeFault:
    """An exception of an episode."""

    text: str
    seed: int  # of the world
    tree: Node


def fault_text(error: BaseException) -> str:
    """The text of an exception, with the place in the author's code."""
    place = raised_in(error)
    if isinstance(error, IslandError | AssertionError):
        text = str(error).rstrip(".")
        return text if place in text else f"{text}{place}"
    return f"Expected no error, found {type(error).__name__}: {error}{place}"


def tree_line(tree: Node) -> str:
    """A tree on one line, cut after SHOWN characters."""
    text = " ".join(to_text(tree).split())
    return text if len(text) <= SHOWN else f"{text[:SHOWN]}..."


def unreached(survey: Survey) -> Iterator[str]:
    domain, runs = survey.domain, (*survey.runs, *survey.visits)
    schema, vocabulary = domain.schema, domain.schema.vocabulary
    recorders = [run.recorder for run in runs]
    logged = {event for recorder in recorders for event in recorder.events}
    logged |= {event for recorder in recorders for event in recorder.credited}
    outcomes = [outcome for run in runs for outcome in run.plain]
    counted = {n for n in schema.counters if any(o.counters.get(n) for o in outcomes)}
    observable = schema.events if isinstance(domain, SimulatorDomain) else _rewarded(domain)
    events = [n for n in schema.events if n in observable and n not in logged | counted]
    if events:
        yield f"events never logged: {', '.join(events)}"
    done = {
        name for recorder in recorders for name, status in recorder.statuses if status == SUCCESS
    }
    able = [n for n, action in vocabulary.actions.items() if SUCCESS in action.statuses]
    if unused := [name for name in able if name not in done]:
        yield f"actions that never succeeded: {', '.join(unused)}"
    ranges = [recorder.ranges() for recorder in recorders]
    same = []
    for name in vocabulary.keys:
        values = {value for r in ranges if name in r for value in r[name]}
        if len(values) == 1:
            same.append(f"{name} (always {min(values):g})")
    if same:
        yield f"keys that never changed: {', '.join(same)}"
    if zero := [n for n in schema.counters if n not in counted and n not in schema.events]:
        yield f"counters that stayed 0: {', '.join(zero)}"


def _rewarded(domain: Domain) -> Mapping[str, object]:
    """The events that earn points, of which every observer is notified."""
    events: Mapping[str, object] = getattr(getattr(domain, "rewards", None), "events", {})
    return events


class TickObserver(Observer):
    """The first blackboards of an episode, with the things that move."""

    def __init__(self) -> None:
        self.ticks: list[Hashable] = []

    def node(self, place: int, status: int) -> None:
        del place, status  # places are others when two actions are exchanged

    def credit(self, component: str, points: float, event: str, action: str) -> None:
        del component, points, event, action

    def tick(self, board: Sequence[float], scene: Scene | None) -> None:
        if len(self.ticks) < FIRST_TICKS:
            self.ticks.append((tuple(board), scene.movers if scene else ()))


class EpisodeRecorder(Observer):
    """Summary of an observed episode."""

    def __init__(self, tree: Node, schema: Schema) -> None:
        self.statuses: set[tuple[str, int]] = set()  # action and status at the end of a tick
        self.states: set[Hashable] = set()  # values of all flags together
        self.ticks = 0
        self.movers: set[int] = set()  # their numbers; one if it is constant
        self.points = dict.fromkeys(schema.components, 0.0)
        self.credited: Counter[str] = Counter()
        self.events: set[str] = set()
        self.wrong_board = self.wrong_credit = self.wrong_scene = ""
        self._schema = schema
        self._actions = [n.action for n in walk(tree)]
        self._board: tuple[float, ...] | None = None  # of the last tick
        self._low: list[float] = []  # by key
        self._high: list[float] = []
        self._flags = [i for i, key in enumerate(schema.vocabulary.keys.values()) if key.flag]

    def node(self, place: int, status: int) -> None:
        assert FAILURE <= status <= ABORTED, f"Expected a status, found {status}"
        name = self._actions[place]
        if name and status not in (AGAIN, ABORTED):
            self.statuses.add((name, status))

    def logged(self, event: str) -> None:
        """Called for each event of a stepped domain, with or without points."""
        self.events.add(event)

    def tick(self, board: Sequence[float], scene: Scene | None) -> None:
        self.ticks += 1
        if (now := tuple(board)) != self._board:
            self._board = now
            self.wrong_board = self.wrong_board or self._wrong(now)
            if len(now) == len(self._schema.vocabulary.keys):
                self.states.add(tuple(now[i] for i in self._flags))
                self._low = [*map(min, self._low or now, now)]
                self._high = [*map(max, self._high or now, now)]
        if scene is not None and not self.wrong_scene:
            self.wrong_scene = self._wrong_in(scene)

    def credit(self, component: str, points: float, event: str, action: str) -> None:
        if component not in self.points:
            self.wrong_credit = f"Expected a component of the schema, found {component!r}"
        elif event not in self._schema.events:
            self.wrong_credit = f"Expected an event of the schema, found {event!r}"
        elif action and action not in self._schema.vocabulary.actions:
            self.wrong_credit = f"Expected an action of the schema, found {action!r}"
        else:
            self.points[component] += points
            self.credited[event] += 1

    def ranges(self) -> dict[str, tuple[float, float]]:
        """The least and the greatest value of each key."""
        pairs = zip(self._low, self._high, strict=True)
        return dict(zip(self._schema.vocabulary.keys, pairs, strict=False))

    def firsts(self) -> set[Hashable]:
        """Everything reached: events, successes of actions, ends of the keys' ranges."""
        done = {name for name, status in self.statuses if status == SUCCESS}
        ends = {
            (name, where)
            for name, (low, high) in self.ranges().items()
            for where, far in self._ends(name, low, high)
            if far
        }
        return {*self.events, *self.credited, *(("success", name) for name in done), *ends}

    def _ends(self, name: str, low: float, high: float) -> Iterator[tuple[str, bool]]:
        key = self._schema.vocabulary.keys[name]
        yield "low", low <= key.low
        yield "above", high > key.low
        yield "high", high >= key.high

    def _wrong(self, board: tuple[float, ...]) -> str:
        """The first error in a blackboard, or ""."""
        keys = self._schema.vocabulary.keys
        if len(board) != len(keys):
            return f"Expected a value for each of the {len(keys)} keys, found {len(board)}"
        for (name, key), value in zip(keys.items(), board, strict=True):
            if key.flag and value not in (0, 1):
                return f"Expected 0 or 1 of the flag {name}, found {value}"
            if key.whole and value != int(value):
                return f"Expected a whole number of {name}, found {value}"
            if not key.flag and not value >= key.low:
                return f"Expected {name} >= {key.low}, found {value}"
            if not key.flag and key.most is not None and not value <= key.most:
                return f"Expected {name} <= {key.most}, found {value}"
        return ""

    def _wrong_in(self, scene: Any) -> str:
        """The first error in a scene, or ""."""
        if not isinstance(scene, Scene):
            return f"Expected a Scene, found {scene!r:.80}"
        for shape in (*scene.fixed, *scene.items, *scene.movers):
            if shape.style not in self._schema.styles:
                return f"Expected a style of the schema, found {shape}"
        self.movers.add(len(scene.movers))
        return ""


class FrameChecker(EpisodeRecorder):
    """Checks the first frames as well."""

    wrong_frame = ""

    def tick(self, board: Sequence[float], scene: Scene | None) -> None:
        super().tick(board, scene)
        if isinstance(scene, Scene) and scene.frame is not None and self.ticks <= 3:
            begin = scene.frame()[:8]
            if begin != b"\x89PNG\r\n\x1a\n":
                self.wrong_frame = f"Expected a PNG, found {begin!r}..."
