"""The ablation "another seed's record": repeats the guidance of another run.

Rates and trees are those that a supervisor advised in another run after the same generation,
independent of the state of this run. If the state matters, the supervisor beats this; if its
schedule alone helps, both do equally well.
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Final

import numpy as np
from pydantic import BaseModel, Field, TypeAdapter

import islandgp
from islandgp.errors import SupervisionError
from islandgp.scoring.state import PopulationState
from islandgp.supervision.base import Guidance, RunContext

REPEATED: Final = (
    *("phase", "pattern", "target", "intervention"),
    *("risk", "reasoning", "rationale"),
)
"""Fields of the record that are repeated unchanged."""

GUIDANCE: Final = TypeAdapter(Guidance)
DAMAGES: Final = (islandgp.TreeError, AttributeError, KeyError, TypeError, ValueError)
"""Errors of a record that cannot be read."""


class YokedSettings(BaseModel, frozen=True, extra="forbid"):
    """The folder and seeds of the other run."""

    record: str = Field(min_length=1)  # a run's folder; {seed} is replaced by the other seed
    first: int = Field(ge=0)  # lowest seed of the sweep
    seeds: int = Field(ge=2)  # number of consecutive seeds of the sweep

    def other_seed(self, seed: int) -> int:
        """The seed of the other run: the sweep's next seed, or its first after the last.

        Raises:
            SupervisionError: the seed is not in the sweep.
        """
        if not self.first <= seed < self.first + self.seeds:
            raise SupervisionError(
                f"Expected a seed of {self.first} to {self.first + self.seeds - 1}, found {seed};"
                " set supervisor.policy.first and supervisor.policy.seeds to those of the sweep."
            )
        return self.first + (seed - self.first + 1) % self.seeds

    def folder(self, seed: int) -> Path:
        """The folder of the other run for a seed. Raises SupervisionError as `other_seed`."""
        return Path(self.record.replace("{seed}", str(self.other_seed(seed))))


class Yoked:
    """Repeats the guidance of another run; ignores the state."""

    name = "yoked"
    Settings = YokedSettings

    @classmethod
    def check(cls, settings: YokedSettings, context: RunContext) -> None:
        """Raises SupervisionError if the record is missing or too short."""
        cls.lines(settings, context)

    @classmethod
    def make(cls, settings: YokedSettings, context: RunContext) -> Yoked:
        """See `Supervisor`. Raises SupervisionError as `check` does."""
        try:
            return cls([repeated(line) for line in cls.lines(settings, context)])
        except DAMAGES as error:
            raise damaged_record(settings.folder(context.seed), error) from None

    @classmethod
    def lines(cls, settings: YokedSettings, context: RunContext) -> list[bytes]:
        """The other run's records, one line per generation. Raises SupervisionError as `check`."""
        folder = settings.folder(context.seed)
        file = folder / "generations.jsonl"
        if not file.is_file():
            raise SupervisionError(
                f"Expected the record of another run in {folder}, found none; run it first, with"
                f" seed={settings.other_seed(context.seed)}, or set supervisor.policy.record."
            )
        lines = file.read_bytes().splitlines()
        if len(lines) < context.generations:
            raise SupervisionError(
                f"Expected a record of {context.generations} generations in {folder},"
                f" found {len(lines)}; let that run finish first."
            )
        return lines

    def __init__(self, schedule: Sequence[Guidance]) -> None:
        """`schedule` is the guidance by generation."""
        self.schedule = schedule

    def advise(self, state: PopulationState, rng: np.random.Generator) -> Guidance:  # noqa: ARG002 -- the protocol's
        """See `Supervisor`. The other run's guidance after the same generation."""
        return self.schedule[state.now.generation]


def damaged_record(folder: Path, error: Exception) -> SupervisionError:
    """The error for a record of another run that cannot be read."""
    return SupervisionError(
        f"Expected the record of another run in {folder}, found a damaged one"
        f" ({type(error).__name__}: {next(iter(str(error).splitlines()), '')});"
        " run it again under another name, or set supervisor.policy.record."
    )


def repeated(line: bytes) -> Guidance:
    """The guidance in a generation's record. Raises one of DAMAGES if it cannot be read."""
    recorded = json.loads(line)["guidance"]
    if recorded is None:
        return Guidance(None, None, Yoked.name, reasoning="the other run ended here")
    tree = None if recorded["tree"] is None else islandgp.parse(recorded["tree"])
    notes = {"led_by": recorded["source"]}
    fields = {name: recorded[name] for name in REPEATED}
    guidance = Guidance(recorded["wanted_rate"], tree, Yoked.name, notes=notes, **fields)
    return GUIDANCE.validate_python(guidance)
