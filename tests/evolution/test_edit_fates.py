"""Fates of edits, against families that are laid out by hand."""

from __future__ import annotations

from dataclasses import replace

from islandgp.gp.edit_fates import edit_fates
from islandgp.gp.edits import Edit, EditTrial, as_record
from islandgp.gp.record import GenerationRecord, IndividualRecord, record_values
from tests.evolution.runs import run
from tests.tracking.test_metrics import metrics

ZERO = run()[0].record


def generation(
    g: int,
    families: dict[str, str],
    edits: tuple[str, ...] = (),
    trials: tuple[EditTrial, ...] = (),
) -> GenerationRecord:
    """A record: by id the parents, of an edited one after "*"; edits, refused ones with "!"."""
    line = ZERO.individuals[0]

    def individual(name: str, parents: str) -> IndividualRecord:
        origin = "edited" if "*" in parents else "copy"
        names = tuple(parents.replace("*", "").split())
        return replace(line, id=name, origin=origin, parents=names)

    guidance = ZERO.guidance
    assert guidance is not None
    records = tuple(
        as_record(
            Edit("combine", of=name.strip("!"), donor="0.0", reason="because"),
            "no" if "!" in name else "",
        )
        for name in edits
    )
    return replace(
        ZERO,
        snapshot=replace(ZERO.snapshot, generation=g),
        individuals=tuple(individual(*pair) for pair in families.items()),
        guidance=replace(guidance, edits=records),
        trials=trials,
    )


RUN = [
    generation(0, {"0.0": "", "0.1": ""}, ("0.0", "0.1!", "0.1")),
    generation(
        1,
        {"1.0": "0.0", "1.1": "*0.0", "1.2": "*0.1"},
        trials=(EditTrial("1.1", "0.0", 9, 5), EditTrial("1.2", "0.1", 3, 5)),
    ),
    generation(2, {"2.0": "1.1", "2.1": "1.1 1.0", "2.2": "1.0"}),
    generation(3, {"3.0": "2.1", "3.1": "1.1"}),
    generation(4, {"4.0": "2.2"}),
]


def test_fates() -> None:
    """Gain over the parent, children of the edited tree itself, and generations of descendants."""
    good, refused, bad = edit_fates(RUN)
    assert (good.gain, good.children, good.survived_generations) == (4, 3, 2)
    assert (refused.trial, refused.gain, refused.children) == (None, None, 0)
    assert refused.edit.refused == "no"
    assert (bad.gain, bad.children, bad.survived_generations) == (-2, 0, 0)
    assert [fate.generation for fate in (good, refused, bad)] == [0, 0, 0]


def test_metrics_of_edits() -> None:
    """A chart section where there are edits."""
    values = [record_values(record) for record in RUN]
    cost = {"episodes": 1, "simulated": 1}
    assert {k: v for k, v in metrics(values[1], cost).items() if k.startswith("edits/")} == {
        "edits/advised": 0,
        "edits/refused": 0,
        "edits/evaluated": 2,
        "edits/better": 1,
    }
    without = [record_values(step.record) for step in run()]
    assert not any("edits" in name for name in metrics(without[1], cost))
