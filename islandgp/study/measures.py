"""What one run is measured by: the rows of Tables 9, 10 and 11, and diversity (Table 12)."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from statistics import fmean
from typing import Final

from islandgp.scoring.classify import Tier
from islandgp.scoring.snapshot import Snapshot
from islandgp.study.arms import Run
from islandgp.study.emergence import first


@dataclass(frozen=True, slots=True)
class Phase:
    """A part of training in Tables 10 and 12: epochs 1-2, 3-5 and 6-8.

    The paper prints generations 1-10, 11-25 and 26-41. Its own Tables 9 and 10
    fit together only when they are generations 0-10, 11-25 and 26-40 counted
    from the initial population (docs/study.md); so they are taken here.
    """

    key: str
    label: str
    after: int  # of 40: the last generation before it
    last: int  # of 40: its last generation

    def generations(self, of: int) -> range:
        """Its generations in a run of `of` generations, the shares being those of 41."""
        scale = (of - 1) / 40
        return range(_round(self.after * scale) + 1, _round(self.last * scale) + 1)

    def name(self, of: int) -> str:
        """Its name in a table of runs of `of` generations."""
        span = self.generations(of)
        return f"{self.label} (Gen {span.start}-{span.stop - 1})"


def _round(x: float) -> int:
    return int(x + 0.5) if x >= 0 else -1


PHASES: Final = (
    Phase("early", "Early", -1, 10),
    Phase("mid", "Mid", 10, 25),
    Phase("late", "Late", 25, 40),
)


@dataclass(frozen=True, slots=True)
class Measure:
    """A number a run."""

    key: str
    label: str
    unit: str
    of: Callable[[Run], float | None]  # None: it never happened (censored)
    emergence: bool = False  # a generation, which may be censored


def phase_mean(run: Run, phase: Phase, value: Callable[[Snapshot], float]) -> float:
    """The mean of a number over a phase's generations, nan when the run has none of them."""
    snapshots = run.snapshots
    inside = [value(snapshots[g]) for g in phase.generations(len(snapshots))]
    return fmean(inside) if inside else float("nan")


def best(snapshot: Snapshot) -> float:
    """Highest fitness of a generation."""
    return snapshot.best


def diversity(snapshot: Snapshot) -> float:
    """Eq. (3)."""
    return snapshot.diversity


def _stage(phase: Phase) -> Measure:
    return Measure(
        f"stage_{phase.key}",
        f"{phase.label} max fitness",
        "points",
        lambda run: phase_mean(run, phase, best),
    )


def _emergence(tier: Tier) -> Measure:
    return Measure(
        f"first_{tier.value}",
        f"First {tier.value.capitalize()} Robot",
        "generation",
        lambda run: first(run, tier),
        emergence=True,
    )


def _diversity(phase: Phase) -> Measure:
    return Measure(
        f"diversity_{phase.key}",
        f"{phase.label} diversity",
        "Eq. (3)",
        lambda run: phase_mean(run, phase, diversity),
    )


TABLE_9: Final = (
    Measure("max_ever", "Max Fitness Ever", "points", lambda r: max(map(best, r.snapshots))),
    Measure("final_max", "Final Max Fitness", "points", lambda r: r.snapshots[-1].best),
    Measure("mean_max", "Mean Max Fitness", "points", lambda r: fmean(map(best, r.snapshots))),
    Measure("final_mean", "Final Average Fitness", "points", lambda r: r.snapshots[-1].mean),
)
TABLE_10: Final = tuple(map(_stage, PHASES))
TABLE_11: Final = (_emergence(Tier.COMPLETE), _emergence(Tier.EXCELLENT))
FAMILY: Final = (*TABLE_9, *TABLE_10, *TABLE_11)
"""The nine comparisons of the paper: one family for Benjamini and Hochberg."""

TABLE_12: Final = (
    *map(_diversity, PHASES),
    Measure(
        "diversity_overall",
        "Overall diversity",
        "Eq. (3)",
        lambda r: fmean(map(diversity, r.snapshots)),
    ),
)
MUTATION: Final = Measure(
    "mutation_rate",
    "Mean mutation rate",
    "rate",
    lambda r: fmean(s.rate for s in r.snapshots),
)
FURTHER: Final = (*TABLE_12, MUTATION)
"""What the paper compares without a test: a family of its own here."""


def values(measure: Measure, runs: Sequence[Run]) -> tuple[float | None, ...]:
    """A measure of each run, in their order."""
    return tuple(map(measure.of, runs))
