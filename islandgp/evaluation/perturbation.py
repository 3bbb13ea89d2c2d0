"""Changed worlds: a stage's settings, settings drawn from ranges, noisy and delayed sensors.

A tree is robust if it earns as much in slightly different worlds. The perturbation of a world is a
function of the world's seed alone.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from difflib import get_close_matches
from typing import Annotated, Any, Final, TypeAlias

from pydantic import BaseModel, Field, FiniteFloat, ValidationError, field_validator

from islandgp.domain import MAX_DELAY, Domain, Schema, SensorFaults
from islandgp.errors import IslandError, brief
from islandgp.plain import RISING, flatten
from islandgp.seeding import Stream, stream

CACHE_SIZE: Final = 64  # size of a process's cache of perturbed domains

Span: TypeAlias = Annotated[tuple[FiniteFloat, FiniteFloat], RISING]


class Perturbation(BaseModel, frozen=True, extra="forbid"):
    """The key `perturb`: how worlds differ from the configured one."""

    world: dict[str, Span] = Field(default_factory=dict, max_length=100)
    """Least and greatest value of settings of the group `world`, nested or by dotted name. Whole
    numbers stay whole."""
    noise: float = Field(default=0.0, ge=0, le=100)  # multiple of the keys' declared noise
    delay: int = Field(default=0, ge=0, le=MAX_DELAY)  # most ticks of delay of the sensors
    training: bool = False  # True: training and validation are in perturbed worlds

    @field_validator("world", mode="before")
    @classmethod
    def _flattened(cls, world: Any) -> Any:
        return flatten(world) if isinstance(world, Mapping) else world

    def changes(self, world: Mapping[str, Any], seed: int) -> dict[str, Any]:
        """The changed settings of the perturbed world with this seed, by dotted name."""
        rng = stream(seed, Stream.PERTURBATION)
        settings = flatten(world)
        return {
            name: int(rng.integers(int(least), int(most) + 1))
            if isinstance(settings[name], int)
            else float(rng.uniform(least, most))
            for name, (least, most) in sorted(self.world.items())
        }

    def sensors(self) -> SensorFaults | None:
        """The faults of the sensors; None: they have none."""
        return SensorFaults(self.noise, self.delay) if self.noise or self.delay else None

    def in_words(self) -> str:
        """The perturbation as text."""
        ranges = (f"{name} {low:g} to {high:g}" for name, (low, high) in self.world.items())
        noise = [f"noise {self.noise:g}"] if self.noise else []
        delay = [f"delay 0 to {self.delay} ticks"] if self.delay else []
        return ", ".join([*ranges, *noise, *delay])

    def faults(self, factory: Any, world: BaseModel, rewards: Any, schema: Schema) -> Iterator[str]:
        """A line for each part of the perturbation that the domain does not support."""
        if not (self.world or self.noise or self.delay):
            yield "perturb: expected world, noise or delay, found nothing to perturb; give one"
        if self.world:
            wrong = [*self._wrong_ranges(flatten(world.model_dump()))]
            yield from wrong or self._wrong_ends(factory, world, rewards)
        if self.noise and not any(key.noise for key in schema.vocabulary.keys.values()):
            yield "perturb.noise: expected a domain whose keys declare noise; leave it out"
        if self.delay > schema.delay:
            yield (
                f"perturb.delay: expected at most {schema.delay} ticks, as the domain declares,"
                f" found {self.delay}"
            )

    def _wrong_ranges(self, settings: Mapping[str, Any]) -> Iterator[str]:
        for name, (least, most) in self.world.items():
            path, value = f"perturb.world.{name}", settings.get(name)
            if isinstance(value, bool) or not isinstance(value, int | float):
                near = get_close_matches(name, settings, 1, 0.5)
                hint = f"did you mean perturb.world.{near[0]}?" if near else "leave it out"
                yield f"{path}: expected a number among the world's settings, found none; {hint}"
            elif isinstance(value, int) and (least % 1 or most % 1):
                yield f"{path}: expected whole numbers, found [{least:g}, {most:g}]"

    def _wrong_ends(self, factory: Any, world: BaseModel, rewards: Any) -> Iterator[str]:
        """A line if the world does not accept all lower ends, or all upper ends, of the ranges."""
        for end, extreme in enumerate(("least", "greatest")):
            values = {name: span[end] for name, span in self.world.items()}
            try:
                factory.make(staged(world, values), rewards)
            except (ValidationError, IslandError) as error:
                found = brief(error)
                if isinstance(error, ValidationError):
                    first = error.errors(include_url=False)[0]
                    found = f"{'.'.join(map(str, first['loc']))}: {first['msg']}"
                yield f"perturb.world: with the {extreme} values: {found}"
                return


@dataclass(frozen=True)
class PerturbedWorlds:
    """Creates the domain of each perturbed world; equal arguments give equal domains."""

    perturbation: Perturbation
    factory: Any  # the domain's class
    worlds: tuple[BaseModel, ...]  # settings of the group `world`, by stage
    rewards: Any
    _domains: dict[tuple[int, int], Domain] = field(default_factory=dict, repr=False, compare=False)

    def domain(self, stage: int, seed: int) -> Domain:
        """The domain of a world seed in a stage. Raises ConfigError, pydantic.ValidationError."""
        if (stage, seed) not in self._domains:
            if len(self._domains) >= CACHE_SIZE:
                self._domains.clear()
            world = self.worlds[stage]
            changed = staged(world, self.perturbation.changes(world.model_dump(), seed))
            domain = self.factory.make(changed, self.rewards)
            if (faults := self.perturbation.sensors()) is not None:
                domain = domain.with_sensors(faults)
            self._domains[stage, seed] = domain
        return self._domains[stage, seed]


def staged(world: BaseModel, changes: Mapping[str, Any]) -> BaseModel:
    """The settings with changes, nested or by dotted name.

    Raises pydantic.ValidationError if they are invalid.
    """
    return type(world).model_validate(_changed(world.model_dump(), changes)) if changes else world


def _changed(settings: Any, changes: Mapping[str, Any]) -> dict[str, Any]:
    changed = {**settings} if isinstance(settings, Mapping) else {}
    for name, value in changes.items():
        first, _, rest = name.partition(".")
        inner = {rest: value} if rest else value
        nested = isinstance(inner, Mapping)
        changed[first] = _changed(changed.get(first), inner) if nested else inner
    return changed
