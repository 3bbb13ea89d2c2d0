"""Behavioural diversity, Eq. (3), and the working ratio, Eq. (4)."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence

from islandgp.scoring.classify import Specialist, is_working
from islandgp.scoring.outcome import Outcome


def diversity(classes: Sequence[Specialist]) -> float:
    """Eq. (3): D = 1 - max_c n_c / N, in [0, 3/4]; 0 when all are of one class."""
    return 1 - max(Counter(classes).values()) / len(classes)


def working_ratio(outcomes: Sequence[Outcome]) -> float:
    """Eq. (4): the share of individuals with a pickup or a humanoid interaction, in [0, 1]."""
    return sum(map(is_working, outcomes)) / len(outcomes)
