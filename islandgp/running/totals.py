"""The values of all generations of a run that its end and its page need.

They are collected while generations are written, so the records are not read again.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from islandgp.evolution.candidates import Candidates
from islandgp.records.folder import RunFolder
from islandgp.viewer.history import RunCurves


@dataclass(slots=True)
class RunTotals:
    """The generations of a run so far, without their individuals."""

    curves: RunCurves
    candidates: Candidates | None = None  # for the best robot; None: they are not needed
    worlds: set[int] = field(default_factory=set)  # seeds
    snapshots: list[Mapping[str, Any]] = field(default_factory=list)  # by generation
    costs: list[Mapping[str, Any]] = field(default_factory=list)  # by generation
    decisions: list[Mapping[str, Any]] = field(default_factory=list)  # source and asked_at
    first_best: str = ""  # canonical text of the fittest tree of generation 0

    def add(self, record: Mapping[str, Any], cost: Mapping[str, Any]) -> None:
        """Add a generation, given its record and its costs as plain values."""
        self.curves.add(record, cost)
        if not self.first_best:
            self.first_best = max(record["individuals"], key=lambda i: i["fitness"])["tree"]
        self.worlds.update(record["worlds"])
        self.snapshots.append(record["snapshot"])
        self.costs.append(cost)
        if (guidance := record["guidance"]) is not None:
            self.decisions.append({key: guidance[key] for key in ("source", "asked_at")})
        if self.candidates is not None:
            self.candidates.add(record)

    @property
    def stage(self) -> int:
        """The stage of the last generation, as an index into Table 2."""
        return self.curves.stages[-1][1]

    @property
    def episodes(self) -> int:
        """Episodes so far."""
        return round(self.curves.episodes[-1]) if self.curves.generations else 0


def totals_of(folder: RunFolder, candidates: Candidates | None = None) -> RunTotals:
    """The totals of the generations in a run's folder. Raises RunError."""
    totals = RunTotals(RunCurves.of(folder), candidates)
    for record, cost in zip(folder.records(), folder.costs(), strict=False):
        totals.add(record, cost)
    return totals
