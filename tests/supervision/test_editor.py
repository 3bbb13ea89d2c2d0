"""The editor: what the best tree lacks, where the branch comes from, and where it is put."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from islandgp.bt.core.language import parse, to_text
from islandgp.domains.island.vocabulary import VOCABULARY
from islandgp.gp.edits import Edit, EditTrial, as_record
from islandgp.gp.record import IndividualRecord
from islandgp.running.parts import make_supervisor
from islandgp.supervision.base import GenerationView
from islandgp.supervision.editor import Editor, guard_width, place_for, requirements, widened
from islandgp.supervision.library import Library
from tests.composed import composed
from tests.evolution.runs import run
from tests.samples import snapshot, state

PATROL = "PatrolWaypoint"
COLLECT = (
    "selector { when foundGarbage { sequence { MoveToGarbage PickupGarbage } } PatrolWaypoint }"
)
CHARGE = "when batteryLevel < 45 abort lower { sequence { SeekCharger ExecuteCharge } }"
RNG = np.random.default_rng(0)


def individual(name: str, tree: str, fitness: float = 0.0, **counters: float) -> IndividualRecord:
    """A line of a record, with these counters and 0 for the others."""
    every = dict.fromkeys(composed().make_domain().schema.counters, 0.0)
    return IndividualRecord(
        id=name,
        origin="random",
        parents=(),
        mutation="",
        tree=to_text(parse(tree)),
        nodes=3,
        depth=2,
        fitness=fitness,
        components={},
        specialist="patrol_only",
        tiers=(),
        counters={**every, **counters},
        endings=("end",),
    )


def view(*individuals: IndividualRecord, generation: int = 0, **fields: Any) -> GenerationView:
    """A generation as supervisors see it."""
    return GenerationView(snapshot(generation), (0,), {}, individuals, None, **fields)


def editor(name: str = "editor", *overrides: str) -> Editor:
    """The supervisor of that name."""
    supervisor = make_supervisor(composed(f"supervisor={name}", *overrides), None)
    assert isinstance(supervisor, Editor)
    return supervisor


def without_library() -> Editor:
    """The editor of a domain without a library."""
    supervisor = editor()
    supervisor.library = Library({}, {}, {}, {})
    return supervisor


def advice(supervisor: Editor, generation: GenerationView) -> tuple[Edit, ...]:
    """What it advises after a generation."""
    supervisor.on_generation(generation)
    return supervisor.advise(state([generation.snapshot]), RNG).edits


def test_what_the_milestones_ask_for() -> None:
    """Counters with their values, the easiest milestone first, no fitness; then the behaviours."""
    rows = [(r.counter, r.value, r.milestone) for r in requirements(composed().classes)]
    assert rows == [
        ("pickups", 2, 0),
        ("interactions", 1, 0),
        ("deliveries", 1, 0),
        ("charges", 1, 0),
        ("pickups", 4, 1),
        ("interactions", 2, 1),
        ("deliveries", 2, 1),
        ("gathered", 6, 1),
        ("pickups", 0, 2),
        ("interactions", 0, 2),
        ("charges", 0, 2),
        ("deliveries", 0, 2),
    ]


def test_the_fittest_tree_gets_what_it_lacks() -> None:
    """What the easiest milestone asks for, the hardest behaviour first."""
    population = (
        individual("0.0", PATROL, 300),
        individual("0.1", COLLECT, 500, pickups=3),
        individual("0.2", COLLECT, 800, pickups=2),
    )
    first, second, third = advice(editor(), view(*population))
    assert {edit.of for edit in (first, second, third)} == {"0.2"}
    assert (first.kind, first.at) == ("front", "")
    assert first.branch == parse(CHARGE)
    assert first.reason == (
        "charges 0, wanted at least 1: a branch of library tree single_charging"
    )
    assert [e.reason.split()[0] for e in (second, third)] == ["deliveries", "interactions"]


def test_a_branch_of_a_tree_that_has_shown_the_behaviour() -> None:
    """Without a library: the guarded branch with the action that goes with the counter."""
    donor = f"selector {{ when lap < 2 {{ {PATROL} }} {CHARGE} MoveToHumanoid }}"
    population = (
        individual("0.0", COLLECT, 500, pickups=3),
        individual("0.1", donor, 100, charges=2),
        individual("0.2", PATROL, 50),
    )
    (edit,) = advice(without_library(), view(*population))
    assert edit.branch == parse(CHARGE)
    assert "individual 0.1" in edit.reason


def test_a_branch_that_is_there_already_gets_a_wider_guard() -> None:
    """It is not put in twice."""
    tree = f"selector {{ {CHARGE} {PATROL} }}"
    edits = advice(editor(), view(individual("0.0", tree)))
    wider = edits[0]
    assert (wider.kind, wider.at, wider.number) == ("number", "0", 60)
    assert all(edit.branch != parse(CHARGE) for edit in edits)


def test_no_edits_without_a_weak_behaviour() -> None:
    """Where the best tree meets everything, where no generation was seen, or another one."""
    all_of_it = individual(
        "0.0", COLLECT, pickups=9, interactions=9, deliveries=9, charges=9, gathered=99
    )
    assert advice(editor(), view(all_of_it)) == ()
    assert editor().advise(state([snapshot()]), RNG).edits == ()
    supervisor = editor()
    supervisor.on_generation(view(individual("0.0", PATROL)))
    assert supervisor.advise(state([snapshot(3)]), RNG).edits == ()


@pytest.mark.parametrize(
    ("tree", "branch", "place"),
    [
        ("PatrolWaypoint", CHARGE, None),
        (COLLECT, CHARGE, 0),
        (f"selector {{ {CHARGE} PatrolWaypoint }}", "when foundGarbage { PickupGarbage }", 1),
        (f"selector {{ {CHARGE} }}", "MoveToHumanoid", 1),
    ],
)
def test_the_narrowest_guard_comes_first(tree: str, branch: str, place: int | None) -> None:
    """A branch belongs before those whose guards hold as often or more often."""
    assert place_for(parse(tree), parse(branch), VOCABULARY) == place


def test_guard_width() -> None:
    """The share of its key's range in which a guard holds; 1 without a guard."""
    assert guard_width(parse(CHARGE), VOCABULARY) == 0.45
    assert guard_width(parse("when not foundGarbage { PatrolWaypoint }"), VOCABULARY) == 0.5
    joined = parse("when batteryLevel < 20 and foundGarbage { PatrolWaypoint }")
    assert guard_width(joined, VOCABULARY) == 0.2
    assert guard_width(parse(PATROL), VOCABULARY) == 1


def test_widened() -> None:
    """The number moves by a share of the range; a flag, or a number at its end, cannot."""

    def of(text: str) -> float | None:
        expr = parse(f"when {text} {{ PatrolWaypoint }}").args[0]
        return widened(expr, VOCABULARY)  # type: ignore[arg-type] # a `when` has a condition

    assert of("batteryLevel < 20") == 35
    assert of("batteryLevel > 20") == 5
    assert of("batteryLevel < 100") is None
    assert of("foundGarbage") is None


@pytest.mark.parametrize("refused", ["", "the tree breaks the limits"])
def test_an_edit_is_not_repeated(refused: str) -> None:
    """Accepted or refused: the same tree gets another branch afterwards."""
    other = "when batteryLevel < 50 { sequence { SeekCharger ExecuteCharge PatrolWaypoint } }"
    donor = individual("0.1", f"selector {{ {other} PatrolWaypoint }}", 10, charges=1)
    population = (individual("0.0", COLLECT, 500, pickups=3), donor)
    supervisor = editor("editor", "supervisor.edits=1")
    (first,) = advice(supervisor, view(*population))
    assert first.branch == parse(CHARGE)
    led = run()[0].record.guidance
    assert led is not None
    trials = () if refused else (EditTrial("1.0", "0.0", 500, 500),)
    later = replace(
        view(*population, generation=1, trials=trials),
        guidance=replace(led, asked_at=0, edits=(as_record(first, refused),)),
    )
    (second,) = advice(supervisor, later)
    assert second.branch == parse(other)


def test_two_counters_do_not_get_the_same_edit() -> None:
    """A branch that is typical of both is inserted once."""
    donor = individual("0.1", f"selector {{ {CHARGE} PatrolWaypoint }}", charges=1, deliveries=1)
    population = (individual("0.0", COLLECT, 500, pickups=3), donor)
    edits = advice(without_library(), view(*population))
    changes = [(edit.kind, edit.at, edit.branch) for edit in edits]
    assert len(changes) == len(set(changes)) == 1
