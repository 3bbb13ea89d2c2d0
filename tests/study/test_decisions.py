"""The table of decisions."""

from __future__ import annotations

from dataclasses import replace

from islandgp.study.comparable import compare_arms
from islandgp.study.tables.supervision import decisions_table
from tests.study.made_runs import guidance, made_arm, made_run


def test_shares_are_of_all_decisions() -> None:
    """One label in three decisions is 33.3 %, although it is the only label there is."""
    run = made_run(generations=4)
    first = replace(run.records[0], guidance=guidance(pattern="stagnation", phase="refinement"))
    labelled = replace(run, records=(first, *run.records[1:]))
    arms = [made_arm("expert", [labelled]), made_arm("baseline", [made_run("baseline")])]
    table = decisions_table(compare_arms(arms, force=True))
    rows = {row[0]: row[1:3] for row in table.rows}
    assert rows["Decisions"] == ("3", "3")
    assert rows["Pattern: stagnation"] == ("33.3 %", "\N{EN DASH}")
    assert rows["Phase: refinement"] == ("33.3 %", "\N{EN DASH}")
