"""The table of decisions."""

from __future__ import annotations

from dataclasses import replace

from islandgp.study.comparable import compare_arms
from islandgp.study.tables.supervision import decisions_table
from tests.study.fake_runs import fake_arm, fake_run, guidance


def test_shares_are_of_all_decisions() -> None:
    """One label in three decisions is 33.3 %, although it is the only label there is."""
    run = fake_run(generations=4)
    first = replace(run.records[0], guidance=guidance(pattern="stagnation", phase="refinement"))
    labelled = replace(run, records=(first, *run.records[1:]))
    arms = [fake_arm("expert", [labelled]), fake_arm("baseline", [fake_run("baseline")])]
    table = decisions_table(compare_arms(arms, force=True))
    rows = {row[0]: row[1:3] for row in table.rows}
    assert rows["Decisions"] == ("3", "3")
    assert rows["Pattern: stagnation"] == ("33.3 %", "\N{EN DASH}")
    assert rows["Phase: refinement"] == ("33.3 %", "\N{EN DASH}")
