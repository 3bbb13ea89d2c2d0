"""Fitness: rewards by event (Table 3) under multipliers by component, Eq. (1) and (2), and a log of
events with their points."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from difflib import get_close_matches
from math import inf

from pydantic import BaseModel, Field, FiniteFloat, model_validator

from islandgp.domain.checks import near_hint
from islandgp.domain.contract import Observer, Schema
from islandgp.errors import DomainError
from islandgp.leaves import is_number
from islandgp.plugin import short_repr


class Band(BaseModel, frozen=True, extra="forbid"):
    """The points of an event whose amount is below a bound."""

    below: FiniteFloat  # the bound, exclusive
    points: FiniteFloat  # of such an event


class Reward(BaseModel, frozen=True, extra="forbid"):
    """A row of Table 3: the points of an event, by its amount. Penalties are negative."""

    component: str  # of the fitness to which the points are added
    base: FiniteFloat = 0  # points per event
    per_unit: FiniteFloat = 0  # points per unit of the amount
    bands: tuple[Band, ...] = ()  # by rising bound; the first match replaces base and per_unit
    over: FiniteFloat | None = None  # amounts up to this earn nothing

    @model_validator(mode="after")
    def _rising(self) -> Reward:
        if list(self.bands) != sorted(self.bands, key=lambda band: band.below):
            raise ValueError("bands: expected rising levels of `below`")
        return self

    @property
    def costs(self) -> bool:
        """True if an event of a positive amount can cost points."""
        return min(self.base, self.per_unit, *(band.points for band in self.bands)) < 0

    def points(self, amount: float) -> float:
        """Points of one event, before any multiplier."""
        if self.over is not None and amount <= self.over:
            return 0.0
        for band in self.bands:
            if amount < band.below:
                return band.points
        return self.base + self.per_unit * amount


class RewardTable(BaseModel, frozen=True, extra="forbid"):
    """Table 3. An event without a row earns nothing."""

    events: dict[str, Reward]
    maxima: dict[str, FiniteFloat] = Field(default_factory=dict)
    """By component: what its points are divided by, Eq. (2); empty: raw points."""

    def faults(self, schema: Schema) -> Iterator[str]:
        """A line for each name that the domain does not declare."""
        for event, reward in self.events.items():
            yield from unknown(f"rewards.events.{event}", event, schema.events)
            where = f"rewards.events.{event}.component"
            yield from unknown(where, reward.component, schema.components)
        for name in self.maxima:
            yield from unknown(f"rewards.maxima.{name}", name, schema.components)
        if self.maxima:
            for name in schema.components:
                if self.maxima.get(name, 0) <= 0:
                    yield f"rewards.maxima.{name}: expected a number above 0, as others have one"


def unknown(path: str, name: str, known: Mapping[str, object]) -> Iterator[str]:
    """A line if a name is not known, with the nearest name or all of them."""
    if name not in known:
        near = get_close_matches(name, known, 1, 0.7)
        hint = f"; did you mean {near[0]}?" if near else ""
        yield f"{path}: expected one of {', '.join(known)}, found {name!r}{hint}"


Worth = Callable[[str, float], tuple[str, float]]  # (event, amount) -> (component, points)


def worth(table: RewardTable, weights: Mapping[str, float]) -> Worth:
    """The function of an event's points by its amount: a term of Eq. (1)."""
    rows = {}
    for event, reward in table.events.items():
        scale = float(weights.get(reward.component, 1.0)) / table.maxima.get(reward.component, 1.0)
        rows[event] = reward.component, reward.points, scale

    def value(event: str, amount: float) -> tuple[str, float]:
        if event not in rows:
            return "", 0.0
        component, points, scale = rows[event]
        return component, scale * points(amount)

    return value


class EventLog:
    """Counts the events of an episode and adds up their points by component.

    `log("picked")` and `log("driven", 2.5)` record an event.
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
        """True if an event earns points or the episode has an observer.

        Args:
            event: of the schema.

        Returns:
            False if the event need not be recorded for its points.
        """
        return event in self._rewarded or self._observer is not None

    def __call__(self, event: str, amount: float = 1.0) -> None:
        """Records an event.

        Args:
            event: of the schema.
            amount: in the event's unit; finite.

        Raises:
            DomainError: the event is not in the schema, or the amount is not a finite number.
        """
        try:
            self.counts[event] += 1
        except KeyError:
            events, near = ", ".join(self.counts), near_hint(event, self.counts)
            raise DomainError(
                f"Expected an event of the schema ({events}), found {event!r}{near}."
            ) from None
        if not (type(amount) is float and -inf < amount < inf):
            if not is_number(amount):
                raise DomainError(
                    f"Expected a finite amount of the event {event!r}, found {short_repr(amount)}."
                )
            amount = float(amount)  # of NumPy's numbers, which records cannot hold
        if self._logged is not None:
            self._logged(event)
        if event not in self._rewarded:
            return
        component, points = self._worth(event, amount)
        if component:
            self.components[component] += points
            if self._observer is not None:
                self._observer.credit(component, points, event, self.action)
