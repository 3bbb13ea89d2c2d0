"""The data of a comparison: runs, arms and pairs of arms."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from islandgp.gp.archive import ArchiveRecord
from islandgp.gp.record import (
    Champion,
    Cost,
    GenerationRecord,
    GuidanceRecord,
    IndividualRecord,
    updated_champion,
)
from islandgp.scoring.classes import Classes
from islandgp.scoring.constraints import Constraints, recorded_constraints
from islandgp.scoring.generation_stats import GenerationStats


@dataclass(frozen=True, slots=True)
class Run:
    """One finished run, read from its folder.

    Generations count as in the records, from 0: the initial population is generation 0.
    """

    path: Path
    config: Mapping[str, Any]  # nested, resolved
    flat: Mapping[str, Any]  # the same by dotted key
    records: tuple[GenerationRecord, ...]  # by generation
    costs: tuple[Cost, ...]  # by generation
    champion: Champion  # the run's best robot
    validation: tuple[int, ...] = ()  # seeds of the validation worlds; (): none
    validation_mean: float | None = None  # mean points of the best robot there, if validated
    feasible: float | None = None  # share of these worlds in which it keeps the constraints

    @property
    def seed(self) -> int:
        """The run's seed."""
        return int(self.config["seed"])

    @property
    def supervisor(self) -> str:
        """The supervisor's name."""
        return str(self.config["supervisor"]["name"])

    @property
    def name(self) -> str:
        """The sweep's name."""
        return str(self.config["name"])

    @property
    def classes(self) -> Classes:
        """The behaviours, classes and tiers of its individuals."""
        return Classes(**self.config["classes"])

    @property
    def snapshots(self) -> tuple[GenerationStats, ...]:
        """The statistics of each generation."""
        return tuple(r.snapshot for r in self.records)

    @property
    def guidance(self) -> tuple[GuidanceRecord, ...]:
        """The supervisor's decisions, by generation."""
        return tuple(r.guidance for r in self.records if r.guidance is not None)

    @property
    def best(self) -> tuple[IndividualRecord, ...]:
        """The best individual of each generation; those that keep the constraints come first."""
        limits = self.constraints
        return tuple(updated_champion(None, 0, r.individuals, limits).record for r in self.records)

    @property
    def archives(self) -> tuple[ArchiveRecord, ...]:
        """The archive of elites after each generation."""
        return tuple(r.archive for r in self.records)

    @property
    def constraints(self) -> Constraints:
        """The constraints of the run, by counter; {} for none."""
        return recorded_constraints(self.config)


@dataclass(frozen=True, slots=True)
class Arm:
    """Runs that differ only in their seed."""

    name: str
    selection: str  # text of the --arm option, or the overrides of a sweep's arm
    runs: tuple[Run, ...]  # by seed
    keys: frozenset[str] = frozenset()  # of the configuration, in which it may differ from others

    @property
    def seeds(self) -> tuple[int, ...]:
        """The seeds of the runs, in order."""
        return tuple(r.seed for r in self.runs)

    @property
    def generations(self) -> int:
        """Number of generations of the shortest run."""
        return min(len(r.records) for r in self.runs)


@dataclass(frozen=True, slots=True)
class Comparison:
    """Arms to compare, with warnings about confounded settings."""

    arms: tuple[Arm, ...]
    comparability_warnings: tuple[str, ...]  # differences that make the comparison doubtful
    notes: tuple[str, ...]  # further notes for the reader
    sources: tuple[str, ...]  # folders or stores of the runs

    @property
    def names(self) -> tuple[str, ...]:
        """The names of the arms."""
        return tuple(arm.name for arm in self.arms)

    @property
    def classes(self) -> Classes:
        """The classes; behaviours and tiers have the same names in all arms."""
        return self.arms[0].runs[0].classes

    @property
    def milestones(self) -> tuple[str, ...]:
        """Tiers whose first robots are compared, the easiest first."""
        return self.classes.milestones

    @property
    def pairs(self) -> tuple[tuple[Arm, Arm], ...]:
        """All pairs, in the order in which the arms were given."""
        return tuple((a, b) for i, a in enumerate(self.arms) for b in self.arms[i + 1 :])

    @property
    def generations(self) -> int:
        """Number of generations that all arms have."""
        return min(a.generations for a in self.arms)


def cut(run: Run, generations: int) -> Run:
    """The run cut after a number of generations.

    Its champion is then the fittest individual of the last stage, without validation.
    """
    if len(run.records) <= generations:
        return run
    *before, last = run.records[:generations]
    records = (*before, replace(last, guidance=None))  # there is no guidance after the last one
    champion = None
    for generation, record in enumerate(records):
        if record.snapshot.stage == last.snapshot.stage:
            champion = updated_champion(champion, generation, record.individuals, run.constraints)
    assert champion is not None
    return replace(
        run,
        records=records,
        costs=run.costs[:generations],
        champion=champion,
        validation=(),
        validation_mean=None,
        feasible=None,
    )
