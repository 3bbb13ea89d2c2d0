"""Episodes of a domain under test: what each shows, and the promises that it breaks."""

from __future__ import annotations

from array import array
from collections import Counter
from collections.abc import Sequence
from enum import StrEnum
from typing import Any, Final

from islandgp.bt.core.engine import ABORTED
from islandgp.bt.core.language import to_text
from islandgp.bt.core.node import AGAIN, FAILURE, STATUS_NAMES, Node, walk
from islandgp.domain import Observer, Outcome, Scene, Schema
from islandgp.errors import IslandError
from islandgp.plugin import raised_in

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


class Record(Observer):
    """A tree's episodes, with a summary of the observed one and the first fault by promise."""

    watched: Outcome  # in the first world

    def __init__(self, tree: Node, schema: Schema) -> None:
        self.tree = tree
        self.plain: list[Outcome] = []  # not watched, in each of SEEDS
        self.statuses: set[tuple[str, int]] = set()  # action and status at the end of a tick
        self.ticks = 0
        self.trace = 0  # a hash of the blackboard and of the things that move, in all ticks
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
        seen = array("d", board).tobytes(), getattr(scene, "movers", ())  # -1 and -2 hash alike
        self.trace = hash((self.trace, *seen))
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
