"""The configuration of an environment: observations as keys, actions, and events."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import replace
from math import inf
from typing import Annotated, Any, Final, Self

from pydantic import BaseModel, Field, FiniteFloat, StringConstraints, model_validator

from islandgp.bt.core.vocabulary import NAME
from islandgp.domain import (
    MAX_DELAY,
    SUCCESS,
    Action,
    Counter,
    Event,
    Key,
    Parameter,
    Schema,
    Vocabulary,
    enumeration,
    flag,
    number,
    real,
)

Word = Annotated[str, StringConstraints(pattern=f"^{NAME.pattern}$")]

EnvironmentAction = int | tuple[FiniteFloat, ...]

REWARD_EVENTS: Final = {
    "reward": Event("the environment's own reward of a step", "reward"),
    "step": Event("steps"),
}
"""Events of every environment, which signals can use in addition to observations."""


class Observation(BaseModel, frozen=True, extra="forbid"):
    """A number of the observation as a key."""

    at: Annotated[int, Field(ge=0)] | str  # its place in the observation; in a Dict, `key.place`
    meaning: str  # one line, with the unit
    flag: bool = False  # True: a flag, yes for values above one half
    words: tuple[Word, ...] = ()  # of a number that counts from 0: names of its values
    range: tuple[FiniteFloat, FiniteFloat] = (0.0, 1.0)  # values are clipped to it
    step: float = Field(default=0.1, gt=0)  # distance between two thresholds of random trees
    noise: float = Field(default=0.0, ge=0, le=1e6)  # standard deviation in perturbed worlds

    def key(self, whole: Collection[int | str]) -> Key:
        """The key for the vocabulary; `whole` are the places of whole numbers."""
        if self.flag:
            return flag(self.meaning)
        if self.words:
            return enumeration(self.meaning, self.words)
        low, high = self.range
        key = number(self.meaning, low, high, self.step, most=high, noise=self.noise)
        is_whole = self.at in whole and not any(bound % 1 for bound in (low, high, self.step))
        return replace(key, whole=is_whole)


class Filled(BaseModel, frozen=True, extra="forbid"):
    """A number of the environment's action as an argument of an action of the tree."""

    at: int = Field(default=0, ge=0)  # its place in the environment's action
    meaning: str  # one line
    range: tuple[FiniteFloat, FiniteFloat]
    default: FiniteFloat | None = None  # None: the middle of the range
    step: float | None = Field(default=None, gt=0)  # of random numbers; None: any number
    logarithmic: bool = False
    unit: str = ""

    def parameter(self) -> Parameter:
        """The parameter for the vocabulary."""
        others = self.model_dump(exclude={"at", "meaning", "range"})
        return real(self.meaning, *self.range, **others)


class Choice(BaseModel, frozen=True, extra="forbid"):
    """An action of the environment."""

    do: EnvironmentAction | None = None  # a number, or a list; None: its arguments fill `otherwise`
    meaning: str  # one line
    arguments: dict[Word, Filled] = Field(default_factory=dict)


class Signal(BaseModel, frozen=True, extra="forbid"):
    """An event in each step in which a value is between two bounds."""

    of: str  # an observation, `reward`, or `step`, the number of steps so far
    meaning: str  # one line
    above: float = -inf
    below: float = inf


class GymnasiumWorld(BaseModel, frozen=True, extra="forbid"):
    """The configuration group `world`."""

    name: Word  # of the domain, as `domain NAME` in a tree file
    environment: str = Field(min_length=1)  # as for gymnasium.make
    options: dict[str, Any] = Field(default_factory=dict)  # further arguments of gymnasium.make
    ticks: int = Field(ge=1, le=1_000_000)  # steps of an episode, at most
    step_s: float = Field(default=1.0, gt=0)  # simulated s of a step
    task: str
    habits: tuple[str, ...] = ()
    observations: dict[Word, Observation] = Field(min_length=1)
    actions: dict[Word, Choice] = Field(min_length=1)
    otherwise: EnvironmentAction | None = None
    """The action where a tree chooses none: a number, or a list of as many as the environment
    takes; None: the first of each choice, or zeros."""
    signals: dict[Word, Signal] = Field(default_factory=dict)
    delay: int = Field(default=0, ge=0, le=MAX_DELAY)  # most ticks of delay in perturbed worlds
    shrink: int = Field(default=1, ge=1, le=64)  # factor by which frames are reduced in size
    frame_every: int = Field(default=1, ge=1, le=1000)  # ticks between two frames

    @model_validator(mode="after")
    def _names_fit(self) -> Self:
        for name, choice in self.actions.items():
            if choice.do is None and not choice.arguments:
                raise ValueError(f"actions.{name}: expected do, or arguments, found neither")
            if isinstance(choice.do, int) and choice.arguments:
                raise ValueError(
                    f"actions.{name}: expected a list as do beside arguments, found {choice.do}"
                )
        known = [*REWARD_EVENTS, *self.observations]
        for name, signal in self.signals.items():
            if name in (*REWARD_EVENTS, "return", "steps"):
                raise ValueError(f"signals: expected another name, as {name!r} is there already")
            if signal.of not in known:
                raise ValueError(
                    f"signals.{name}.of: expected one of {', '.join(known)}, found {signal.of!r}"
                )
        return self

    def declared(self, whole: Collection[int | str]) -> Schema:
        """The schema of the domain; `whole` are the places of whole numbers in an observation.

        Raises DomainError for keywords of the language.
        """
        signals = {name: Event(signal.meaning) for name, signal in self.signals.items()}
        counts = {name: Counter(signal.meaning) for name, signal in self.signals.items()}
        return Schema(
            vocabulary=Vocabulary(
                domain=self.name,
                actions={n: _action(choice) for n, choice in self.actions.items()},
                keys={n: observation.key(whole) for n, observation in self.observations.items()},
            ),
            components={
                "reward": "the environment's own reward",
                "length": "points for lasting",
                "signals": "points for the configured signals",
            },
            events={**REWARD_EVENTS, **signals},
            counters={
                "return": Counter("sum of the environment's own rewards"),
                "steps": Counter("steps"),
                **counts,
            },
            task=self.task,
            habits=self.habits,
            delay=self.delay,
        )


def _action(choice: Choice) -> Action:
    fields = (
        "of several in a step the last counts"
        if choice.do is not None or not choice.arguments
        else "it leaves the other numbers of a step as they are"
    )
    arguments = {name: each.parameter() for name, each in choice.arguments.items()}
    places: Collection[int] = [each.at for each in choice.arguments.values()]
    if isinstance(choice.do, tuple):
        places = range(len(choice.do))
    uses = tuple(f"number_{place}" for place in places) or ("action",)
    return Action(
        f"{choice.meaning}; {fields}", frozenset({SUCCESS}), arguments=arguments, uses=uses
    )
