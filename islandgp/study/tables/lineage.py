"""What became of newcomers, and where the first Complete Robots came from."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from statistics import fmean
from typing import Final

from islandgp.evolution.population import Origin
from islandgp.scoring.classify import Tier
from islandgp.study.arms import Arm, Comparison
from islandgp.study.emergence import first
from islandgp.study.lineage import (
    Newcomer,
    Source,
    alive,
    elite_share,
    injected_shares,
    median_life,
    newcomers,
    source_of_first,
)
from islandgp.study.notation import NONE, number
from islandgp.study.table import Table

LATER: Final = 5  # generations after which the lineage table asks who is alive


def lineage_table(study: Comparison) -> Table:
    """What became of injected trees, beside the random ones of the diversity slots."""
    rows = []
    for arm in study.arms:
        found = [n for run in arm.runs for n in newcomers(run)]
        for origin in (Origin.INJECTED, Origin.RANDOM):
            mine = [n for n in found if n.origin == origin]
            if not mine:
                continue
            rows.append(
                (
                    f"{arm.name}: {origin.value}",
                    number(len(mine)),
                    number(fmean(n.fitness for n in mine)),
                    _median_life(mine, study.generations),
                    f"{alive(mine, LATER + 1)[LATER]:.0%}",
                    number(fmean(n.descendants for n in mine), 1),
                    f"{fmean(elite_share(run, origin) for run in arm.runs):.0%}",
                )
            )
    return Table(
        "lineage",
        "What became of newcomers",
        (
            "Arm and origin",
            "newcomers",
            "mean fitness on arrival",
            "median generations lived",
            f"alive after {LATER} generations",
            "mean descendants",
            "share of the final elite",
        ),
        tuple(rows),
        (
            "A newcomer is a supervisor's tree, or a random tree of a diversity slot. It is alive"
            " as long as an individual descends from it by any chain of parents; of its own tree"
            " there may be little left. Life and survival are Kaplan-Meier estimates: a line that"
            " lives at the end of its run is censored. The final elite is the best tenth of the"
            " last generation; an individual can descend from newcomers of both kinds.",
        ),
    )


def _median_life(found: Sequence[Newcomer], generations: int) -> str:
    life = median_life(found, generations)
    return "not reached" if life is None else str(life)


def sources_table(study: Comparison) -> Table:
    """Whether the first Complete and Excellent Robots were given or evolved."""
    tiers = (Tier.COMPLETE, Tier.EXCELLENT)
    counts = [
        Counter(source_of_first(run, tier) for run in arm.runs)
        for arm in study.arms
        for tier in tiers
    ]
    return Table(
        "sources",
        "Where the first Complete and the first Excellent Robot came from (runs)",
        ("Source", *(f"{arm.name}: {tier.value}" for arm in study.arms for tier in tiers)),
        (
            *((source.value, *(str(c[source]) for c in counts)) for source in Source),
            (
                "for comparison: that generation with an injected ancestor",
                *(_base_rate(arm, tier) for arm in study.arms for tier in tiers),
            ),
        ),
        (
            "An injected tree that is a Complete Robot as it was given shows what the supervisor"
            " knows, not what evolution found; a descendant may hold any part of it, all of it"
            " included. The last row is the base rate: the share of the individuals of the first"
            " one's generation that descend from an injected tree or are one, mean over the runs"
            " that had one. Where nearly everybody descends from one, that the first one does says"
            " little.",
        ),
    )


def _base_rate(arm: Arm, tier: Tier) -> str:
    came = [(run, g) for run in arm.runs if (g := first(run, tier)) is not None]
    return f"{fmean(injected_shares(run)[g] for run, g in came):.0%}" if came else NONE
