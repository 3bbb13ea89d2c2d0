"""The ablation "another seed's record": guidance that was given to another population.

Rates and trees are those that some supervisor gave in another run, generation
by generation, whatever the state is here. If reading the state is what helps,
the supervisor beats this; if its schedule alone helps, the two are alike.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from pydantic import BaseModel, Field

from islandgp.bt.core.language import parse
from islandgp.errors import SupervisionError, TreeError, brief
from islandgp.gp.record import GenerationRecord
from islandgp.plain import validate_json
from islandgp.scoring.state import PopulationState
from islandgp.supervision.base import Guidance, Pattern, Phase, RunContext


class YokedSettings(BaseModel, frozen=True, extra="forbid"):
    """Whose record it is."""

    record: str = Field(min_length=1)  # a run's folder; {seed} is replaced by the other seed
    first: int = Field(ge=0)  # the sweep's least seed
    seeds: int = Field(ge=2)  # how many there are from it on

    def leader(self, seed: int) -> int:
        """The other seed: the next of the sweep's, the first after the last.

        Raises:
            SupervisionError: the seed is none of the sweep's.
        """
        if not self.first <= seed < self.first + self.seeds:
            raise SupervisionError(
                f"Expected a seed of {self.first} to {self.first + self.seeds - 1}, found {seed};"
                " set supervisor.policy.first and supervisor.policy.seeds to those of the sweep."
            )
        return self.first + (seed - self.first + 1) % self.seeds

    def folder(self, seed: int) -> Path:
        """The run that leads the run of a seed. Raises SupervisionError."""
        return Path(self.record.replace("{seed}", str(self.leader(seed))))


class Yoked:
    """Repeats another run's guidance, blind to the state."""

    name = "yoked"
    Settings = YokedSettings

    @classmethod
    def ready(cls, settings: YokedSettings, context: RunContext) -> None:
        """Raises SupervisionError where the record is missing or too short, and not yet to come."""
        if settings.folder(context.seed).resolve() not in context.coming:
            cls.lines(settings, context)

    @classmethod
    def make(cls, settings: YokedSettings, context: RunContext) -> Yoked:
        """See `Supervisor`. Raises SupervisionError as `ready` does."""
        try:
            return cls([repeated(line) for line in cls.lines(settings, context)])
        except (ValueError, TreeError) as error:
            folder = settings.folder(context.seed)
            raise SupervisionError(
                f"Expected the record of another run in {folder}, found a damaged one"
                f" ({brief(error)}); run it again under another name, or set"
                " supervisor.policy.record."
            ) from None

    @classmethod
    def lines(cls, settings: YokedSettings, context: RunContext) -> list[bytes]:
        """The other run's records, a generation a line. Raises SupervisionError as `ready`."""
        folder = settings.folder(context.seed)
        file = folder / "generations.jsonl"
        if not file.is_file():
            raise SupervisionError(
                f"Expected the record of another run in {folder}, found none; run it first, with"
                f" seed={settings.leader(context.seed)}, or set supervisor.policy.record."
            )
        lines = file.read_bytes().splitlines()
        if len(lines) < context.generations:
            raise SupervisionError(
                f"Expected a record of {context.generations} generations in {folder},"
                f" found {len(lines)}; let that run finish first."
            )
        return lines

    def __init__(self, given: Sequence[Guidance]) -> None:
        """`given` is what to say after each generation."""
        self.given = given

    def advise(self, state: PopulationState, rng: np.random.Generator) -> Guidance:  # noqa: ARG002 -- the protocol's
        """What was said after the same generation of the other run."""
        return self.given[state.now.generation]


def repeated(line: bytes) -> Guidance:
    """The guidance of a generation's record. Raises ValueError or TreeError where it has none."""
    said = validate_json(GenerationRecord, line)["guidance"]
    if said is None:
        return Guidance(None, None, Yoked.name, reasoning="the other run ended here")
    return Guidance(
        mutation_rate=said["wanted_rate"],
        tree=None if said["tree"] is None else parse(said["tree"]),
        source=Yoked.name,
        phase=None if said["phase"] is None else Phase(said["phase"]),
        pattern=None if said["pattern"] is None else Pattern(said["pattern"]),
        target=said["target"],
        intervention=said["intervention"],
        risk=said["risk"],
        reasoning=said["reasoning"],
        rationale=said["rationale"],
        notes={"led_by": said["source"]},
    )
