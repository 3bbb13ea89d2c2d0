"""Where champions come from, beside how common an injected ancestor is around them."""

from __future__ import annotations

from collections import Counter
from statistics import fmean
from typing import Final

from islandgp.study.ancestry import BRED, HEIR, RANDOM, provenance
from islandgp.study.arms import Arm, Comparison
from islandgp.study.lineage import final_elite, injected_shares
from islandgp.study.table import Table

EVOLVED: Final = (RANDOM, BRED, HEIR)
"""The rows that are always there."""


def champion_sources_table(study: Comparison) -> Table:
    """The source of each run's best individual and of its final elite."""
    best = [_best(arm) for arm in study.arms]
    elites = [_elites(arm) for arm in study.arms]
    found = sorted({source for counts in (*best, *elites) for source in counts})
    sources = [*EVOLVED, *(s for s in found if s not in EVOLVED)]
    rows: list[tuple[str, ...]] = []
    for source in sources:
        cells = []
        for b, e in zip(best, elites, strict=True):
            cells += [str(b[source]), f"{e[source] / e.total():.0%}"]
        rows.append((source, *cells))
    rates = [cell for arm in study.arms for cell in _base_rates(arm)]
    rows.append(("for comparison: population with an injected ancestor", *rates))
    columns = [f"{a.name}: {what}" for a in study.arms for what in ("best (runs)", "final elite")]
    return Table(
        "champion-sources",
        "Where champions come from",
        ("Source", *columns),
        tuple(rows),
        (
            "Best: the run's individual with the highest fitness ever; final elite: the best tenth"
            " of the last generation, all runs together. An unchanged copy is what it was copied"
            " from. A tree that is injected as it is has the name of the file in grammar/examples"
            " that it is, else of the supervisor that wrote it. The last row is the base rate:"
            " the share of the best one's generation, and of the last one, that descends from an"
            " injected tree or is one, mean over runs.",
        ),
    )


def _best(arm: Arm) -> Counter[str]:
    return Counter(s for run in arm.runs for s in provenance(run, [run.champion.record]))


def _elites(arm: Arm) -> Counter[str]:
    return Counter(s for run in arm.runs for s in provenance(run, final_elite(run)))


def _base_rates(arm: Arm) -> tuple[str, str]:
    shares = [(run.champion.generation, injected_shares(run)) for run in arm.runs]
    return f"{fmean(s[g] for g, s in shares):.0%}", f"{fmean(s[-1] for _, s in shares):.0%}"
