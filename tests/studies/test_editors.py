"""The control arms of the editor: each replaces one of its decisions."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd  # type: ignore[import-untyped] # its stubs are a package apart
import pytest

from islandgp.bt.core.language import parse, to_text
from islandgp.errors import SupervisionError
from islandgp.gp.edits import Edit
from islandgp.gp.record import record_values
from islandgp.records.files import dump
from islandgp.running.parts import make_supervisor
from islandgp.statistics import paired_difference, paired_test
from islandgp.supervision.base import GenerationView
from islandgp.supervision.editor import Editor
from studies.editors.controls import EditorYoked
from tests.evolution.runs import run
from tests.running.commands import ROOT
from tests.samples import snapshot, state
from tests.studies.configured import studied
from tests.supervision.test_editor import CHARGE, COLLECT, PATROL, advice, individual, view


def editor(name: str, *overrides: str) -> Editor:
    """The supervisor of that name."""
    supervisor = make_supervisor(studied(f"supervisor={name}", *overrides), None)
    assert isinstance(supervisor, Editor)
    return supervisor


def test_a_random_branch() -> None:
    """The best tree, branches of any counter."""
    population = view(individual("0.0", COLLECT, 500, pickups=3), individual("0.1", PATROL))
    branches = {
        to_text(edit.branch)
        for k in range(20)
        for edit in _drawn("editor_random_branch", population, k)
        if edit.branch is not None
    }
    assert len(branches) >= 3


def test_a_random_tree() -> None:
    """The branch that the best tree lacks, in any tree."""
    population = view(individual("0.0", COLLECT, 500, pickups=3), individual("0.1", PATROL))
    edits = [e for k in range(20) for e in _drawn("editor_random_tree", population, k)[:1]]
    assert {edit.of for edit in edits} == {"0.0", "0.1"}
    assert {edit.branch for edit in edits} == {parse(CHARGE)}


def _drawn(name: str, population: GenerationView, seed: int) -> tuple[Edit, ...]:
    supervisor = editor(name)
    supervisor.on_generation(population)
    return supervisor.advise(state([snapshot()]), np.random.default_rng(seed)).edits


def test_a_constant() -> None:
    """The same counter, also where it is met; another one can be named."""
    population = view(individual("0.0", COLLECT, 500, charges=3))
    edit, *_ = advice(editor("editor_constant"), population)
    assert edit.branch == parse(CHARGE)
    edit, *_ = advice(editor("editor_constant", "supervisor.policy.counter=deliveries"), population)
    assert "single_clearing" in edit.reason
    with pytest.raises(SupervisionError, match=r"expected one of .*charges.*, found 'laps'"):
        editor("editor_constant", "supervisor.policy.counter=laps")


def test_yoked(tmp_path: Path) -> None:
    """It works on the counters of the other run's editor, for any missing behaviour here."""
    folder = tmp_path / "led1"
    folder.mkdir()
    text = []
    for step in run():
        values = record_values(step.record)
        if values["guidance"]:
            values["guidance"]["notes"] = {"counters": "charges pickups"}
        text.append(dump(values) + "\n")
    (folder / "generations.jsonl").write_text("".join(text), encoding="utf-8")
    overrides = (f"supervisor.policy.record='{tmp_path}/led{{seed}}'", "gp.generations=8", "seed=0")
    supervisor = editor("editor_yoked", *overrides)
    assert isinstance(supervisor, EditorYoked)
    assert supervisor.counters == (*([("charges", "pickups")] * 7), ())
    all_of_it = individual(
        "0.0", PATROL, pickups=9, interactions=9, deliveries=9, charges=9, gathered=99
    )
    edits = advice(supervisor, view(all_of_it))
    assert ["single_charging" in e.reason for e in edits] == [True, False]
    with pytest.raises(SupervisionError, match="Expected the record of another run"):
        editor("editor_yoked", "supervisor.policy.record=nowhere")


def test_the_page_s_differences_are_those_of_the_shared_seeds() -> None:
    """Each row's pairs, difference, directions and p are computed again from runs.csv."""
    names = ["random_branch", "yoked", "random_tree", "constant", "combined", "expert", "founders"]
    runs = pd.read_csv(ROOT / "studies/editors/results/runs.csv").fillna({"first.complete": 41})
    firsts = runs.pivot(index="seed", columns="arm", values="first.complete")
    page = (ROOT / "studies/editors/README.md").read_text(encoding="utf-8")
    rows = [line.split("|")[2:6] for line in page.splitlines() if line.count("|") == 8][2:]
    for name, row in zip([*names, "baseline", "fixed"], rows, strict=True):
        editor_runs, control = firsts[["editor", name]].dropna().to_numpy().T
        gap, test = paired_difference(editor_runs, control), paired_test(editor_runs, control)
        assert [cell.strip().partition(" (")[0] for cell in row] == [
            str(test.pairs),
            f"{gap.estimate:.1f} [{gap.low:.1f}, {gap.high:.1f}]",
            f"{(editor_runs < control).sum()}, {(editor_runs == control).sum()},"
            f" {(editor_runs > control).sum()}",
            row[3].strip(),
        ]
        told = float(row[3].strip(" <"))
        assert test.p < told if "<" in row[3] else told == pytest.approx(test.p, rel=0.07)
