"""What supervisors decided: patterns, phases and crises over a run (section 3.7, Fig. 8)."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass

from islandgp.evolution.record import GuidanceRecord
from islandgp.study.arms import Arm, Run


@dataclass(frozen=True, slots=True)
class Decisions:
    """An arm's decisions in numbers."""

    total: int
    patterns: Counter[str]  # rows of Table 6; decisions without a pattern are left out
    phases: Counter[str]  # rows of Table 8
    targets: Counter[str]  # rows of Table 7
    crises: Counter[str]  # Eq. (7), by reason
    episodes: Counter[str]  # crises that began, by reason: one that lasts counts once
    interventions: int


def decisions(arm: Arm) -> Decisions:
    """Over all runs of an arm."""
    given = [g for run in arm.runs for g in guidance(run)]
    return Decisions(
        total=len(given),
        patterns=Counter(g.pattern for g in given if g.pattern),
        phases=Counter(g.phase for g in given if g.phase),
        targets=Counter(g.target for g in given if g.target and g.injected),
        crises=Counter(g.crisis for g in given if g.crisis),
        episodes=Counter(reason for run in arm.runs for reason in _began(run)),
        interventions=sum(g.intervention for g in given),
    )


def guidance(run: Run) -> Iterator[GuidanceRecord]:
    """A run's decisions, by generation."""
    return (r.guidance for r in run.records if r.guidance is not None)


def _began(run: Run) -> Iterator[str]:
    before = ""
    for g in guidance(run):
        if g.crisis and g.crisis != before:
            yield g.crisis
        before = g.crisis


def pattern_shares(arm: Arm, generations: int) -> dict[str, list[float]]:
    """For each pattern, the share of the arm's runs with it after each generation."""
    counts: dict[str, list[float]] = {}
    for run in arm.runs:
        for generation, g in enumerate(guidance(run)):
            if g.pattern and generation < generations:
                row = counts.setdefault(g.pattern, [0.0] * generations)
                row[generation] += 1 / len(arm.runs)
    return counts
