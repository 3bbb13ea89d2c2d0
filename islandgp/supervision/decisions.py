"""Counts of supervisors' decisions, for section 3.7 and Fig. 8."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from itertools import groupby

from islandgp.gp.record import GuidanceRecord


@dataclass(frozen=True, slots=True)
class Decisions:
    """Number of decisions of each kind."""

    total: int
    sources: Counter[str]  # by supervisor, or "fallback"
    phases: Counter[str]  # by row of Table 8; decisions without a phase are left out
    patterns: Counter[str]  # by row of Table 6, likewise
    targets: Counter[str]  # by row of Table 7, of the injected trees
    crises: Counter[str]  # generations with the emergency rate, Eq. (7), by reason
    episodes: Counter[str]  # crises by reason; several generations in a row count once
    interventions: int  # decisions that considered an intervention necessary


def decisions(runs: Iterable[Sequence[GuidanceRecord]]) -> Decisions:
    """Counts the decisions of all runs; each run is a sequence by generation."""
    runs = tuple(runs)
    guidance = [g for run in runs for g in run]
    return Decisions(
        total=len(guidance),
        sources=Counter(g.source for g in guidance),
        phases=Counter(g.phase for g in guidance if g.phase),
        patterns=Counter(g.pattern for g in guidance if g.pattern),
        targets=Counter(g.target for g in guidance if g.target and g.injected),
        crises=Counter(g.crisis for g in guidance if g.crisis),
        episodes=Counter(
            reason for run in runs for reason, _ in groupby(g.crisis for g in run) if reason
        ),
        interventions=sum(g.intervention for g in guidance),
    )
