"""Table 12 for two arms, with the tests that the paper does not make."""

from __future__ import annotations

from collections.abc import Sequence

from islandgp.study import paper
from islandgp.study.findings import Finding
from islandgp.study.measures import TABLE_12
from islandgp.study.notation import NONE, number, percent
from islandgp.study.paper import MARK
from islandgp.study.table import Table
from islandgp.study.tables.cells import SIGNS, TESTS, arm_cells, test_cells


def diversity_table(key: str, title: str, findings: Sequence[Finding], *, family: int) -> Table:
    """Table 12 for one pair of arms, with the tests that the paper does not make."""
    a, b = findings[0].arms
    known = {m.key for m in TABLE_12}
    rows = []
    for f in findings:
        if f.measure.key not in known:
            rows.append((f.measure.label, *arm_cells(f), *test_cells(f), *[NONE] * 3))
            continue
        ours, base, share = paper.TABLE_12[f.measure.key]
        rows.append(
            (
                f.measure.label,
                *arm_cells(f),
                *test_cells(f),
                number(ours, 3),
                number(base, 3),
                percent(share),
            )
        )
    return Table(
        key,
        title,
        (
            "Measure",
            a,
            b,
            *TESTS,
            f"{MARK} proposed",
            f"{MARK} baseline",
            f"{MARK} difference",
        ),
        tuple(rows),
        (SIGNS.format(n=family), "The paper tests none of these.", paper.NOTE),
    )
