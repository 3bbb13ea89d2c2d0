"""The domain interface: what a robot's world declares, and how one tree is run in it."""

from __future__ import annotations

import struct
import zlib
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterable, Mapping, Sequence
from copy import copy
from dataclasses import dataclass, field
from functools import reduce
from inspect import get_annotations
from operator import add
from pathlib import Path
from typing import Annotated, Any, ClassVar, Final, Literal, NamedTuple, Protocol, Self

import yaml
from pydantic import BaseModel, Field

from islandgp.bt.core.node import Node
from islandgp.bt.core.parameters import validated
from islandgp.bt.core.vocabulary import Vocabulary
from islandgp.domain.sensors import SensorFaults
from islandgp.errors import DomainError
from islandgp.text_files import read_text_file


@dataclass(frozen=True, slots=True)
class Counter:
    """A quantity that is counted or measured in an episode."""

    meaning: str  # one line, e.g. "blocks placed"
    unit: str = ""  # e.g. "m"; "" for a number of things
    heading: str = ""  # of a column of `islandgp play`; "": the counter's name


@dataclass(frozen=True, slots=True)
class Event:
    """An event of an episode that the reward table can reward (Table 3)."""

    meaning: str  # one line
    amount: str = "1"  # meaning of its amount, with the unit, e.g. "items"


@dataclass(frozen=True, slots=True)
class ShapeStyle:
    """Appearance of shapes of one kind."""

    meaning: str  # for the legend
    sign: str  # one letter, for terminals
    shape: Literal["circle", "ring", "square", "triangle", "diamond", "cross"] = "circle"
    colour: str = "#888888"


MAX_DELAY: Final = 10_000  # ticks


@dataclass(frozen=True, slots=True)
class Schema:
    """The declarations of a domain. Records and tables keep the order of the mappings.

    Raises:
        DomainError: there is no action or no component of the fitness, or an entry has the
            wrong type.
    """

    vocabulary: Vocabulary
    components: Mapping[str, str]  # terms of the fitness, Eq. (1), with a meaning each
    events: Mapping[str, Event]  # which the reward table can reward
    task: str  # the robot's task, one paragraph; for the documentation and for prompts
    counters: Mapping[str, Counter] = field(default_factory=dict)
    """Quantities counted in an episode; by default the number of times each event happened."""
    habits: tuple[str, ...] = ()  # properties of good trees, one sentence each; for prompts
    endings: Mapping[str, str] = field(default_factory=dict)
    """Meaning of each reason why an episode ended (`Outcome.endings`); for prompts."""
    styles: Mapping[str, ShapeStyle] = field(default_factory=dict)  # by Shape.style; {}: not drawn
    delay: Annotated[int, Field(ge=0, le=MAX_DELAY)] = 0
    """Ticks by which perturbed worlds may delay what the tree sees, at most."""

    @classmethod
    def read(cls, file: Path) -> Self:
        """The schema in a YAML file, with the fields that `islandgp domain NAME --json` prints.

        Args:
            file: e.g. `Path(__file__).with_name("schema.yaml")`.

        Returns:
            The schema.

        Raises:
            DomainError: the file is not YAML with these fields.
            IslandError: it cannot be read.
        """
        try:
            declaration = yaml.safe_load(read_text_file(file))
        except yaml.YAMLError as error:
            found = " ".join(str(error).split())
            raise DomainError(f"Expected the YAML of a schema in {file}, found: {found}.") from None
        schema: Self = validated(cls, declaration, f"the schema {file}")
        return schema

    def __post_init__(self) -> None:
        """Checks the declarations; without counters, declares one per event."""
        for kind, names in (("action", self.vocabulary.actions), ("component", self.components)):
            if not names:
                raise DomainError(
                    f"Expected at least one {kind} in the domain {self.vocabulary.domain}, found"
                    f" none; declare it in its Schema."
                )
        kinds = get_annotations(Schema, eval_str=True)
        for name in ("components", "events", "counters", "habits", "endings", "styles", "delay"):
            where = f"the {name} of the domain {self.vocabulary.domain}"
            validated(kinds[name], getattr(self, name), where)
        if not self.counters:
            counted = {name: Counter(event.meaning) for name, event in self.events.items()}
            object.__setattr__(self, "counters", counted)


def total(values: Iterable[float]) -> float:
    """The sum of numbers, added from left to right.

    Since Python 3.12 `sum` compensates for rounding errors, so records would depend on the
    Python version.

    Args:
        values: any numbers.

    Returns:
        The sum; 0 if there are none.
    """
    return reduce(add, values, 0)


@dataclass(frozen=True, slots=True)
class Outcome:
    """The result of one tree in one episode, or the mean of several."""

    components: Mapping[str, float]  # points by component of the schema
    counters: Mapping[str, float]  # by counter of the schema
    seconds: float  # simulated s
    endings: tuple[str, ...]  # why each episode ended
    observed: tuple[Any, ...] = ()  # by the `observer` of the run's search, if it has one

    @property
    def fitness(self) -> float:
        """Points, Eq. (1): the sum of the components."""
        return total(self.components.values())

    def measure(self, name: str) -> float:
        """The value of a counter, or the fitness.

        Args:
            name: a counter of the schema, or "fitness".

        Returns:
            The value, in the counter's unit or in points. Raises KeyError for another name.
        """
        return self.fitness if name == "fitness" else self.counters[name]


class Shape(NamedTuple):
    """A shape in a picture of the world."""

    style: str  # a key of Schema.styles
    x: float  # in the domain's unit of length; y grows upwards
    y: float
    size: float  # radius
    text: str = ""  # label beside it


@dataclass(frozen=True, slots=True)
class Scene:
    """The picture of the world after a tick."""

    bounds: tuple[float, float, float, float]  # least x, least y, greatest x, greatest y
    fixed: tuple[Shape, ...] = ()  # the same in each tick of an episode
    items: tuple[Shape, ...] = ()  # that appear and disappear but do not move
    movers: tuple[Shape, ...] = ()  # same number and order in each tick; the robot is the last
    frame: Callable[[], bytes] | None = None
    """Renders the simulator's own picture as a PNG instead. Called immediately or never."""


def png(pixels: Any) -> bytes:
    """Encodes a picture as PNG, for `Scene.frame`.

    Args:
        pixels: array of shape (height, width, 3) and dtype uint8, RGB.

    Returns:
        The content of the PNG file.
    """
    height, width, _ = pixels.shape
    lines = b"".join(b"\0" + pixels[row].tobytes() for row in range(height))
    header = struct.pack(">IIBBBBB", width, height, 8, 2, 0, 0, 0)
    chunks = ((b"IHDR", header), (b"IDAT", zlib.compress(lines)), (b"IEND", b""))
    return b"\x89PNG\r\n\x1a\n" + b"".join(
        struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))
        for kind, data in chunks
    )


class Observer(Protocol):
    """Callbacks of an episode, e.g. for traces and replays. They must not change the episode.

    An observer with an attribute `scenes` that is False gets None for each scene, which is faster.
    """

    def node(self, place: int, status: int) -> None:
        """Called when a node was ticked or aborted.

        Args:
            place: index of the node in document order, from 0.
            status: as in `bt.core.engine`; `engine.ABORTED` if it was aborted.
        """
        ...

    def tick(self, board: Sequence[float], scene: Scene | None) -> None:
        """Called at the end of a tick.

        Args:
            board: values of the blackboard keys in the tick, in the vocabulary's order.
            scene: the world after the tick; None if the domain does not draw it.
        """
        ...

    def credit(self, component: str, points: float, event: str, action: str) -> None:
        """Called when an event since the last tick earned points.

        Args:
            component: of the fitness, to which the points are added.
            points: after the curriculum's multipliers.
            event: of the schema.
            action: the action that caused the event; "" for none.
        """
        ...


def wants_scenes(observer: Observer) -> bool:
    """Tell whether a domain should draw for an observer.

    Args:
        observer: of an episode.

    Returns:
        False if the observer has an attribute `scenes` that is False.
    """
    return bool(getattr(observer, "scenes", True))


class Domain(ABC):
    """A robot's world. Domains can be pickled and are sent to each worker once.

    A subclass has `World` and `Rewards`, pydantic models of the configuration groups `world` and
    `rewards` (most have `RewardTable` as `Rewards`), and implements `run_episode`; the other
    methods serve as they are, unless it has more to do.
    """

    World: ClassVar[type[BaseModel]]
    Rewards: ClassVar[type[BaseModel]]
    schema: Schema
    step_s: float = 1.0  # simulated s of a tick
    faults: SensorFaults | None = None
    """Between the world and the blackboard; `run_episode` passes what the tree reads through."""

    def __init__(self, world: Any, rewards: Any) -> None:
        self.world, self.rewards = world, rewards

    @classmethod
    def make(cls, world: Any, rewards: Any) -> Self:
        """Makes the domain.

        Args:
            world: an instance of `World`.
            rewards: an instance of `Rewards`.

        Returns:
            The domain.

        Raises:
            ConfigError: the settings contradict each other.
        """
        return cls(world, rewards)

    def with_sensors(self, faults: SensorFaults) -> Self:
        """Puts faults between the world and the blackboard.

        Args:
            faults: of the sensors, in perturbed worlds.

        Returns:
            A domain that is otherwise equal.
        """
        changed = copy(self)
        changed.faults = faults
        return changed

    def vocabulary_in(self, worlds: Sequence[Any]) -> Vocabulary:  # noqa: ARG002
        """The vocabulary with what holds in some worlds; `check` bases its warnings on it.

        Args:
            worlds: instances of `World`.

        Returns:
            The vocabulary, with conditions (`to_start`, `to_succeed`) and bounds of keys that hold
            in all of these worlds.
        """
        return self.schema.vocabulary

    def prepare(self) -> None:  # noqa: B027 -- most domains need nothing
        """Loads and compiles what episodes need. Called before each, outside its time limit."""

    def about(self, seed: int | None = None) -> str:  # noqa: ARG002
        """Describes the world in sentences, for prompts.

        Args:
            seed: of the world; None: in general.

        Returns:
            The length of an episode and what the world is like; "" for nothing.
        """
        return ""

    @abstractmethod
    def run_episode(
        self, tree: Node, seed: int, weights: Mapping[str, float], observer: Observer | None = None
    ) -> Outcome:
        """Runs one episode. The outcome is a function of the first three arguments.

        Args:
            tree: with actions and keys of the schema's vocabulary.
            seed: of the world, in [0, 2**32).
            weights: the curriculum's multipliers by component, >= 0; 1 for those not in it.
            observer: its methods are called in each tick; it does not affect the outcome.

        Returns:
            The outcome, with the components and counters of the schema.
        """
