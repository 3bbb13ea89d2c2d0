"""Edits of trees: what each kind does, what is refused, and how records show it."""

from __future__ import annotations

import json
from dataclasses import replace
from itertools import pairwise
from typing import Any

import numpy as np
import pytest

from islandgp.bt.core.language import parse, to_text
from islandgp.bt.core.node import Limits
from islandgp.domains.island.vocabulary import VOCABULARY
from islandgp.errors import SupervisionError
from islandgp.gp.edits import EDITS, Edit, edited
from islandgp.gp.record import GenerationRecord, Step, record_values
from islandgp.plain import from_json
from islandgp.records.files import dump
from islandgp.scoring.state import PopulationState
from islandgp.supervision.base import GenerationView, Guidance
from tests.evolution.runs import Constant, lines, plan, records, run

LIST = (
    "selector { when batteryLevel < 20 { SeekCharger } sequence { MoveToGarbage PickupGarbage } }"
)
PAIR = "sequence { MoveToGarbage PickupGarbage }"
BRANCH = parse("when isHumanoidWantToClear { MoveToHumanoid }")
WIDE = Limits(8, 50)

CHANGES: list[tuple[str, dict[str, Any], str, str | None]] = [
    # kind, fields, tree, what it becomes; B is BRANCH
    ("front", {}, LIST, "selector { B when batteryLevel < 20 { SeekCharger } P }"),
    ("front", {"at": "1"}, LIST, "selector { when batteryLevel < 20 { SeekCharger } B P }"),
    ("front", {"at": PAIR}, LIST, "selector { when batteryLevel < 20 { SeekCharger } B P }"),
    (
        "front",
        {"at": "1/1"},
        LIST,
        "selector { when batteryLevel < 20 { SeekCharger }"
        " sequence { MoveToGarbage selector { B PickupGarbage } } }",
    ),
    ("front", {}, PAIR, "selector { B P }"),
    ("insert", {"at": "2"}, "selector { when foundGarbage { P } when batteryLevel < 9 { P } }",
     "selector { when foundGarbage { P } when batteryLevel < 9 { P } B }"),
    ("insert", {"at": " 1 "}, PAIR, "sequence { MoveToGarbage B PickupGarbage }"),
    ("replace", {"at": "0"}, LIST, "selector { B P }"),
    ("replace", {"at": "0/0"}, LIST, "selector { when batteryLevel < 20 { B } P }"),
    ("number", {"at": "0", "number": 35}, LIST,
     "selector { when batteryLevel < 35 { SeekCharger } P }"),
    ("number", {"at": "0", "number": 3, "term": 1},
     "selector { when foundGarbage and lap < 1 { P } P }",
     None),
    ("number", {"number": 2}, "repeater 3 { P }", "repeater 2 { P }"),
    ("combine", {"donor": "0.1", "donor_at": "0"}, PAIR,
     "selector { when lap < 1 { PatrolWaypoint } P }"),
]  # fmt: skip


def expand(text: str) -> str:
    """The text with its short words written out."""
    abbreviations = {"B": to_text(BRANCH), "P": PAIR}
    return " ".join(abbreviations.get(word, word) for word in text.split())


def make(kind: str, **fields: Any) -> Edit:
    """An edit of 0.0, with the branch where the kind takes one."""
    branch = {"branch": BRANCH} if EDITS[kind].needs == "branch" else {}
    return Edit(kind, of="0.0", **{**branch, **fields})


def changed(edit: Edit, tree: str, limits: Limits = WIDE) -> str:
    """What an edit makes of a tree."""
    donor = parse("selector { when lap < 1 { PatrolWaypoint } PatrolWaypoint }")
    trees = {"0.0": parse(expand(tree)), "0.1": donor}
    return to_text(edited(edit, trees, VOCABULARY, limits))


@pytest.mark.parametrize(("kind", "fields", "before", "after"), CHANGES)
def test_kinds(kind: str, fields: dict[str, Any], before: str, after: str | None) -> None:
    """Each kind changes the place that is named, and nothing else."""
    text = changed(make(kind, **fields), before)
    if after is None:
        assert "lap < 3" in text
        assert "foundGarbage" in text
    else:
        assert text == to_text(parse(expand(after)))


def test_every_kind_is_tested() -> None:
    """The table above has an entry of each."""
    assert {kind for kind, *_ in CHANGES} == EDITS.keys()


REFUSED: list[tuple[Edit, str, str]] = [
    # edit, tree, the start of the reason
    (Edit("front", of="9.9", branch=BRANCH), LIST, "expected an individual of the population"),
    (make("combine", donor="7.1"), LIST, "expected an individual of the population"),
    (make("front", at="0/3"), LIST, "expected a place in the tree, found '0/3': the node at '0'"),
    (make("front", at="9" * 9), LIST, "expected a place such as 0/2/1"),
    (make("front", at="no tree {"), LIST, "expected a place such as 0/2/1"),
    (make("front", at="PatrolWaypoint"), LIST, "expected a subtree of the tree as the place"),
    (make("front", at="SeekCharger"), "sequence { SeekCharger SeekCharger }",
     "expected a subtree that occurs in the tree once, found it 2 times, at 0 and 1"),
    (make("insert"), LIST, "expected the place of a child of a selector"),
    (make("insert", at="0/1"), LIST, "expected the place of a child of a selector"),
    (make("insert", at="7"), LIST, "expected a place among the 2 children of '' or after"),
    (make("replace", at="1", branch=parse(PAIR)), LIST, "expected a change"),
    (make("replace", branch=parse("MakeTea")), LIST, "1:1"),
    (make("number", number=3), LIST, "expected a `when` or a repeater at '', found selector"),
    (make("number", number=3, at="0", term=1), LIST, "expected a term of 0 to 0, found 1"),
    (make("number", number=3, at="0"), "selector { when foundGarbage { P } P }",
     "expected a comparison with a number, found the flag foundGarbage"),
    (make("number", number=0.5), "repeater 3 { P }", "expected a count of 1 to 100, found 0.5"),
    (make("number", number=-3, at="0"), LIST, "this branch can never run"),
    (make("front", branch=parse("PatrolWaypoint")), LIST, "this branch can never run"),
]  # fmt: skip


@pytest.mark.parametrize(("edit", "tree", "reason"), REFUSED)
def test_refused(edit: Edit, tree: str, reason: str) -> None:
    """An edit that cannot be made, or makes a part that can never work, gives its reason."""
    with pytest.raises(ValueError, match=r"\w") as error:
        changed(edit, tree)
    assert reason in str(error.value)
    assert "\n" not in str(error.value)


def test_limits() -> None:
    """An edited tree keeps the limits of the run."""
    with pytest.raises(ValueError, match=r"expected at most 50 nodes and 3 levels, found 9 and 5"):
        changed(make("front", at="1/1"), LIST, Limits(3, 50))


@pytest.mark.parametrize(
    ("kind", "fields", "message"),
    [
        ("graft", {}, "expected an edit of one of the kinds front, insert, replace, number"),
        ("front", {}, "expected a branch in an edit front, found none"),
        ("number", {"number": 3.0, "branch": BRANCH}, "expected no branch in an edit number"),
        ("combine", {}, "expected a donor in an edit combine, found none"),
    ],
)
def test_an_edit_has_the_fields_of_its_kind(
    kind: str, fields: dict[str, Any], message: str
) -> None:
    """What is missing, or of no use, is refused when the edit is made."""
    with pytest.raises(ValueError, match=message):
        Edit(kind, of="0.0", **fields)


class Edits(Constant):
    """Edits the fittest individual and combines it with the second; names a stranger, too."""

    now: GenerationView | None = None

    def on_generation(self, generation: GenerationView) -> None:
        """See `GenerationListener`."""
        self.now = generation

    def advise(self, state: PopulationState, rng: np.random.Generator) -> Guidance:
        """See `Supervisor`."""
        guidance = super().advise(state, rng)
        assert self.now is not None
        first, second = sorted(self.now.individuals, key=lambda i: -i.fitness)[:2]
        edits = (
            Edit("front", of=first.id, branch=BRANCH, reason="humanoids wait"),
            Edit("front", of="99.0", branch=BRANCH),
            Edit("combine", of=first.id, donor=second.id, reason="both are good"),
            Edit("front", of=second.id, branch=BRANCH),
        )
        return replace(guidance, edits=edits)


def test_an_edit_in_a_run() -> None:
    """Edits are recorded, taken while there are slots, evaluated as they are, and have parents."""
    steps = run(plan("+supervisor.edits=2", "gp.mutation_rate=1"), Edits(rate=1.0))
    for before, after in pairwise(steps):
        guidance = before.record.guidance
        assert guidance is not None
        front, stranger, combine, last = guidance.edits
        assert stranger.refused.startswith("expected an individual of the population")
        accepted = [e for e in (front, combine, last) if not e.refused]
        edited = [i for i in after.record.individuals if i.origin == "edited"]
        assert len(edited) == len(accepted) <= 2
        trees = {i.id: i.tree for i in before.record.individuals}
        for edit, i in zip(accepted, edited, strict=True):
            assert i.mutation == f"edit:{edit.kind}"
            assert i.parents == tuple(name for name in (edit.of, edit.donor) if name)
            assert i.tree != trees[edit.of]
        assert [t.id for t in after.record.trials] == [i.id for i in edited]


def test_an_edited_tree_is_compared_with_its_parent_in_the_same_world() -> None:
    """A trial holds both; the parent's episode is counted where it is one more."""
    steps = run(plan("+supervisor.edits=2"), Edits())
    for step in steps[1:]:
        trials = step.record.trials
        assert trials
        by_id = {i.id: i for i in step.record.individuals}
        for trial in trials:
            assert by_id[trial.id].fitness == trial.fitness
            assert by_id[trial.id].parents[0] == trial.parent
        texts = {i.tree for i in step.record.individuals}
        parents = {parent_text(steps, trial.parent) for trial in trials}
        assert step.cost.episodes == 12 + len(parents - texts)


def parent_text(steps: list[Step], name: str) -> str:
    """The tree of an individual of a run."""
    generation, slot = map(int, name.split("."))
    return steps[generation].record.individuals[slot].tree


@pytest.mark.parametrize("overrides", [(), ("gp.shared_seed=false",), ("gp.episodes=2",)])
def test_a_parent_meets_the_worlds_of_its_edited_tree(overrides: tuple[str, ...]) -> None:
    """Where worlds are common or not, of one episode or several."""
    from islandgp.evaluation.base import Job
    from tests.evolution.fake import outcome_of

    run_plan = plan("+supervisor.edits=2", *overrides)
    steps = run(run_plan, Edits())
    n = run_plan.gp.episodes
    for step in steps[1:]:
        worlds, stage = step.record.worlds, step.record.snapshot.stage
        for trial in step.record.trials:
            at = 0 if run_plan.gp.shared_seed else n * int(trial.id.partition(".")[2])
            tree = parent_text(steps, trial.parent)
            points = [outcome_of(Job(tree, stage, w)).fitness for w in worlds[at : at + n]]
            assert trial.parent_fitness == sum(points) / n


def test_resuming_with_edits() -> None:
    """A run that goes on from any of its states has the same edits, trials and trees."""
    run_plan = plan("+supervisor.edits=2")
    straight = run(run_plan, Edits())
    expected = list(lines(straight))
    assert sum("edit:front" in line for line in expected) >= 4
    from islandgp.evolution.loop import evolve
    from tests.evolution.fake import Fake

    for at, step in enumerate(straight[:-1], 1):
        past = records(straight)[:at]
        resumed = list(evolve(run_plan, 1, Edits(), Fake(), start=step.state, past=past))
        assert list(lines(resumed)) == expected[at:]


def test_edits_are_refused_where_there_are_no_slots() -> None:
    """By default: no supervisor of before gives any."""
    steps = run(supervisor=Edits())
    guidance = steps[0].record.guidance
    assert guidance is not None
    assert {e.refused for e in guidance.edits} == {"edits are switched off (supervisor.edits=0)"}
    assert "edited" not in steps[1].record.origins


def test_a_record_without_edits_is_as_before() -> None:
    """Its JSON has no word of them; one with edits can be read again."""
    without = json.loads(dump(record_values(run()[0].record)))
    assert "trials" not in without
    assert "edits" not in without["guidance"]
    record = run(plan("+supervisor.edits=2"), Edits())[1].record
    assert from_json(GenerationRecord, json.loads(dump(record_values(record)))) == record


def test_an_invalid_edit_ends_the_run() -> None:
    """In one line that names the supervisor."""

    class Wrong(Constant):
        def advise(self, state: PopulationState, rng: np.random.Generator) -> Guidance:
            return replace(super().advise(state, rng), edits=("front",))  # type: ignore[arg-type] # wrong on purpose

    with pytest.raises(SupervisionError, match=r"found edits\.0='front': input should be"):
        run(supervisor=Wrong())
