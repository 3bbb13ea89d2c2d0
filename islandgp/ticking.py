"""A domain over a simulator that is stepped: what its keys read, and what each action does.

    class Robot:                          # one episode: a method for each action of the schema
        def __init__(self, world, seed, log): ...
        def sense(self): return {"have_block": self.block}
        def Pick(self): self.log("picked"); return True

    class PickPlace(Stepped):
        World, Episode, schema = World, Robot, SCHEMA

A leaf is a function that is called once a tick while its node runs, and returns True
(success), False (failure) or RUNNING. Or it is a generator function: each `yield` is a
tick in which it runs, and what it returns, True or False, is how it ends.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Generator, Iterator, Mapping, Sequence
from functools import cache, wraps
from inspect import isgeneratorfunction
from math import isfinite
from threading import local
from typing import Any, ClassVar, ParamSpec, Protocol, Self, TypeAlias, TypeVar

from pydantic import BaseModel

from islandgp.bt.closures import Tick
from islandgp.bt.engine import compile_tree
from islandgp.bt.node import RUNNING, Node
from islandgp.bt.vocabulary import Key
from islandgp.domain import Observer, Outcome, Schema
from islandgp.errors import DomainError
from islandgp.scoring.rewards import RewardTable, worth

__all__ = ["RUNNING", "EventLog", "Leaf", "Simulation", "Stepped", "once_a_thread"]

P = ParamSpec("P")
T = TypeVar("T")

Leaf: TypeAlias = Callable[[], int] | Callable[[], Generator[None, None, bool]]


def once_a_thread(make: Callable[P, T]) -> Callable[P, T]:
    """Makes something once in each thread for the same arguments, e.g. a simulator."""
    of_thread = local()

    @wraps(make)
    def made(*args: P.args, **named: P.kwargs) -> T:
        if not hasattr(of_thread, "made"):
            of_thread.made = cache(make)
        found: T = of_thread.made(*args, **named)
        return found

    return made


class EventLog:
    """The events of an episode: how often each happened, and the points by component.

    `log("picked")` and `log("driven", 2.5)` record one.
    """

    def __init__(
        self,
        rewards: RewardTable,
        schema: Schema,
        weights: Mapping[str, float],
        observer: Observer | None = None,
    ) -> None:
        self.counts: Counter[str] = Counter()
        self.components = dict.fromkeys(schema.components, 0.0)
        self.action = ""  # the leaf that is being called
        self._events = schema.events
        self._rewarded = rewards.events.keys()
        self._worth = worth(rewards, weights)
        self._observer = observer

    def __call__(self, event: str, amount: float = 1.0) -> None:
        """Something happened. Raises DomainError for an event or amount that cannot be."""
        if event not in self._events:
            known = ", ".join(self._events)
            raise DomainError(f"Expected an event of the schema ({known}), found {event!r}.")
        self.counts[event] += 1
        if not isfinite(amount):
            raise DomainError(f"Expected a finite amount of the event {event!r}, found {amount}.")
        if event not in self._rewarded:
            return
        component, points = self._worth(event, amount)
        if component:
            self.components[component] += points
            if self._observer is not None:
                self._observer.credit(component, points, event, self.action)


class Simulation(Protocol):
    """One episode of a stepped simulator, with a method named like each action of the schema.

    It may also have these methods:
        step() -> str: lets time pass after a tick; returns why the episode is over, "" to go on.
        measures() -> Mapping[str, float]: at the end, the counters that are not simply how often
            an event happened.
        scene() -> Scene: what there is to see.
    """

    def sense(self) -> Mapping[str, float]:
        """The value of each key now; True and False for flags."""
        ...


class Stepped:
    """A domain whose episodes are objects of a class `Episode`, made as Episode(world, seed, log).

    `World` has the setting `ticks`, the most ticks of an episode, >= 1.
    """

    World: ClassVar[type[BaseModel]]
    Rewards: ClassVar[type[BaseModel]] = RewardTable
    Episode: ClassVar[Callable[[Any, int, EventLog], Simulation]]
    schema: Schema
    step_s: float = 1.0  # simulated s of a tick

    def __init__(self, world: Any, rewards: RewardTable) -> None:
        self.world = world
        self.rewards = rewards

    @classmethod
    def make(cls, world: Any, rewards: RewardTable) -> Self:
        """See `Domain`."""
        return cls(world, rewards)

    def begin(
        self,
        seed: int,
        log: EventLog,
        *,
        watched: bool,  # noqa: ARG002 -- for domains that draw
    ) -> tuple[Any, Mapping[str, Leaf]]:
        """An episode, a `Simulation`, and what each action of the vocabulary does in a tick of it.

        `watched`: its scenes will be asked for.
        """
        episode: Any = type(self).Episode(self.world, seed, log)
        return episode, {name: getattr(episode, name) for name in self.schema.vocabulary.actions}

    def run_episode(
        self,
        tree: Node,
        seed: int,
        weights: Mapping[str, float],
        observer: Observer | None = None,
    ) -> Outcome:
        """See `Domain`: senses, ticks the tree, steps the world; again and again.

        The ending is "time", or what `step` returned.

        Raises:
            DomainError: a leaf returned no status, a key or counter is missing, or a key's value
                is no finite number.
        """
        log = EventLog(self.rewards, self.schema, weights, observer)
        episode, leaves = self.begin(seed, log, watched=observer is not None)
        step, measures = getattr(episode, "step", str), getattr(episode, "measures", dict)
        scene = getattr(episode, "scene", lambda: None)
        keys, places = self.schema.vocabulary.keys, self.schema.vocabulary.places
        board = [0.0] * len(places)
        watch = None if observer is None else observer.node
        tick = compile_tree(tree, _Leaves(leaves, log), board, places, watch=watch)
        done, ending = 0, ""
        while not ending and done < self.world.ticks:
            values = episode.sense()
            try:
                board[:] = [float(values[key]) for key in keys]
            except KeyError as error:
                raise DomainError(
                    f"Expected a value of the key {error.args[0]} from `sense`, found none."
                ) from None
            if not isfinite(sum(board)):
                _must_be_finite(keys, board)
            tick()
            done += 1
            if observer is not None:
                observer.tick(board, scene())
            ending = step()
        return Outcome(
            components=log.components,
            counters=dict(_counters(self.schema, log, measures())),
            seconds=done * self.step_s,
            endings=(ending or "time",),
        )


def _must_be_finite(keys: Mapping[str, Key], board: Sequence[float]) -> None:
    """Raises DomainError for a value that no condition can ask for."""
    for (name, key), found in zip(keys.items(), board, strict=True):
        if not isfinite(found):
            most = "" if key.most is None else f" and at most {key.most:g}"
            expected = "True or False" if key.flag else f"a number of at least {key.low:g}{most}"
            raise DomainError(
                f"Expected {expected} as the value of the key {name} from `sense`, found {found}."
            )


def _counters(
    schema: Schema, log: EventLog, measures: Mapping[str, float]
) -> Iterator[tuple[str, float]]:
    for name in schema.counters:
        if name not in measures and name not in schema.events:
            raise DomainError(
                f"Expected the counter {name} from `measures`, as no event has that name."
            )
        yield name, float(measures.get(name, log.counts[name]))


class _Leaves(dict[str, Tick]):
    """The actions of a tree. Each look-up makes a leaf of its own, with its own generator."""

    def __init__(self, leaves: Mapping[str, Leaf], log: EventLog) -> None:
        super().__init__()
        self._leaves, self._log = leaves, log

    def __missing__(self, name: str) -> Tick:
        leaf, log = self._leaves[name], self._log
        call = _generated(leaf) if isgeneratorfunction(leaf) else lambda _fresh: leaf()

        def tick(fresh: bool) -> int:
            log.action = name
            status = call(fresh)
            log.action = ""
            if not isinstance(status, int) or not 0 <= status <= RUNNING:
                raise DomainError(
                    f"Expected True, False or RUNNING from the action {name}, found {status!r}."
                )
            return int(status)

        return tick


def _generated(leaf: Callable[[], Generator[None, None, bool]]) -> Callable[[bool], Any]:
    """A leaf that is a generator function: it begins anew when its node starts."""
    going: Generator[None, None, bool] | None = None

    def call(fresh: bool) -> Any:
        nonlocal going
        if fresh or going is None:
            going = leaf()
        try:
            next(going)
        except StopIteration as end:
            going = None
            return end.value
        return RUNNING

    return call
