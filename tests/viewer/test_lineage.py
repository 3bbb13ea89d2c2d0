"""The chain of ancestors: its steps, and records that no run would write."""

from __future__ import annotations

from itertools import pairwise
from pathlib import Path
from typing import Any

import pytest
import yaml

from islandgp.gp.record import IndividualRecord
from islandgp.records.files import dump
from islandgp.records.folder import RunFolder
from islandgp.viewer import history as module
from islandgp.viewer.history import lineage, tree_changes
from tests.compare.fake_runs import config, fake_run, guidance, individual
from tests.viewer.runs import closed_run

A, B, C = "PatrolWaypoint\n", "MoveToGarbage\n", "sequence { MoveToGarbage PickupGarbage }\n"


def folder_of(path: Path, populations: list[list[IndividualRecord]], **changes: Any) -> RunFolder:
    """A folder with these populations, all of one stage."""
    path.mkdir()
    run = fake_run(populations=populations, best=[1.0] * len(populations), **changes)
    lines = [*RunFolder(run.path).records()]
    for line in lines:
        line["snapshot"]["stage"] = 0
    (path / "generations.jsonl").write_text("".join(f"{dump(line)}\n" for line in lines))
    (path / "config.yaml").write_text(yaml.safe_dump(config()))
    return RunFolder(path)


def test_the_chain_of_a_run(tmp_path: Path) -> None:
    """It ends with the individual, begins without parents, and each tree is made of the last."""
    folder = closed_run(tmp_path / "run")
    records = list(folder.records())
    everyone = {i["id"]: i for record in records for i in record["individuals"]}
    best = folder.summary()["champion"]["record"]
    chain = lineage(folder, best["id"])
    assert chain[-1].first["tree"] == best["tree"]
    assert chain[0].first["parents"] == []
    for step in chain:
        assert step.first == everyone[step.first["id"]]
        assert everyone[step.last]["tree"] == step.first["tree"]
    assert all(a.first["tree"] != b.first["tree"] for a, b in pairwise(chain))


def test_individuals_with_one_tree_are_one_step(tmp_path: Path) -> None:
    """An elite's copies are a step, worth their mean."""
    folder = folder_of(
        tmp_path / "run",
        [
            [individual("0.0", "random", tree=A, fitness=10.0)],
            [individual("1.0", "elite", ["0.0"], tree=A, fitness=30.0)],
            [individual("2.0", "copy", ["1.0"], tree=B, mutation="node", fitness=50.0)],
        ],
    )
    first, last = lineage(folder, "2.0")
    assert (first.first["id"], first.last, first.evaluated) == ("0.0", "1.0", 2)
    assert (first.fitness, first.changes) == (20.0, ())
    assert (last.first["origin"], last.first["mutation"], last.fitness) == ("copy", "node", 50.0)
    assert last.changes == ("~ PatrolWaypoint → MoveToGarbage",)


def test_parents_of_earlier_generations(tmp_path: Path) -> None:
    """A parent may be of any generation before; the first one's tree was changed."""
    folder = folder_of(
        tmp_path / "run",
        [
            [individual("0.0", "random", tree=A), individual("0.1", "random", tree=B)],
            [individual("1.0", "random", tree=B, fitness=7.0)],
            [individual("2.0", "random", tree=B)],
            [individual("3.0", "crossover", ["0.0", "1.0"], tree=C)],
        ],
    )
    first, last = lineage(folder, "3.0")
    assert (first.first["id"], last.first["parents"]) == ("0.0", ["0.0", "1.0"])


def test_an_injected_tree_has_its_origin(tmp_path: Path) -> None:
    """The guidance after the generation before it gave it; a founder has none."""
    folder = folder_of(
        tmp_path / "run",
        [
            [individual("0.0", "injected", tree=A)],
            [individual("1.0", "injected", tree=B)],
        ],
        guided=guidance(source="made", target="pickup", tree=B),
    )
    (step,) = lineage(folder, "1.0")
    assert step.guidance is not None
    assert (step.guidance["source"], step.guidance["target"]) == ("made", "pickup")
    assert lineage(folder, "0.0")[0].guidance is None


@pytest.mark.parametrize("parents", [["1.0"], ["2.0"], ["0.7"], ["x"], [""]])
def test_odd_parents_end_the_chain(tmp_path: Path, parents: list[str]) -> None:
    """A parent that is no earlier individual, or itself, ends the chain: it is not whole."""
    folder = folder_of(
        tmp_path / "run",
        [
            [individual("0.0", "random", tree=A)],
            [individual("1.0", "copy", parents, tree=B)],
        ],
    )
    chain = lineage(folder, "1.0")
    assert [(step.first["id"], step.first["parents"]) for step in chain] == [("1.0", parents)]


def test_an_unknown_individual_has_no_ancestors(tmp_path: Path) -> None:
    """An individual that the records do not have has no ancestors."""
    folder = folder_of(tmp_path / "run", [[individual("0.0", "random", tree=A)]])
    for name in ("9.0", "0.9", "", "a.b"):
        assert lineage(folder, name) == []


def test_a_chain_may_be_long(tmp_path: Path) -> None:
    """A run may have thousands of generations."""
    populations = [
        [individual(f"{g}.0", "copy", [f"{g - 1}.0"] if g else [], tree=(A, B)[g % 2])]
        for g in range(1500)
    ]
    chain = lineage(folder_of(tmp_path / "run", populations), "1499.0")
    assert [step.first["id"] for step in chain] == [f"{g}.0" for g in range(1500)]


def test_large_trees_are_not_compared(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Their step is marked, and the changes of others are limited."""
    folder = folder_of(
        tmp_path / "run",
        [[individual("0.0", "random", tree=A)], [individual("1.0", "copy", ["0.0"], tree=C)]],
    )
    monkeypatch.setattr(module, "MAX_CHANGES", 1)
    step = lineage(folder, "1.0")[-1]
    all_changes = tree_changes(A, C)
    assert all_changes is not None
    assert (step.changes, step.left_out) == (all_changes[:1], len(all_changes) - 1)
    monkeypatch.setattr(module, "MAX_NODES", 2)
    step = lineage(folder, "1.0")[-1]
    assert step.changes is None
