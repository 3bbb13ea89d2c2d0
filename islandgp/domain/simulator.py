"""`SimulatorDomain`: a domain over a simulator with a step function.

    class Robot:                          # one episode: a method for each action of the schema
        def __init__(self, world, seed, log): ...
        def sense(self): return {"have_block": self.block}
        def Pick(self): self.log("picked"); return True

    class PickPlace(SimulatorDomain):
        World, Episode, schema = World, Robot, SCHEMA

A leaf is a function that is called once per tick while its node runs, and returns True
(success), False (failure) or RUNNING. Or it is a generator function: it is RUNNING at
each `yield`, and returns True or False at its end. A generator that is aborted, or runs at the
episode's end, is closed, so that its `finally` runs.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from math import isfinite
from operator import ge, le
from typing import Any, ClassVar, Protocol

from pydantic import BaseModel

from islandgp.bt.core.node import Node
from islandgp.domain.checks import must_be_numbers, no_ending
from islandgp.domain.contract import Domain, Observer, Outcome, Schema, wants_scenes
from islandgp.domain.rewards import EventLog, RewardTable
from islandgp.leaves import Leaf, compile_leaves


class Simulation(Protocol):
    """One episode of a stepped simulator, with one method per action of the schema.

    Optional methods:

    - `step() -> str` advances the simulator after a tick; returns the reason why the episode is
      over, or "" to continue.
    - `measures() -> Mapping[str, float]` returns the counters that are not numbers of events;
      called at the end.
    - `scene() -> Scene` returns the picture of the world.
    """

    def sense(self) -> Mapping[str, float]:
        """The present value of each key of the vocabulary, and no others; bool for flags."""
        ...


class SimulatorDomain(Domain):
    """Base class of a domain whose episodes are `Episode(world, seed, log)`.

    `World` has the setting `ticks`: the maximum number of ticks of an episode, >= 1.
    """

    Rewards: ClassVar[type[BaseModel]] = RewardTable
    Episode: ClassVar[Callable[[Any, int, EventLog], Simulation]]

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
        """Starts an episode.

        Args:
            seed: of the world, in [0, 2**32).
            log: for the episode's events.
            watched: True if `scene` will be called.

        Returns:
            The episode, a `Simulation`, and its leaf function for each action of the vocabulary.
        """
        episode: Any = type(self).Episode(self.world, seed, log)
        return episode, {name: getattr(episode, name) for name in self.schema.vocabulary.actions}

    def run_episode(
        self, tree: Node, seed: int, weights: Mapping[str, float], observer: Observer | None = None
    ) -> Outcome:
        """See `Domain`. Repeats: sense, tick the tree, step the simulator.

        The ending is "time" or the text returned by `step`.

        Raises:
            DomainError: a leaf did not return a status, `sense` or `measures` a number for each
                key or counter, or `step` a text.
        """
        log = EventLog(self.rewards, self.schema, weights, observer)
        draws = observer is not None and wants_scenes(observer)
        episode, leaves = self.begin(seed, log, watched=draws)
        step, measures = getattr(episode, "step", str), getattr(episode, "measures", dict)
        scene = getattr(episode, "scene", lambda: None) if draws else lambda: None
        vocabulary = self.schema.vocabulary
        key_index, initial = vocabulary.key_index, vocabulary.initial
        board = [initial.get(place, 0.0) for place in range(len(key_index))]
        sensed = {n: key for n, key in vocabulary.keys.items() if not key.writable}
        places = [key_index[name] for name in sensed]
        watch = None if observer is None else observer.node
        options = {"watch": watch, "step_s": self.step_s, "seed": seed}
        tick, runners = compile_leaves(tree, leaves, vocabulary, board, key_index, log, **options)
        read, see = self.reader(episode), None
        if self.faults is not None:
            see = self.faults.sensors(sensed, seed)
        done, ending, most = 0, "", self.world.ticks
        while not ending and done < most:
            values = read() if see is None else see(read())
            if initial:
                for place, value in zip(places, values, strict=True):
                    board[place] = value
            else:
                board[:] = values
            tick()
            done += 1
            if observer is not None:
                observer.tick(board, scene())
            ending = step()
            if ending and not isinstance(ending, str):
                raise no_ending(ending, step)
        for runner in runners:
            runner.stop()
        counters = _counters(self.schema, log, measures)
        seconds = float(done * self.step_s)
        return Outcome(log.components, counters, seconds, endings=(ending or "time",))

    def reader(self, episode: Any) -> Callable[[], list[float]]:
        """Makes a function that reads the blackboard keys of an episode.

        Args:
            episode: a `Simulation`.

        Returns:
            A function that returns the present values in the vocabulary's order, without keys that
            trees write. It raises DomainError unless `sense` returns a finite number for each.
        """
        sense = episode.sense
        keys = {n: key for n, key in self.schema.vocabulary.keys.items() if not key.writable}
        enumerated = {name: key for name, key in keys.items() if key.words}
        lows, mosts = ([key.bounds[end] for key in keys.values()] for end in range(2))

        def read() -> list[float]:
            values = sense()
            if enumerated and isinstance(values, Mapping):
                named = enumerated.keys() & values.keys()
                values = {**values, **{n: enumerated[n].indexed(values[n]) for n in named}}
            try:
                board = [values[key] for key in keys]
                in_range = all(map(le, lows, board)) and all(map(ge, mosts, board))
                if not (in_range and isfinite(sum(board))) or len(values) != len(keys):
                    must_be_numbers(values, "key", keys, keys, sense)
            except (KeyError, TypeError, IndexError):
                must_be_numbers(values, "key", keys, keys, sense)
                raise
            return [*map(float, board)]

        return read


def _counters(schema: Schema, log: EventLog, measures: Any) -> dict[str, float]:
    """The value of each counter. Raises DomainError for wrong values from `measures`."""
    measured = measures()
    others = [name for name in schema.counters if name not in schema.events]
    must_be_numbers(measured, "counter", dict.fromkeys(schema.counters), others, measures)
    return {name: float(measured.get(name, log.counts.get(name, 0))) for name in schema.counters}
