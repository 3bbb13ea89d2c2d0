"""Behaviours, specialist classes and quality tiers: sections 2.3.3 and 2.3.4, Table 4.

An individual shows a behaviour if its counter is above 0. Some behaviours compete: an individual is
a specialist of the one that it shows more than `dominance_ratio` times as often as any other of
them. So the specialist classes are exclusive. The other behaviours are labels that an individual of
any class can have. (The inequalities of section 2.3.3 are missing in the paper's text.)
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Annotated, Final

from pydantic import BaseModel, Field, FiniteFloat, StringConstraints, model_validator

from islandgp.domain import Outcome, Schema
from islandgp.domain.rewards import unknown
from islandgp.text import title

CLASS_NAME: Final = r"^[a-z][a-z0-9_]*$"

Name = Annotated[str, StringConstraints(pattern=CLASS_NAME)]

RARE: Final = "rare"  # a behaviour that has almost died out
INTEGRATION: Final = "integration"  # several behaviours in one tree
EXPLORATION: Final = "exploration"  # a tree that differs from the population
AIMS: Final = (RARE, INTEGRATION, EXPLORATION)
"""Targets of trees beside single behaviours: rows of Table 7."""


class Specialists(BaseModel, frozen=True, extra="forbid"):
    """The exclusive classes that diversity counts, Eq. (3)."""

    of: tuple[Name, ...] = Field(min_length=1)  # behaviours that compete
    dominance_ratio: float = Field(ge=1)
    idle: Name  # class of individuals that show none; all others are working, Eq. (4)
    mixed: Name  # class of individuals in which no behaviour dominates


class Tier(BaseModel, frozen=True, extra="forbid"):
    """A row of Table 4. Values are those of counters, or of `fitness`."""

    at_least: dict[str, FiniteFloat] = Field(default_factory=dict)  # lower bounds, inclusive
    above: dict[str, FiniteFloat] = Field(default_factory=dict)  # lower bounds, exclusive
    at_most: dict[str, FiniteFloat] = Field(default_factory=dict)  # upper bounds, inclusive
    also: Name | None = None  # another tier that is required

    @model_validator(mode="after")
    def _can_be_reached(self) -> Tier:
        for name, most in self.at_most.items():
            if (least := self.at_least.get(name, self.above.get(name, most))) > most:
                raise ValueError(f"{name}: expected bounds up to at_most={most:g}, found {least:g}")
        return self

    def values_hold(self, o: Outcome) -> bool:
        """True if an outcome meets the conditions of this row."""
        for name, least in self.at_least.items():
            if not o.measure(name) >= least:
                return False
        for name, most in self.at_most.items():
            if not o.measure(name) <= most:
                return False
        return all(o.measure(name) > v for name, v in self.above.items())


class Classes(BaseModel, frozen=True, extra="forbid"):
    """Behaviours, specialist classes and tiers of individuals."""

    behaviours: dict[Name, str] = Field(min_length=1)  # the counter of each
    specialists: Specialists
    tiers: dict[Name, Tier] = Field(min_length=1)  # best first
    milestones: tuple[Name, ...] = Field(min_length=1)
    """Tiers whose first robots are reported and compared between runs, the easiest first."""
    agent: str = Field(default="Robot", min_length=1, max_length=40)
    """Term for an individual in titles, such as Robot or Lander; its plural has an s."""
    hardest: tuple[Name, ...] = ()
    """Behaviours, the hardest to find first; rule-based supervisors use this order to break ties.
    Behaviours that are not listed follow in reverse order."""

    @model_validator(mode="after")
    def _fits_together(self) -> Classes:
        sections: dict[str, Mapping[str, object]] = {"of": self.behaviours, "tiers": self.tiers}
        for path, name, where in (
            *(("specialists.of", name, "of") for name in self.specialists.of),
            *(("milestones", name, "tiers") for name in self.milestones),
            *(("hardest", name, "of") for name in self.hardest),
            *((f"tiers.{t}.also", r.also, "tiers") for t, r in self.tiers.items() if r.also),
        ):
            for line in unknown(path, name, sections[where]):
                raise ValueError(line)
        for path, listed in (
            ("specialists.of", self.specialists.of),
            ("milestones", self.milestones),
            ("hardest", self.hardest),
        ):
            if len(set(listed)) < len(listed):
                raise ValueError(f"{path}: expected each name once, found {', '.join(listed)}")
        for tier in self.tiers:
            self.needed(tier)
        names = [*self.behaviours, self.specialists.idle, self.specialists.mixed, *AIMS]
        if twice := {name for name in names if names.count(name) > 1}:
            raise ValueError(f"behaviours: expected each name once, found {min(twice)!r} twice")
        return self

    def needed(self, tier: str) -> tuple[str, ...]:
        """A tier and all tiers that it requires. Raises ValueError if they require each other."""
        chain: list[str] = []
        at: str | None = tier
        while at is not None:
            if at in chain:
                circle = " needs ".join([*chain, at])
                raise ValueError(f"tiers.{tier}.also: expected an end, found {circle}")
            chain.append(at)
            at = self.tiers[at].also
        return tuple(chain)

    def faults(self, schema: Schema) -> Iterator[str]:
        """A line for each name that the domain does not declare."""
        for name, counter in self.behaviours.items():
            yield from unknown(f"classes.behaviours.{name}", counter, schema.counters)
        measures = {**schema.counters, "fitness": None}
        for name, tier in self.tiers.items():
            for part in ("at_least", "above", "at_most"):
                for measure in getattr(tier, part):
                    path = f"classes.tiers.{name}.{part}.{measure}"
                    yield from unknown(path, measure, measures)

    def behaviours_of(self, counters: Mapping[str, float]) -> tuple[str, ...]:
        """The behaviours of an individual: those whose counter is above 0."""
        return tuple([name for name, counter in self.behaviours.items() if counters[counter] > 0])

    def tier_title(self, tier: str) -> str:
        """The title of a tier's individuals: "Full Service Robot" for `full_service`."""
        return f"{title(tier)} {self.agent}"

    @property
    def specialist_names(self) -> tuple[str, ...]:
        """The exclusive classes."""
        s = self.specialists
        return (s.idle, *s.of, s.mixed)

    @property
    def elite_behaviours(self) -> tuple[str, ...]:
        """The behaviours of behavioural elites and resurrection: working classes, then labels."""
        s = self.specialists
        return (*s.of, s.mixed, *(name for name in self.behaviours if name not in s.of))

    @property
    def targets(self) -> tuple[str, ...]:
        """The targets of trees: the rows of Table 7."""
        return (*self.behaviours, *AIMS)


@dataclass(frozen=True, slots=True)
class BehaviourLabels:
    """Class, tiers and behaviours of an individual."""

    specialist: str  # its exclusive class
    tiers: tuple[str, ...]  # that it reaches, best first
    behaviours: tuple[str, ...]  # those of `Classes.elite_behaviours` that it shows
    working: bool  # counts for the working ratio, Eq. (4)


def specialist(o: Outcome, classes: Classes) -> str:
    """The exclusive class of an individual (section 2.3.3)."""
    s = classes.specialists
    counts = sorted([(o.counters[classes.behaviours[name]], name) for name in s.of], reverse=True)
    highest, name = counts[0]
    if highest <= 0:
        return s.idle
    second = counts[1][0] if len(counts) > 1 else 0.0
    return name if highest > s.dominance_ratio * second else s.mixed


def tiers(o: Outcome, classes: Classes) -> tuple[str, ...]:
    """The tiers an individual reaches, best first."""
    reached = [name for name, tier in classes.tiers.items() if tier.values_hold(o)]
    return tuple([name for name in reached if all(n in reached for n in classes.needed(name))])


def classify(o: Outcome, classes: Classes) -> BehaviourLabels:
    """The class, tiers and behaviours of an individual, by its outcome."""
    kind, done = specialist(o, classes), classes.behaviours_of(o.counters)
    names = {kind, *[name for name in done if name not in classes.specialists.of]}
    return BehaviourLabels(
        specialist=kind,
        tiers=tiers(o, classes),
        behaviours=tuple([name for name in classes.elite_behaviours if name in names]),
        working=kind != classes.specialists.idle,
    )
