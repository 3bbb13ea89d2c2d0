"""Where the best individuals come from, on a family laid out by hand."""

from __future__ import annotations

from dataclasses import replace

from islandgp.gp.edits import Edit, EditTrial, as_record
from islandgp.study.arms import Run
from islandgp.study.comparable import compare_arms
from islandgp.study.library import library_names
from islandgp.study.lineage import (
    BRED,
    EDITED,
    HEIR,
    RANDOM,
    Descent,
    descent_of_first,
    final_elite,
    injected_shares,
    most_injected,
    provenance,
)
from islandgp.study.tables.origins import champion_sources_table, edits_table, sources_table
from tests.study.fake_runs import TREE, config, fake_arm, fake_run, guidance, individual

OTHER = "PatrolWaypoint\n"
(POOR,) = [text for text, name in library_names(config()).items() if name == "poor"]

# 1.1 is injected and kept as an elite; 2.1 is its child; 2.2 is a copy of a random tree.
POPULATIONS = [
    [individual("0.0", "random"), individual("0.1", "random", tree=OTHER)],
    [individual("1.0", "crossover", ["0.0", "0.1"]), individual("1.1", "injected", tree=POOR)],
    [
        individual("2.0", "elite", ["1.1"], tree=POOR, fitness=9.0),
        individual("2.1", "crossover", ["1.0", "1.1"], tiers=("complete",)),
    ],
    [
        individual("3.0", "resurrected", ["2.0"], tree=POOR, fitness=5000.0),
        individual("3.1", "copy", ["0.1"], tree=OTHER),
        individual("3.2", "elite", ["1.0"]),
        individual("3.3", "elite", ["1.0"], mutation="swap"),
        individual("3.4", "elite", ["1.1"], mutation="swap", tree=OTHER),
        individual("3.5", "injected", mutation="swap"),
        individual("3.6", "injected"),
    ],
]


def _run(source: str = "expert") -> Run:
    guided = guidance(tree=POOR, injected=True, source=source)
    return fake_run(best=[1.0, 1, 1, 2], populations=POPULATIONS, guided=guided, complete=2)


def test_copies_are_followed_back_to_where_the_tree_arose() -> None:
    """Drawn, bred, or given as it is, by the name of the library's file."""
    run = _run()
    assert provenance(run, run.records[3].individuals) == [
        "injected, unchanged: poor",
        RANDOM,
        BRED,
        BRED,
        HEIR,
        HEIR,
        "injected, unchanged: poor",
    ]


def test_a_tree_from_outside_the_library_has_its_writer_s_name() -> None:
    """A language model's tree is called by its supervisor."""
    guided = guidance(tree=OTHER, injected=True, source="llm")
    run = fake_run(best=[1.0] * 4, populations=POPULATIONS, guided=guided)
    assert provenance(run, run.records[3].individuals[-1:]) == ["injected, unchanged: llm"]
    assert most_injected([fake_arm("llm", [run])]) is None


def test_injected_trees_of_generation_0_count() -> None:
    """Where the first robot is one of them, the base rate is not 0."""
    populations = [
        [individual("0.0", "injected", tree=POOR), individual("0.1", "injected", tree=OTHER)],
        [individual("1.0", "elite", ["0.1"], tree=OTHER), individual("1.1", "random")],
        [individual("2.0", "crossover", ["1.0", "1.1"]), individual("2.1", "copy", ["1.1"])],
    ]
    run = fake_run(best=[1.0] * 3, populations=populations, guided=guidance(tree=TREE))
    assert injected_shares(run) == [1, 1 / 2, 1 / 2]
    sources = [provenance(run, record.individuals) for record in run.records]
    assert sources[0] == ["injected, unchanged: poor", "injected, unchanged: no supervisor"]
    assert sources[1] == ["injected, unchanged: no supervisor", RANDOM]
    assert sources[2] == [HEIR, RANDOM]


def test_base_rate_by_hand() -> None:
    """None, 1 of 2, both, 4 of 7 individuals descend from an injected tree or are one."""
    assert injected_shares(_run()) == [0, 1 / 2, 1, 4 / 7]


def test_the_tables_show_how_common_descent_is() -> None:
    """The champion's source is beside its generation's share of descendants."""
    plain = [[individual(f"{g}.0", "random", tree=TREE)] for g in range(4)]
    rival = fake_run("baseline", best=[1.0] * 4, populations=plain)
    study = compare_arms([fake_arm("expert", [_run()]), fake_arm("baseline", [rival])])
    assert [i.id for i in final_elite(study.arms[0].runs[0])] == ["3.0"]
    rows = {row[0]: row[1:] for row in champion_sources_table(study).rows}
    assert rows["injected, unchanged: poor"] == ("1", "100%", "0", "0%")
    assert rows[RANDOM] == ("0", "0%", "1", "100%")
    assert rows[HEIR] == ("0", "0%", "0", "0%")
    base = rows["for comparison: population with an injected ancestor"]
    assert base == ("57%", "57%", "0%", "0%")
    first = {row[0]: row[1:] for row in sources_table(study).rows}
    complete, *others = first["for comparison: that generation with an injected ancestor"]
    assert (complete, set(others)) == ("100%", {"\N{EN DASH}"})


def test_edited_trees_in_the_tables() -> None:
    """Their fates have a table; the first robot and the champion may be one, which is noted."""
    edit = as_record(Edit("combine", of="0.0", donor="0.1"), "")
    refused = as_record(Edit("combine", of="9.0", donor="0.1"), "no such individual")
    populations = [
        [individual("0.0", "random")],
        [individual("1.0", "edited", ["0.0"], mutation="edit:combine", tiers=("complete",))],
        [individual("2.0", "elite", ["1.0"], fitness=5.0)],
        [individual("3.0", "elite", ["2.0"], fitness=4.0)],
    ]
    guided = guidance(edits=(edit, refused))
    run = fake_run("editor", best=[1.0] * 4, populations=populations, guided=guided)
    trial = EditTrial("1.0", "0.0", 1000.0, 400.0)
    records = list(run.records)
    records[1] = replace(records[1], trials=(trial,))
    edited = replace(run, records=tuple(records))
    assert descent_of_first(edited, "complete") is Descent.EDITED
    assert provenance(edited, edited.records[2].individuals) == [EDITED]
    study = compare_arms([fake_arm("editor", [edited]), fake_arm("expert", [_run()])])
    table = edits_table(study)
    assert table is not None
    (row,) = table.rows
    assert dict(zip(table.columns, row, strict=True)) == {
        "Arm": "editor",
        "advised": "6",
        "refused": "50%",
        "better than the tree before": "100%",
        "worse": "0%",
        "median gain": "600",
        "became a parent": "100%",
        "mean generations lived": "2.0",
    }
    rival = fake_run("baseline", best=[1.0] * 4, populations=POPULATIONS)
    without = compare_arms([study.arms[1], fake_arm("baseline", [rival])])
    assert edits_table(without) is None
