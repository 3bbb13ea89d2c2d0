"""A run's curves over generations: read from its records, and thinned for a picture."""

from __future__ import annotations

from array import array
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Final

from islandgp.domain import RewardTable
from islandgp.records.folder import RunFolder
from islandgp.scoring.classes import Classes
from islandgp.scoring.constraints import Constraints, Merit, merit, recorded_constraints, violation
from islandgp.text import title

POINTS: Final = 300  # most points of a curve in a picture
TIERS: Final = 8  # most curves of tiers; the best tiers have one


def _floats() -> array[float]:
    return array("d")


@dataclass(slots=True)
class RunCurves:
    """Curves over generations, and the best individual of the last stage so far."""

    generations: int = 0
    individuals: int = 0  # of the last generation
    episodes: array[float] = field(default_factory=_floats)  # since the start
    fitness_max: array[float] = field(default_factory=_floats)  # points
    top: array[float] = field(default_factory=_floats)  # highest so far in the stage, points
    fitness_mean: array[float] = field(default_factory=_floats)  # points
    coverage: array[float] = field(default_factory=_floats)  # of the archive; 0 without one
    qd_score: array[float] = field(default_factory=_floats)
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

    def add(self, record: Mapping[str, Any], cost: Mapping[str, Any]) -> None:
        """Add a generation."""
        snapshot, everyone = record["snapshot"], record["individuals"]
        if not self.stages or self.stages[-1][1] != snapshot["stage"]:
            self.stages.append((self.generations, snapshot["stage"]))
            self.fittest = None
        best = max(everyone, key=self._merit)
        if self.fittest is None or self._merit(best) > self._merit(self.fittest):
            self.fittest = best
        archive = record["archive"]
        before = self.episodes[-1] if self.episodes else 0.0
        self.episodes.append(before + cost["episodes"])
        self.fitness_max.append(best["fitness"])
        self.top.append(self.fittest["fitness"])
        self.fitness_mean.append(snapshot["fitness_mean"])
        self.reached.update(name for name, n in snapshot["tiers"].items() if n)
        for i in everyone:
            self.earned.update(name for name, points in i["components"].items() if points > 0)
            self.counted.update(name for name, value in i["counters"].items() if value > 0)
        self.coverage.append(archive["coverage"])
        self.qd_score.append(archive["qd_score"])
        for name in [*snapshot["tiers"]][:TIERS]:
            if len(self.tiers) < TIERS:
                self.tiers.setdefault(name, array("d", bytes(8 * self.generations)))
        for name, shares in self.tiers.items():
            shares.append(snapshot["tiers"].get(name, 0) / max(1, len(everyone)))
        self.generations += 1
        self.individuals = len(everyone)
        self.seconds += sum(cost[key] for key in ("evaluation", "supervision", "operators"))

    def _merit(self, i: Mapping[str, Any]) -> Merit:
        excess = violation(i["counters"], self.constraints) if self.constraints else 0.0
        return merit(i["fitness"], excess)


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
        f"No individual has ever {' or '.join(failures)} in {curves.episodes[-1]:,.0f} episodes:"
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
    """The curves with at most `points` points; `fitness_max` keeps the maximum of neighbours."""
    places = list(_parts(history.generations, points))

    def last(values: Sequence[float]) -> list[float]:
        return [values[end - 1] for _, end in places]

    def over(values: Sequence[float], join: Callable[[Sequence[float]], float]) -> list[float]:
        return [join(values[first:end]) for first, end in places]

    def average(values: Sequence[float]) -> float:
        return sum(values) / len(values)

    return {
        "generation": [end - 1 for _, end in places],
        "episodes": last(history.episodes),
        "fitness_max": over(history.fitness_max, max),
        "top": last(history.top),
        "fitness_mean": over(history.fitness_mean, average),
        "coverage": last(history.coverage),
        "qd_score": last(history.qd_score),
        "tiers": {name: over(shares, average) for name, shares in history.tiers.items()},
        "stages": [[history.episodes[first], stage + 1] for first, stage in history.stages],
    }


def _parts(n: int, most: int) -> Iterator[tuple[int, int]]:
    """The range of n divided into at most `most` parts of about equal size."""
    k = min(n, most)
    for i in range(k):
        yield i * n // k, (i + 1) * n // k
