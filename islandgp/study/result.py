"""The result of a comparison in sentences, at the top of its report."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from islandgp.study.arms import Comparison
from islandgp.study.findings import Finding, finding
from islandgp.study.measures import MEAN_MAX, emergence
from islandgp.study.plan import AnalysisPlan
from islandgp.study.tables.claims import estimate_cells, found, test_name


def result(study: Comparison, plan: AnalysisPlan, findings: Sequence[Finding]) -> Iterator[str]:
    """A sentence for each pair of arms and measure.

    The measure is the plan's primary endpoint; without one these are the mean over generations of
    the highest fitness, and the first robot of the easiest milestone.
    """
    without_plan = [MEAN_MAX.key, *(emergence(tier).key for tier in study.milestones[:1])]
    for key in without_plan if plan.primary is None else [plan.primary]:
        for a, b in study.pairs:
            f = finding(findings, key, (a.name, b.name))
            p = f.test.p if plan.primary == key and (a, b) == study.pairs[0] else None
            yield _sentence(f, found(f, plan.margins.get(key), p))


def _sentence(f: Finding, verdict: str) -> str:
    cells = dict(estimate_cells(f))
    a, b = f.arms
    if f.never or f.equal:
        return f"{f.measure.label}, {a} minus {b}: {verdict}."
    difference = f"{cells['difference [95 %]']} {cells['unit']}"
    return f"{f.measure.label}, {a} minus {b}: {difference} ({test_name(f)}); {verdict}."
