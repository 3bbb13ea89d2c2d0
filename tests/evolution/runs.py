"""Whole evolutions on the fake evaluator."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from islandgp.bt.core.node import Node
from islandgp.evolution.loop import evolve
from islandgp.gp.plan import Plan
from islandgp.gp.record import GenerationRecord, RunState, Step, record_values
from islandgp.records.files import dump
from islandgp.scoring.state import PopulationState
from islandgp.supervision.base import Guidance, Supervisor
from tests.composed import composed_plan
from tests.evolution.fake import Fake

SMALL = ("supervisor=baseline", "gp.population=12", "gp.generations=8")


def plan(*overrides: str) -> Plan:
    """A small plan, with overrides."""
    return composed_plan(*SMALL, *overrides)


class Constant:
    """A supervisor that always gives the same guidance, and keeps the states it got."""

    name = "says"

    def __init__(self, rate: float | None = 0.3, tree: Node | None = None) -> None:
        self.rate = rate
        self.tree = tree
        self.states: list[PopulationState] = []

    def advise(self, state: PopulationState, rng: np.random.Generator) -> Guidance:
        """See `Supervisor`; draws something, as supervisors may."""
        self.states.append(state)
        rng.random(3)
        return Guidance(self.rate, self.tree, self.name)


def run(
    run_plan: Plan | None = None,
    supervisor: Supervisor | None = None,
    *,
    seed: int = 1,
    start: RunState | None = None,
    evaluator: Fake | None = None,
) -> list[Step]:
    """All steps of a run."""
    return list(
        evolve(
            run_plan or plan(),
            seed,
            supervisor or Constant(),
            evaluator or Fake(),
            start=start,
        )
    )


def records(steps: list[Step]) -> list[GenerationRecord]:
    """What the run leaves behind."""
    return [step.record for step in steps]


def lines(steps: list[Step]) -> Iterator[str]:
    """The records as they are on disk."""
    return (dump(record_values(record)) for record in records(steps))
