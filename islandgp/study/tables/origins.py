"""Tables of descent: survival of newcomers, origins of the first robots and the best robots."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Sequence
from statistics import fmean, median
from typing import Final

from islandgp.gp.edit_fates import edit_fates
from islandgp.gp.population import Origin
from islandgp.gp.record import IndividualRecord
from islandgp.study import lineage
from islandgp.study.arms import Arm, Comparison, Run
from islandgp.study.emergence import first
from islandgp.study.table import NONE, Table, labelled, number
from islandgp.study.texts import note
from islandgp.text import title

SURVIVAL_AFTER: Final = 5  # generations after which survival is reported

EVOLVED: Final = (lineage.RANDOM, lineage.BRED, lineage.HEIR)
"""Rows that are in every table."""


def lineage_table(study: Comparison) -> Table:
    """Survival of the lineages of injected trees, and of random trees of diversity slots."""
    rows = []
    for arm in study.arms:
        trees = [n for run in arm.runs for n in lineage.newcomers(run)]
        for origin in (*lineage.ADVISED, Origin.RANDOM):
            if newcomers := [n for n in trees if n.origin == origin]:
                life = lineage.median_life(newcomers, study.generations)
                elite = fmean(lineage.elite_share(run, origin) for run in arm.runs)
                alive_later = lineage.alive(newcomers, SURVIVAL_AFTER + 1)[SURVIVAL_AFTER]
                row = {
                    "Arm and origin": f"{arm.name}: {origin.value}",
                    "newcomers": number(len(newcomers)),
                    "mean fitness on arrival": number(fmean(n.fitness for n in newcomers)),
                    "median generations lived": "not reached" if life is None else str(life),
                    f"alive after {SURVIVAL_AFTER} generations": f"{alive_later:.0%}",
                    "mean descendants": number(fmean(n.descendants for n in newcomers), 1),
                    "share of the final elite": f"{elite:.0%}",
                }
                rows.append(row.items())
    return Table.of("lineage", "Survival of newcomers", rows, note("lineage"))


def edits_table(study: Comparison) -> Table | None:
    """Results of the edits of each arm; None if there are none."""
    rows = []
    for arm in study.arms:
        fates = [fate for run in arm.runs for fate in edit_fates(run.records)]
        evaluated = [fate for fate in fates if fate.trial is not None]
        if evaluated:
            gains = [fate.gain or 0.0 for fate in evaluated]
            row = {
                "Arm": arm.name,
                "advised": number(len(fates)),
                "refused": f"{sum(bool(f.edit.refused) for f in fates) / len(fates):.0%}",
                "better than the tree before": f"{sum(g > 0 for g in gains) / len(gains):.0%}",
                "worse": f"{sum(g < 0 for g in gains) / len(gains):.0%}",
                "median gain": number(median(gains)),
                "became a parent": f"{sum(f.children > 0 for f in evaluated) / len(evaluated):.0%}",
                "mean generations lived": number(fmean(f.lived for f in evaluated), 1),
            }
            rows.append(row.items())
    return Table.of("edits", "Results of edits", rows, note("edits")) if rows else None


def sources_table(study: Comparison) -> Table:
    """Origins of the first robots of the milestones: injected or evolved."""
    tiers = study.milestones
    columns = [(arm, tier) for arm in study.arms for tier in tiers]
    headings = [f"{arm.name}: {title(tier)}" for arm, tier in columns]
    counts = [Counter(lineage.descent_of_first(run, t) for run in arm.runs) for arm, t in columns]
    rows = [
        labelled("Source", descent.value, headings, (str(c[descent]) for c in counts))
        for descent in lineage.Descent
    ]
    compared = "for comparison: that generation with an injected ancestor"
    rates = (_rate_at_first(arm, tier) for arm, tier in columns)
    return Table.of(
        "sources",
        f"Where the first {' and the first '.join(map(title, tiers))} {study.classes.agent}"
        " came from (runs)",
        [*rows, labelled("Source", compared, headings, rates)],
        note("sources", robot=study.classes.tier_title(tiers[0])),
    )


def _rate_at_first(arm: Arm, tier: str) -> str:
    came = [(run, g) for run in arm.runs if (g := first(run, tier)) is not None]
    return f"{fmean(lineage.injected_shares(run)[g] for run, g in came):.0%}" if came else NONE


def champion_sources_table(study: Comparison) -> Table:
    """The source of each run's best individual and of its final elite."""
    best = [_sources(arm, lambda run: [run.champion.record]) for arm in study.arms]
    elites = [_sources(arm, lineage.final_elite) for arm in study.arms]
    others = set[str]().union(*best, *elites) - {*EVOLVED}
    headings = [f"{arm}: {of}" for arm in study.names for of in ("best (runs)", "final elite")]
    rows = []
    for source in (*EVOLVED, *sorted(others)):
        cells = []
        for b, e in zip(best, elites, strict=True):
            cells += [str(b[source]), f"{e[source] / e.total():.0%}"]
        rows.append(labelled("Source", source, headings, cells))
    compared = "for comparison: population with an injected ancestor"
    rates = [cell for arm in study.arms for cell in _base_rates(arm)]
    rows.append(labelled("Source", compared, headings, rates))
    heading = "Origins of the best robots"
    return Table.of("champion-sources", heading, rows, note("champion-sources"))


def _sources(arm: Arm, individuals: Callable[[Run], Sequence[IndividualRecord]]) -> Counter[str]:
    """The sources of some individuals of each run."""
    return Counter(s for run in arm.runs for s in lineage.provenance(run, individuals(run)))


def _base_rates(arm: Arm) -> tuple[str, str]:
    shares = [(run.champion.generation, lineage.injected_shares(run)) for run in arm.runs]
    return f"{fmean(s[g] for g, s in shares):.0%}", f"{fmean(s[-1] for _, s in shares):.0%}"
