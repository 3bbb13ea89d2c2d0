"""Staged training: which multipliers hold in which generation (section 2.3.1, Table 2)."""

from __future__ import annotations

from pydantic import BaseModel, Field, model_validator

from islandgp.scoring.rewards import Multipliers


class Stage(BaseModel, frozen=True, extra="forbid"):
    """A phase of Table 2."""

    epochs: tuple[int, int]  # first and last epoch, from 1
    multipliers: Multipliers


class Curriculum(BaseModel, frozen=True, extra="forbid"):
    """Table 2."""

    generations_per_epoch: int = Field(ge=1)
    stages: tuple[Stage, ...] = Field(min_length=1)

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

    def epoch(self, generation: int) -> int:
        """The epoch of a generation, from 1: generations 0-5 belong to epoch 1, 6-10 to 2."""
        return max(1, -(-generation // self.generations_per_epoch))

    def stage(self, generation: int) -> int:
        """Index of the stage of a generation; the last one holds for ever."""
        epoch = self.epoch(generation)
        for i, stage in enumerate(self.stages):
            if epoch <= stage.epochs[1]:
                return i
        return len(self.stages) - 1

    def multipliers(self, stage: int) -> Multipliers:
        """The multipliers of a stage's index."""
        return self.stages[stage].multipliers
