"""What supervisors decided, counted: section 3.7 and Fig. 8 are made of it."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from itertools import groupby

from islandgp.gp.record import GuidanceRecord


@dataclass(frozen=True, slots=True)
class Decisions:
    """How often each decision was taken."""

    total: int
    sources: Counter[str]  # whose decisions they are
    phases: Counter[str]  # rows of Table 8; decisions without a phase are left out
    patterns: Counter[str]  # rows of Table 6, likewise
    targets: Counter[str]  # rows of Table 7, of the trees that were injected
    crises: Counter[str]  # generations with the emergency rate, Eq. (7), by reason
    episodes: Counter[str]  # crises that began, by reason: one that lasts counts once
    interventions: int  # decisions that saw a need to step in


def decisions(runs: Iterable[Sequence[GuidanceRecord]]) -> Decisions:
    """Over all runs, each of them by generation."""
    runs = tuple(runs)
    given = [g for run in runs for g in run]
    return Decisions(
        total=len(given),
        sources=Counter(g.source for g in given),
        phases=Counter(g.phase for g in given if g.phase),
        patterns=Counter(g.pattern for g in given if g.pattern),
        targets=Counter(g.target for g in given if g.target and g.injected),
        crises=Counter(g.crisis for g in given if g.crisis),
        episodes=Counter(why for run in runs for why, _ in groupby(g.crisis for g in run) if why),
        interventions=sum(g.intervention for g in given),
    )
