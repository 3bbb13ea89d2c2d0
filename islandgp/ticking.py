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

from collections.abc import Callable, Iterable, Mapping
from copy import copy
from difflib import get_close_matches
from functools import cache, partial, wraps
from inspect import isgenerator, signature
from math import inf, isfinite
from threading import local
from typing import Any, ClassVar, ParamSpec, Protocol, Self, TypeVar

from pydantic import BaseModel

from islandgp.bt.core.closures import Tick
from islandgp.bt.core.engine import compile_tree
from islandgp.bt.core.node import RUNNING, SUCCESS, ActionArgs, Node
from islandgp.bt.core.parameters import bound
from islandgp.bt.core.vocabulary import Key, Vocabulary
from islandgp.domain import Observer, Outcome, Schema
from islandgp.errors import DomainError
from islandgp.leaves import Leaf, is_flag, is_number, status_of, steps
from islandgp.plugin import defined_in, short_repr
from islandgp.scoring.rewards import RewardTable, worth
from islandgp.sensors import SensorFaults
from islandgp.time_limit import Overdue

__all__ = ["RUNNING", "EventLog", "Leaf", "Simulation", "Stepped", "once_a_thread"]

P = ParamSpec("P")
T = TypeVar("T")


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
        self.counts = dict.fromkeys(schema.events, 0)
        self.components = dict.fromkeys(schema.components, 0.0)
        self.action = ""  # the leaf that is being called
        self._rewarded = rewards.events.keys()
        self._worth = worth(rewards, weights)
        self._observer = observer
        self._logged: Callable[[str], None] | None = getattr(observer, "logged", None)

    def matters(self, event: str) -> bool:
        """True if an event is worth points, or somebody watches."""
        return event in self._rewarded or self._observer is not None

    def __call__(self, event: str, amount: float = 1.0) -> None:
        """Something happened. Raises DomainError for an event or amount that cannot be."""
        try:
            self.counts[event] += 1
        except KeyError:
            known, near = ", ".join(self.counts), _near(event, self.counts)
            raise DomainError(
                f"Expected an event of the schema ({known}), found {event!r}{near}."
            ) from None
        if not (type(amount) is float and -inf < amount < inf) and not is_number(amount):
            raise DomainError(
                f"Expected a finite amount of the event {event!r}, found {short_repr(amount)}."
            )
        if self._logged is not None:
            self._logged(event)
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
        """The value of each key of the vocabulary now, and no others; True and False for flags."""
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
    faults: SensorFaults | None = None  # between the world and the blackboard

    def __init__(self, world: Any, rewards: RewardTable) -> None:
        """Raises DomainError where `step_s`, or the setting `ticks`, is not what it must be."""
        _must_last(type(self), world, self.step_s)
        self.world = world
        self.rewards = rewards

    @classmethod
    def make(cls, world: Any, rewards: RewardTable) -> Self:
        """See `Domain`."""
        return cls(world, rewards)

    def with_sensors(self, faults: SensorFaults) -> Self:
        """See `Domain`."""
        changed = copy(self)
        changed.faults = faults
        return changed

    def about(self, seed: int | None = None) -> str:  # noqa: ARG002 -- for domains of many worlds
        """See `Domain`."""
        return f"An episode has at most {self.world.ticks:,} ticks of {self.step_s:g} s."

    def begin(
        self,
        seed: int,
        log: EventLog,
        *,
        watched: bool,  # noqa: ARG002 -- for domains that draw
    ) -> tuple[Any, Mapping[str, Leaf]]:
        """An episode, a `Simulation`, and what each action of the vocabulary does in a tick of it.

        `watched`: its scenes will be asked for.

        Raises:
            DomainError: there is no Episode, or it has no method for an action.
        """
        kind = getattr(type(self), "Episode", None)
        if kind is None:
            raise DomainError(
                f"Expected a class Episode in {type(self).__name__}, found none; write"
                f" `Episode = ...` there{defined_in(type(self))}."
            )
        try:
            episode: Any = kind(self.world, seed, log)
        except TypeError as error:
            _must_take(kind, 3, error, "an Episode that is made as Episode(world, seed, log)")
            raise
        return episode, {name: _leaf(episode, name) for name in self.schema.vocabulary.actions}

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
            DomainError: a leaf returned no status, `sense` or `measures` not a number for each key
                or counter, or `step` no text.
        """
        log = EventLog(self.rewards, self.schema, weights, observer)
        episode, leaves = self.begin(seed, log, watched=observer is not None)
        try:
            made = _Leaves(leaves, self.schema.vocabulary, log)
            return self._run(episode, made, tree, log, observer, seed)
        except TypeError as error:
            for name in ("sense", "step", "measures", "scene", *leaves):
                if (method := leaves.get(name, getattr(episode, name, None))) is not None:
                    given = [*self.schema.vocabulary.action(name).arguments]
                    called = f"{name}({', '.join(f'{each}=...' for each in given)})"
                    _must_take(
                        method, 0, error, f"a method {name} that is called as {called}", given
                    )
            raise

    def reader(self, episode: Any) -> Callable[[], list[float]]:
        """A function that returns the values of an episode's keys now, in the vocabulary's order.

        It raises DomainError where `sense` returns anything but a finite number for each key.
        """
        sense, keys = episode.sense, self.schema.vocabulary.keys

        def read() -> list[float]:
            values = sense()
            try:
                found = [values[key] for key in keys]
                if not isfinite(sum(found)) or len(values) != len(keys):
                    must_be_values(keys, values, sense)
            except (KeyError, TypeError, IndexError):
                must_be_values(keys, values, sense)
                raise
            return [*map(float, found)]

        return read

    def _run(
        self,
        episode: Any,
        leaves: _Leaves,
        tree: Node,
        log: EventLog,
        observer: Observer | None,
        seed: int,
    ) -> Outcome:
        step, measures = getattr(episode, "step", str), getattr(episode, "measures", dict)
        scene = getattr(episode, "scene", lambda: None)
        places = self.schema.vocabulary.places
        board = [0.0] * len(places)
        watch = None if observer is None else observer.node
        tick = compile_tree(tree, leaves.tick_of, board, places, watch=watch, step_s=self.step_s)
        read, see = self.reader(episode), None
        if self.faults is not None:
            see = self.faults.sensors(self.schema.vocabulary.keys, seed)
        done, ending, most = 0, "", self.world.ticks
        while not ending and done < most:
            board[:] = read() if see is None else see(read())
            tick()
            done += 1
            if observer is not None:
                observer.tick(board, scene())
            ending = step()
            if ending and not isinstance(ending, str):
                raise DomainError(_no_ending(ending, step))
        return Outcome(
            components=log.components,
            counters=_counters(self.schema, log, measures),
            seconds=done * self.step_s,
            endings=(ending or "time",),
        )


def _must_last(kind: type, world: Any, step_s: Any) -> None:
    """Raises DomainError for a tick, or an episode, that takes no time or for ever."""
    if not (is_number(step_s) and step_s > 0):
        raise DomainError(
            f"Expected a number of seconds above 0 as {kind.__name__}.step_s, found"
            f" {step_s!r}{defined_in(kind)}."
        )
    ticks: Any = getattr(world, "ticks", None)
    if not (is_number(ticks) and ticks >= 1):
        raise DomainError(
            f"Expected the setting ticks of {type(world).__name__} to be a number of at least 1,"
            f" found {ticks!r}; declare it as `ticks: int = Field(ge=1)`{defined_in(type(world))}."
        )


def _leaf(episode: Any, name: str) -> Leaf:
    """The episode's method for an action. Raises DomainError where there is none."""
    found = getattr(episode, name, None)
    if not callable(found):
        what = "none" if found is None else short_repr(found)
        raise DomainError(
            f"Expected a method {name} in {type(episode).__name__} for the action of that name,"
            f" found {what}{defined_in(type(episode))}."
        )
    leaf: Leaf = found
    return leaf


def _must_take(
    function: Any, arguments: int, error: TypeError, expected: str, names: Iterable[str] = ()
) -> None:
    """Raises DomainError where a TypeError is that of a call with other arguments."""
    try:
        signature(function).bind(*(None,) * arguments, **dict.fromkeys(names))
    except TypeError as why:
        raise DomainError(f"Expected {expected}, found: {why}{defined_in(function)}.") from error
    except ValueError:  # it has no signature
        return


def _near(name: object, known: Iterable[str]) -> str:
    """The name that may have been meant, as a remedy; or ""."""
    near = get_close_matches(str(name), [*known], 1, 0.6)
    return f"; perhaps {near[0]} is meant" if near else ""


def must_be_values(keys: Mapping[str, Key], values: Any, sense: object) -> None:
    """Raises DomainError for what `sense` returned, unless it is a number for each key."""
    where = defined_in(sense)
    if not isinstance(values, Mapping):
        raise DomainError(
            f"Expected a dict of values by key from `sense`, found {short_repr(values)}{where}."
        )
    for name, key in keys.items():
        if name not in values:
            raise DomainError(
                f"Expected a value of the key {name} from `sense`, found none{where}."
            )
        if not is_number(values[name]) and not is_flag(values[name]):
            most = "" if key.most is None else f" and at most {key.most:g}"
            expected = "True or False" if key.flag else f"a number of at least {key.low:g}{most}"
            raise DomainError(
                f"Expected {expected} as the value of the key {name} from `sense`, found"
                f" {short_repr(values[name])}{where}."
            )
    for name in values:
        if name not in keys:
            raise DomainError(
                f"Expected values of the vocabulary's keys from `sense`, found {name!r} as well"
                f"{_near(name, keys)}; declare it among the keys, or leave it out{where}."
            )


def _no_ending(found: object, step: object) -> str:
    hint = "; leave `yield` out of it" if isgenerator(found) else ""
    return (
        'Expected why the episode is over from `step`, a text, or "" to go on, found'
        f" {short_repr(found)}{hint}{defined_in(step)}."
    )


def _counters(schema: Schema, log: EventLog, measures: Any) -> dict[str, float]:
    """The value of each counter. Raises DomainError where `measures` gives no number for one."""
    found = measures()
    if fault := _wrong_measure(schema, found):
        raise DomainError(f"{fault}{defined_in(measures)}.")
    return {name: float(found.get(name, log.counts.get(name, 0))) for name in schema.counters}


def _wrong_measure(schema: Schema, found: Any) -> str:
    """What is wrong with the values from `measures`, or ""."""
    if not isinstance(found, Mapping):
        return f"Expected a dict of values by counter from `measures`, found {short_repr(found)}"
    for name, value in found.items():
        if name not in schema.counters:
            return (
                f"Expected counters of the schema from `measures`, found {name!r}"
                f"{_near(name, schema.counters)}; declare it among the counters, or leave it out"
            )
        if not is_number(value) and not is_flag(value):
            expected = f"Expected a finite number as the counter {name} from `measures`"
            return f"{expected}, found {short_repr(value)}"
    for name in schema.counters:
        if name not in found and name not in schema.events:
            return f"Expected the counter {name} from `measures`, as it is no event, found none"
    return ""


class _Leaves:
    """The leaves of a tree, each with its own generator."""

    def __init__(self, leaves: Mapping[str, Leaf], vocabulary: Vocabulary, log: EventLog) -> None:
        self._leaves, self._vocabulary, self._log = leaves, vocabulary, log

    def tick_of(self, args: ActionArgs) -> Tick:
        """The tick of a leaf; its function gets the values of its arguments by name."""
        name, log = args.name, self._log
        leaf: Leaf = self._leaves[name]
        if arguments := self._vocabulary.action(name).arguments:
            leaf = partial(leaf, **bound(args, arguments))
        call = steps(leaf)

        def tick(fresh: bool) -> int:
            log.action = name
            try:
                status = call(fresh)
            except Overdue as late:
                late.action = late.action or name
                raise
            log.action = ""
            if status is True:
                return SUCCESS
            return status_of(status, name, self._leaves[name])

        return tick
