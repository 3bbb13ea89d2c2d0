"""The contract between a robot's world and everything that evolves, plays and shows trees in it.

A domain says in a `Schema` what its robot can do and know, what is counted and what
earns points, and runs one tree in one world. Configuration names its class:

    domain: {name: maze, factory: "maze:Maze"}

`islandgp.ticking` runs a simulator that is stepped, `islandgp.testing.domain_suite` checks a
domain against this contract, and docs/domains.md builds one step by step.
"""

from __future__ import annotations

import struct
import zlib
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import reduce
from operator import add
from typing import Any, ClassVar, Final, Literal, NamedTuple, Protocol, Self

from pydantic import BaseModel

from islandgp.bt.core.node import Node
from islandgp.bt.core.vocabulary import Action, Vocabulary, must_be
from islandgp.errors import DomainError


@dataclass(frozen=True, slots=True)
class Counter:
    """Something that an episode counts or measures."""

    meaning: str  # one line, e.g. "blocks placed"
    unit: str = ""  # e.g. "m"; "" for a number of things
    heading: str = ""  # of a column of `islandgp play`; "": the counter's name


@dataclass(frozen=True, slots=True)
class Event:
    """Something that happens in an episode and may earn points (Table 3)."""

    meaning: str  # one line
    amount: str = "1"  # what its amount is, with the unit, e.g. "items"


@dataclass(frozen=True, slots=True)
class Form:
    """How one kind of thing is drawn."""

    meaning: str  # for the legend
    sign: str  # one letter, for terminals
    shape: Literal["circle", "ring", "square", "triangle", "diamond", "cross"] = "circle"
    colour: str = "#888888"


MOST_DELAY: Final = 10_000  # ticks


@dataclass(frozen=True, slots=True)
class Schema:
    """What a domain declares of itself. Mappings keep their order in records and tables.

    Raises:
        DomainError: there is no action for a tree's leaves, no component of the fitness, or an
            entry of another type.
    """

    vocabulary: Vocabulary
    components: Mapping[str, str]  # terms of the fitness, Eq. (1), with a meaning each
    events: Mapping[str, Event]  # what the reward table can reward
    task: str  # a paragraph for people and for prompts: what the robot is there for
    counters: Mapping[str, Counter] = field(default_factory=dict)
    """What an episode counts; where nothing is given, how often each event happened."""
    habits: Sequence[str] = ()  # what good trees do, a sentence each; for prompts
    endings: Mapping[str, str] = field(default_factory=dict)
    """Words for why an episode ended (`Outcome.endings`), with a meaning each; for prompts."""
    forms: Mapping[str, Form] = field(default_factory=dict)  # by Thing.form; empty: not drawn
    delay: int = 0  # ticks by which perturbed worlds may delay what the tree sees, at most

    def __post_init__(self) -> None:
        """Refuses what cannot evolve, and counts every event where no counters are declared."""
        for what, found in (("action", self.vocabulary.actions), ("component", self.components)):
            if not found:
                raise DomainError(
                    f"Expected at least one {what} in the domain {self.vocabulary.domain}, found"
                    f" none; declare it in its Schema."
                )
        of_domain = f"of the domain {self.vocabulary.domain}"
        must_be(str, self.components, f"the component {{}} {of_domain}")
        must_be(Event, self.events, f"the event {{}} {of_domain}")
        must_be(Counter, self.counters, f"the counter {{}} {of_domain}")
        must_be(Form, self.forms, f"the form {{}} {of_domain}")
        must_be(str, self.endings, f"the ending {{}} {of_domain}")
        if isinstance(self.habits, str):
            raise DomainError(
                f"Expected a tuple of sentences as the habits {of_domain}, found one text; write"
                " ('...',)."
            )
        if not (isinstance(self.delay, int) and 0 <= self.delay <= MOST_DELAY):
            raise DomainError(
                f"Expected a delay of 0 to {MOST_DELAY:,} ticks {of_domain}, found {self.delay!r}."
            )
        if not self.counters:
            counted = {name: Counter(event.meaning) for name, event in self.events.items()}
            object.__setattr__(self, "counters", counted)

    def with_actions(self, domain: str, actions: Mapping[str, Action]) -> Schema:
        """The same schema with further actions, for a domain of that name."""
        all_of_them = {**self.vocabulary.actions, **actions}
        words = replace(self.vocabulary, domain=domain, actions=all_of_them)
        return replace(self, vocabulary=words)


def total(values: Iterable[float]) -> float:
    """The sum, added up from left to right.

    Since Python 3.12 `sum` compensates for rounding: records made with it would depend on the
    version.
    """
    return reduce(add, values, 0)


@dataclass(frozen=True, slots=True)
class Outcome:
    """The result of one tree in one episode, or the mean of several."""

    components: Mapping[str, float]  # points by component of the schema
    counters: Mapping[str, float]  # by counter of the schema
    seconds: float  # simulated s
    endings: tuple[str, ...]  # why each episode ended

    @property
    def fitness(self) -> float:
        """Points, Eq. (1): the sum of the components."""
        return total(self.components.values())

    def measure(self, name: str) -> float:
        """A counter's value, or the fitness. Raises KeyError for any other name."""
        return self.fitness if name == "fitness" else self.counters[name]


class Thing(NamedTuple):
    """Something in a picture of the world."""

    form: str  # a key of Schema.forms
    x: float  # in the domain's unit of length; y grows upwards
    y: float
    size: float  # radius
    text: str = ""  # beside it


@dataclass(frozen=True, slots=True)
class Scene:
    """What there is to see after a tick."""

    bounds: tuple[float, float, float, float]  # least x, least y, greatest x, greatest y
    fixed: tuple[Thing, ...] = ()  # the same in each tick of an episode
    items: tuple[Thing, ...] = ()  # they come and go, and do not move
    movers: tuple[Thing, ...] = ()  # as many in each tick, in the same order; the robot is the last
    frame: Callable[[], bytes] | None = None
    """A simulator's own picture instead: renders it as a PNG. Called at once or not at all."""


def png(pixels: Any) -> bytes:
    """A picture for `Scene.frame`: of an array of shape (height, width, 3) of 8-bit numbers."""
    height, width, _ = pixels.shape
    lines = b"".join(b"\0" + pixels[row].tobytes() for row in range(height))
    header = struct.pack(">IIBBBBB", width, height, 8, 2, 0, 0, 0)
    chunks = ((b"IHDR", header), (b"IDAT", zlib.compress(lines)), (b"IEND", b""))
    return b"\x89PNG\r\n\x1a\n" + b"".join(
        struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))
        for kind, data in chunks
    )


class Observer(Protocol):
    """Who looks on while an episode runs. It changes nothing."""

    def node(self, place: int, status: int) -> None:
        """The node of that place in document order was ticked, or aborted (`engine.ABORTED`)."""
        ...

    def tick(self, board: Sequence[float], scene: Scene | None) -> None:
        """A tick is over: the blackboard that it saw, and the world, where the domain draws it."""
        ...

    def credit(self, component: str, points: float, event: str, action: str) -> None:
        """An event since the last tick earned points; `action` earned them, "" for none."""
        ...


class Domain(Protocol):
    """A world for a robot. It can be pickled, and is sent to each worker once.

    A domain that declares noise of a key, or a delay, has a method `with_sensors(faults)` as well,
    which returns it with the `sensors.SensorFaults` between the world and the blackboard. Where
    `to_start` or `to_succeed` of an action follow from settings of the world, a class method
    `vocabulary_in(worlds)` returns the vocabulary with the conditions that hold in all of these
    worlds; `check` warns by it. It may have a method `about(seed=None)`, which returns sentences
    for prompts: how long an episode is and what its world is like, of one seed or as the settings
    have it.

    `World` and `Rewards` are pydantic models of the configuration groups `world` and
    `rewards`; `scoring.rewards.RewardTable` serves most domains as the latter.
    """

    World: ClassVar[type[BaseModel]]
    Rewards: ClassVar[type[BaseModel]]
    step_s: float  # simulated s of a tick

    @property
    def schema(self) -> Schema:
        """What the domain declares; an attribute will do."""
        ...

    @classmethod
    def make(cls, world: Any, rewards: Any) -> Self:
        """The domain with these settings. Raises ConfigError where they do not fit together."""
        ...

    def run_episode(
        self,
        tree: Node,
        seed: int,
        weights: Mapping[str, float],
        observer: Observer | None = None,
    ) -> Outcome:
        """Runs a tree in the world of a seed: a function of its first three arguments.

        Args:
            tree: in the words of the schema's vocabulary.
            seed: of the world, in [0, 2**32).
            weights: the curriculum's multipliers by component; 1 for those not named.
            observer: is told of every tick. Whether there is one changes no outcome.
        """
        ...
