"""Episodes of a domain under test: what each shows, and the promises that it breaks."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from enum import StrEnum
from typing import Any, Final

from islandgp.bt.core.engine import ABORTED
from islandgp.bt.core.language import to_text
from islandgp.bt.core.node import AGAIN, FAILURE, STATUS_NAMES, SUCCESS, Node, walk
from islandgp.domain import Domain, Observer, Outcome, Scene, Schema, SimulatorDomain, prepare
from islandgp.errors import IslandError, TimeLimitError
from islandgp.plugin import raised_in
from islandgp.time_limit import time_limit

SEEDS: Final = (0, 1, 2**32 - 1)  # of the worlds of all trees
FRAMES: Final = 3  # ticks whose frames are checked
PNG: Final = b"\x89PNG\r\n\x1a\n"


class Promise(StrEnum):
    """What a domain promises."""

    RUNS = "every episode runs"
    REPEATS = "an episode is a function of tree seed and weights"
    PICKLES = "it can be sent to workers"
    OUTCOMES = "outcomes have what the schema declares"
    WEIGHTS = "a component that is not named has the weight 1"
    OBSERVED = "recording an episode keeps its outcome"
    RANGES = "keys stay in their ranges"
    STATUSES = "actions return the statuses that they declare"
    CREDITS = "points of actions add up to the fitness"
    COUNTERS = "counters named like an event count it"
    SCENES = "scenes use the declared styles"
    FRAMES = "frames are png images"


@dataclass(frozen=True, slots=True)
class Survey:
    """Results of all trees in one domain."""

    domain: Domain
    timeout: float  # of an episode, s; 0: none
    runs: list[Record] = field(default_factory=list)  # of the trees that raised no exception
    crashes: dict[tuple[str, str], str] = field(default_factory=dict)
    """By type and place: a line on the first exception, with the seed of the world and the tree."""

    def episode(
        self,
        tree: Node,
        seed: int,
        weights: Mapping[str, float] | None = None,
        observer: Observer | None = None,
        domain: Domain | None = None,
    ) -> Outcome:
        """The outcome of an episode within the time limit."""
        domain = domain or self.domain
        prepare(domain)
        with time_limit(self.timeout):
            outcome = domain.run_episode(tree, seed, weights or {}, observer)
        assert isinstance(outcome, Outcome), f"Expected an Outcome, found {outcome!r:.80}"
        return outcome

    def run(self, tree: Node, seeds: Sequence[int] = SEEDS) -> Record | None:
        """Runs a tree in each of some worlds; None if it failed.

        Raises:
            TimeLimitError: an episode took too long; it is kept as well.
        """
        record, at = Record(tree, self.domain.schema, seeds), seeds[0]
        try:
            record.watched = self.episode(tree, at, {}, record)
            for at in seeds:
                record.plain.append(self.episode(tree, at))
        except (Exception, SystemExit) as error:  # a simulator may call sys.exit
            key = type(error).__name__, raised_in(error) or fault_text(error)
            line = f"{fault_text(error)} (world seed {at}, tree {tree_line(tree)})"
            self.crashes.setdefault(key, line)
            if isinstance(error, TimeLimitError):
                raise
            return None
        self.runs.append(record)
        return record


def fault_text(error: BaseException) -> str:
    """The text of an exception, with the place in the author's code."""
    place = raised_in(error)
    if isinstance(error, IslandError | AssertionError):
        text = str(error).rstrip(".")
        return text if place in text else f"{text}{place}"
    return f"Expected no error, found {type(error).__name__}: {error}{place}"


def tree_line(tree: Node, most: int = 200) -> str:
    text = " ".join(to_text(tree).split())
    return text if len(text) <= most else f"{text[:most]}..."


def unreached(survey: Survey) -> Iterator[str]:
    """A line for what no tree has reached, by kind."""
    schema, records = survey.domain.schema, survey.runs
    actions, keys = schema.vocabulary.actions, schema.vocabulary.keys
    outcomes = [outcome for record in records for outcome in record.plain]
    counted = {n for n in schema.counters if any(o.counters.get(n) for o in outcomes)}
    seen = counted.union(*(record.events | record.credited.keys() for record in records))
    paid: Any = getattr(getattr(survey.domain, "rewards", None), "events", {})
    observable = schema.events if isinstance(survey.domain, SimulatorDomain) else paid
    done = {name for record in records for name, status in record.statuses if status == SUCCESS}
    ends = {n: {v for record in records for v in record.ends.get(n, ())} for n in keys}
    for kind, names in {
        "events never logged": [n for n in schema.events if n in observable and n not in seen],
        "actions that never succeeded": [
            n for n in actions if SUCCESS in actions[n].statuses and n not in done
        ],
        "keys that never changed": [
            f"{n} (always {min(e):g})" for n, e in ends.items() if len(e) == 1
        ],
        "counters that stayed 0": [
            n for n in schema.counters if n not in counted and n not in schema.events
        ],
    }.items():
        if names:
            yield f"{kind}: {', '.join(names)}"


class Record(Observer):
    """A tree's episodes, with a summary of the observed one and the first fault by promise."""

    watched: Outcome  # in the first world

    def __init__(self, tree: Node, schema: Schema, seeds: Sequence[int]) -> None:
        self.tree, self.seeds = tree, seeds  # of its worlds
        self.plain: list[Outcome] = []  # not watched, in each world
        self.statuses: set[tuple[str, int]] = set()  # action and status at the end of a tick
        self.ticks = 0
        self.ends: dict[str, tuple[float, float]] = {}  # least and greatest value by key
        self.points = dict.fromkeys(schema.components, 0.0)
        self.credited: Counter[str] = Counter()
        self.events: set[str] = set()
        self.faults: dict[Promise, str] = {}
        self._schema, self._movers = schema, -1
        self._actions = [n.action for n in walk(tree)]

    def node(self, place: int, status: int) -> None:
        assert FAILURE <= status <= ABORTED, f"Expected a status, found {status}"
        name = self._actions[place]
        if not name or status in (AGAIN, ABORTED):
            return
        self.statuses.add((name, status))
        if status not in (declared := self._schema.vocabulary.actions[name].statuses):
            names = ", ".join(STATUS_NAMES[each] for each in sorted(declared))
            self._fault(Promise.STATUSES, f"{name} to return {names}", f"{STATUS_NAMES[status]}.")

    def logged(self, event: str) -> None:
        """Called for each event of a stepped domain, with or without points."""
        self.events.add(event)

    def tick(self, board: Sequence[float], scene: Any) -> None:
        self.ticks += 1
        self._look_at_board(board)
        if isinstance(scene, Scene):
            self._look_at_scene(scene)
        elif scene is not None:
            self._fault(Promise.SCENES, "a Scene", f"{scene!r:.80}")

    def credit(self, component: str, points: float, event: str, action: str) -> None:
        for kind, name, names in (
            ("a component", component, self.points),
            ("an event", event, self._schema.events),
            ("an action", action, {"", *self._schema.vocabulary.actions}),
        ):
            if name not in names:
                self._fault(Promise.CREDITS, f"{kind} of the schema", repr(name))
                return
        self.points[component] += points
        self.credited[event] += 1

    def _look_at_board(self, board: Sequence[float]) -> None:
        keys = self._schema.vocabulary.keys
        if len(board) != len(keys):
            self._fault(
                Promise.RANGES, f"a value for each of the {len(keys)} keys", f"{len(board)}"
            )
        for (name, key), value in zip(keys.items(), board, strict=False):
            low, high = self.ends.get(name, (value, value))
            self.ends[name] = min(low, value), max(high, value)
            least, most = key.bounds
            if not least <= value <= most or ((key.flag or key.whole) and value % 1):
                whole = "a whole number as " if key.flag or key.whole else ""
                self._fault(Promise.RANGES, f"{whole}{least:g} <= {name} <= {most:g}", f"{value}")

    def _look_at_scene(self, scene: Scene) -> None:
        for shape in (*scene.fixed, *scene.items, *scene.movers):
            if shape.style not in self._schema.styles:
                self._fault(Promise.SCENES, "a style of the schema", f"{shape}")
        if self._movers not in (-1, n := len(scene.movers)):
            self._fault(Promise.SCENES, "as many movers in each tick", f"{self._movers} and {n}")
        self._movers = n
        if scene.frame is not None and self.ticks <= FRAMES and (begin := scene.frame()[:8]) != PNG:
            self._fault(Promise.FRAMES, "a PNG", f"{begin!r}...")

    def _fault(self, promise: Promise, expected: str, found: str) -> None:
        self.faults.setdefault(promise, f"Expected {expected}, found {found}")
