"""Tables 9 and 10 for two arms, beside the paper's figures."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from islandgp.study import paper
from islandgp.study.findings import Finding
from islandgp.study.notation import effect, probability, spread
from islandgp.study.paper import MARK
from islandgp.study.table import Table
from islandgp.study.tables.cells import SIGNS, TESTS, arm_cells, test_cells


def fitness_table(
    key: str,
    title: str,
    findings: Sequence[Finding],
    theirs: Mapping[str, paper.Row],
    *,
    family: int,
) -> Table:
    """Table 9 or 10 for one pair of arms; `family` comparisons were adjusted together."""
    a, b = findings[0].arms
    return Table(
        key,
        title,
        (
            "Metric",
            a,
            b,
            *TESTS,
            f"{MARK} proposed",
            f"{MARK} baseline",
            f"{MARK} p",
            f"{MARK} p BH",
            f"{MARK} r",
        ),
        tuple(
            (f.measure.label, *arm_cells(f), *test_cells(f), *_paper_row(theirs[f.measure.key]))
            for f in findings
        ),
        (SIGNS.format(n=family), paper.NOTE),
    )


def _paper_row(row: paper.Row) -> tuple[str, ...]:
    return (
        spread(*row.proposed),
        spread(*row.baseline),
        probability(row.p),
        probability(row.p_bh),
        effect(row.r),
    )
