"""The curriculum: multipliers of the fitness components by stage (section 2.3.1, Table 2)."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Annotated, Any

from pydantic import BaseModel, Field, FiniteFloat, model_validator

from islandgp.domain import Schema
from islandgp.domain.rewards import unknown

Multiplier = Annotated[FiniteFloat, Field(ge=0)]


class Stage(BaseModel, frozen=True, extra="forbid"):
    """A row of Table 2."""

    epochs: tuple[int, int]  # first and last epoch, from 1
    multipliers: dict[str, Multiplier]  # by component; 1 for those not named
    world: dict[str, Any] = Field(default_factory=dict)
    """Settings of the group `world` that differ in this stage, e.g. `{levels: [DoorKey]}`."""


class Curriculum(BaseModel, frozen=True, extra="forbid"):
    """Table 2."""

    generations_per_epoch: int = Field(ge=1)
    stages: tuple[Stage, ...] = Field(min_length=1)
    last_only: bool = False  # True: every generation belongs to the last stage

    @model_validator(mode="after")
    def _no_gaps(self) -> Curriculum:
        due = 1
        for i, stage in enumerate(self.stages, 1):
            first, last = stage.epochs
            if first != due or last < first:
                raise ValueError(
                    f"stages: expected stage {i} to start with epoch {due},"
                    f" found {list(stage.epochs)}"
                )
            due = last + 1
        return self

    def faults(self, schema: Schema) -> Iterator[str]:
        """A line for each name that the domain does not declare."""
        for i, stage in enumerate(self.stages):
            for name in stage.multipliers:
                path = f"curriculum.stages.{i}.multipliers.{name}"
                yield from unknown(path, name, schema.components)

    def epoch(self, generation: int) -> int:
        """The epoch of a generation, from 1: generations 0-5 belong to epoch 1, 6-10 to 2."""
        return max(1, -(-generation // self.generations_per_epoch))

    def stage(self, generation: int) -> int:
        """Index of the stage of a generation; the last one has no end."""
        epoch, last = self.epoch(generation), len(self.stages) - 1
        begun = (i for i, stage in enumerate(self.stages) if epoch <= stage.epochs[1])
        return last if self.last_only else next(begun, last)

    def multipliers(self, stage: int) -> Mapping[str, float]:
        """The multipliers of the stage with this index, by component.

        They have all components that any stage names, so that states of different stages have the
        same fields.
        """
        named = (name for each in self.stages for name in each.multipliers)
        return {**dict.fromkeys(named, 1.0), **self.stages[stage].multipliers}
