"""A run's curves over generations: read from its records, and thinned for a picture."""

from __future__ import annotations

from array import array
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import pairwise
from statistics import fmean
from typing import Any, Final

from islandgp.domain import RewardTable
from islandgp.records.folder import RunFolder
from islandgp.scoring.classes import Classes
from islandgp.scoring.constraints import Constraints, Merit, merit, recorded_constraints, violation
from islandgp.text import title

POINTS: Final = 300  # most points of a curve in a picture
TIERS: Final = 8  # most curves of tiers; the best tiers have one


def _last(values: Sequence[float]) -> float:
    return values[-1]


CURVES: Final[Mapping[str, Callable[[Sequence[float]], float]]] = {
    "episodes": _last,  # since the start
    "fitness_max": max,  # points
    "best_of_stage": _last,  # highest fitness so far in the stage, points
    "fitness_mean": fmean,  # points
    "coverage": _last,  # of the archive; 0 without one
    "qd_score": _last,
}
"""The curves besides those of tiers, and the value of a thinned one for some generations."""


@dataclass(slots=True)
class RunCurves:
    """Curves over generations, and the best individual of the last stage so far."""

    generations: int = 0
    values: dict[str, array[float]] = field(
        default_factory=lambda: {name: array("d") for name in CURVES}
    )
    tiers: dict[str, array[float]] = field(default_factory=dict)  # share of individuals, best first
    stages: list[tuple[int, int]] = field(default_factory=list)  # first generation, and stage
    fittest: Mapping[str, Any] | None = None  # record of the best individual of the last stage
    seconds: float = 0.0  # spent in its generations
    constraints: Constraints = field(default_factory=dict)
    earned: set[str] = field(default_factory=set)  # components with which any individual won points
    counted: set[str] = field(default_factory=set)  # counters that were above 0 in any individual
    reached: set[str] = field(default_factory=set)  # tiers that any individual reached

    @classmethod
    def of(cls, folder: RunFolder) -> RunCurves:
        """Curves of a run, without any generation yet. Raises RunError."""
        return cls(constraints=recorded_constraints(folder.configuration()))

    @property
    def episodes(self) -> int:
        """Episodes so far."""
        return round(self.values["episodes"][-1]) if self.generations else 0

    def add(self, record: Mapping[str, Any], cost: Mapping[str, Any]) -> None:
        """Add a generation."""
        snapshot, everyone, archive = record["snapshot"], record["individuals"], record["archive"]
        if not self.stages or self.stages[-1][1] != snapshot["stage"]:
            self.stages.append((self.generations, snapshot["stage"]))
            self.fittest = None
        best = max(everyone, key=self._merit)
        if self.fittest is None or self._merit(best) > self._merit(self.fittest):
            self.fittest = best
        figures = {
            "episodes": self.episodes + cost["episodes"],
            "fitness_max": best["fitness"],
            "best_of_stage": self.fittest["fitness"],
            "fitness_mean": snapshot["fitness_mean"],
            "coverage": archive["coverage"],
            "qd_score": archive["qd_score"],
        }
        for name, value in figures.items():
            self.values[name].append(value)
        self.reached.update(name for name, n in snapshot["tiers"].items() if n)
        for i in everyone:
            self.earned.update(name for name, points in i["components"].items() if points > 0)
            self.counted.update(name for name, value in i["counters"].items() if value > 0)
        for name in [*snapshot["tiers"]][:TIERS]:
            if len(self.tiers) < TIERS:
                self.tiers.setdefault(name, array("d", bytes(8 * self.generations)))
        for name, shares in self.tiers.items():
            shares.append(snapshot["tiers"].get(name, 0) / max(1, len(everyone)))
        self.generations += 1
        self.seconds += cost["evaluation"] + cost["supervision"] + cost["operators"]

    def _merit(self, individual: Mapping[str, Any]) -> Merit:
        v = violation(individual["counters"], self.constraints) if self.constraints else 0.0
        return merit(individual["fitness"], v)


MAX_NAMES: Final = 6  # most names in a sentence


def nothing_works(curves: RunCurves, classes: Classes, rewards: object) -> str:
    """A sentence on what no individual has achieved, with remedies; "" if something works.

    Something works if an individual has shown a behaviour and one has reached a tier. Points are
    no criterion, as some domains have penalties only.

    Args:
        curves: of at least one generation.
        classes: of the run.
        rewards: of its domain; if it is a RewardTable, events that never paid are named, except
            those of a component with penalties, which may hide their points.
    """
    table = rewards.events if isinstance(rewards, RewardTable) else {}
    known = curves.earned | {row.component for row in table.values() if row.costs}
    unpaid = [event for event, row in table.items() if row.component not in known]
    missing = [name for name, key in classes.behaviours.items() if key not in curves.counted]
    if curves.reached and len(missing) < len(classes.behaviours):
        return ""
    failures = []
    if not curves.reached:
        failures.append(f"reached a tier ({_listed(map(title, classes.tiers))})")
    if missing:
        failures.append(f"shown a behaviour ({_listed(missing)})")
    if unpaid:
        failures.append(f"earned points for {_listed(unpaid)}")
    return (
        f"No individual has ever {' or '.join(failures)} in {curves.episodes:,} episodes:"
        " start from a tree (`start=`), add a library, reward a step before it, or raise"
        " `gp.episodes`."
    )


def _listed(names: Iterable[str]) -> str:
    first = [*names]
    more = [f"{len(first) - MAX_NAMES} more"] if len(first) > MAX_NAMES else []
    return ", ".join([*first[:MAX_NAMES], *more])


def read_history(folder: RunFolder) -> RunCurves:
    """Read the generations in a run's folder. Raises RunError."""
    curves = RunCurves.of(folder)
    for record, cost in zip(folder.records(), folder.costs(), strict=False):
        curves.add(record, cost)
    return curves


def thinned(history: RunCurves, points: int = POINTS) -> dict[str, Any]:
    """The curves with at most `points` points, each of about as many generations."""
    n, k = history.generations, min(history.generations, points)
    places = [*pairwise(i * n // k for i in range(k + 1))] if k else []

    def joined(values: Sequence[float], join: Callable[[Sequence[float]], float]) -> list[float]:
        return [join(values[first:end]) for first, end in places]

    begins = [[history.values["episodes"][first], stage + 1] for first, stage in history.stages]
    return {
        "generation": [end - 1 for _, end in places],
        **{name: joined(history.values[name], join) for name, join in CURVES.items()},
        "tiers": {name: joined(shares, fmean) for name, shares in history.tiers.items()},
        "stages": begins,
    }
