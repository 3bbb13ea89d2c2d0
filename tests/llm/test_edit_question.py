"""supervisor=llm with supervisor.edits: what it is shown, what is taken, exactly once and again."""

from __future__ import annotations

import json
from functools import partial
from pathlib import Path
from typing import Any

import pytest

from islandgp.bt.core.language import parse, to_text
from islandgp.bt.core.node import Limits
from islandgp.domains.island.vocabulary import VOCABULARY
from islandgp.gp.edits import EDITS
from islandgp.gp.population import Origin
from islandgp.supervision.llm.answers import Accepted, Rejection, RejectionStage, check_edits
from islandgp.supervision.llm.history import listing
from islandgp.supervision.llm.message import Reply
from islandgp.supervision.llm.questions import Questions
from tests.llm.faults import no_faults
from tests.llm.mock_model import MockModel
from tests.llm.samples import context, outcome, reply_of, settings, state
from tests.llm.server import MessagesServer
from tests.llm.test_whole_run import live, replayed

EDITING = ("supervisor.edits=2", "supervisor.inject=false", "gp.generations=5")
MODEL = ("supervisor.policy.retry.deadline=5",)
OLD = "selector { when foundGarbage { PickupGarbage } PatrolWaypoint }"
LIVING = {"3.0": OLD, "3.1": "PatrolWaypoint"}
KNOWN = frozenset(to_text(parse(text)) for text in (*LIVING.values(), "SeekCharger"))
CHARGE = "when batteryLevel < 25 abort lower { sequence { SeekCharger ExecuteCharge } }"
FRONT = {"kind": "front", "of": "3.0", "at": "0", "branch": CHARGE, "reason": "it never charges"}


def check(reply: Reply) -> Accepted | Rejection:
    """The check of an answer with edits of LIVING."""
    return outcome(
        partial(
            check_edits, limits=Limits(8, 50), vocabulary=VOCABULARY, living=LIVING, existing=KNOWN
        ),
        reply,
    )


def checked(*edits: object, **other: Any) -> Accepted | Rejection:
    """The check of an answer with these edits."""
    return check(reply_of({"reasoning": "a", "edits": list(edits), **other}))


def test_an_edit_is_taken() -> None:
    """With its reason, and a branch in a Markdown fence."""
    for branch in (CHARGE, f"```bt\n{CHARGE}\n```"):
        accepted = checked({**FRONT, "branch": branch})
        assert isinstance(accepted, Accepted)
        (edit,) = accepted.guidance.edits
        assert (edit.kind, edit.of, edit.at, edit.reason) == ("front", "3.0", "0", FRONT["reason"])
        assert edit.branch == parse(CHARGE)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"of": "9.9"}, "expected an individual"),
        ({"at": "7/7"}, "expected a place"),
        ({"kind": "melt"}, "kind: expected 'front'"),
        ({"branch": "FlyHome"}, "FlyHome"),
        ({"branch": "selector {"}, "edit 1"),
        ({"branch": None}, "expected a branch in an edit front, found none"),
        ({"branch": 7}, "branch: expected a valid string"),
        ({"kind": "number", "number": "many"}, "number: expected a valid number"),
        ({"kind": "number", "number": float("inf")}, "number"),
        ({"kind": "replace", "at": "", "branch": "SeekCharger"}, "a copy"),
        ({"kind": "replace", "at": "", "branch": "PatrolWaypoint"}, "a copy"),
        ({"branch": CHARGE.replace("< 25", "> 200")}, "batteryLevel"),
    ],
)
def test_each_refusal_is_named(change: dict[str, Any], message: str) -> None:
    """Each fault is named for the repair turn, copies and linter warnings too."""
    rejection = checked({**FRONT, **change})
    assert isinstance(rejection, Rejection)
    assert rejection.stage is RejectionStage.EDITS
    assert message in rejection.error


@pytest.mark.parametrize("edits", [[], "front", None, [3], [[]]])
def test_an_answer_without_a_list_of_edits_is_refused(edits: object) -> None:
    """With the form that is expected."""
    rejection = check(reply_of({"reasoning": "a", "edits": edits}))
    assert isinstance(rejection, Rejection)
    assert rejection.stage is RejectionStage.FIELDS
    assert "edits: expected" in rejection.error


def test_good_edits_count_beside_bad_ones() -> None:
    """The record names the others and the reasons."""
    accepted = checked({**FRONT, "of": "9.9"}, FRONT)
    assert isinstance(accepted, Accepted)
    assert len(accepted.guidance.edits) == 1
    assert accepted.change.startswith("1 of 2 edits: edit 1: expected an individual")


def test_an_empty_answer_is_asked_again() -> None:
    """It is no refusal: the repair turn names it empty."""
    rejection = check(Reply("  ", "end_turn", None))
    assert isinstance(rejection, Rejection)
    assert rejection.stage is RejectionStage.JSON
    assert "an empty answer" in rejection.error


def test_the_listing_has_the_path_of_each_node() -> None:
    """As an edit names it."""
    assert listing(parse(OLD)) == {
        "": "selector",
        "0": "when foundGarbage",
        "0/0": "PickupGarbage",
        "1": "PatrolWaypoint",
    }


@pytest.mark.slow
def test_a_run_with_edits_repeats_bit_for_bit(tmp_path: Path) -> None:
    """Edits join the population; the replay asks nobody and has the same records."""
    with MessagesServer(no_faults, MockModel()) as server:
        steps = live(server, tmp_path / "a", *EDITING, *MODEL)
    individuals = [i for s in steps for i in s.record.individuals]
    assert any(i.origin == Origin.EDITED for i in individuals)
    assert any(s.record.trials for s in steps)
    lines = (tmp_path / "a" / "transcript.jsonl").read_text(encoding="utf-8").splitlines()
    entries = [json.loads(line) for line in lines]
    parts = {line["call"]["part"] for line in entries if line["line"] == "attempt"}
    assert parts == {"probe", "rate", "edits"}
    replay = replayed(tmp_path / "a", tmp_path / "b", *EDITING)
    assert [s.record for s in replay] == [s.record for s in steps]
    with MessagesServer(no_faults, MockModel()) as server:
        first = live(server, tmp_path / "c", *EDITING, *MODEL, stop=2)
        past = [step.record for step in first]
        state = first[-1].state
        rest = live(server, tmp_path / "c", *EDITING, *MODEL, start=state, past=past)
    assert [s.record for s in (*first, *rest)] == [s.record for s in steps]
    turns = [
        line["request"]["turns"][0]
        for line in entries
        if "request" in line and line["call"]["part"] == "edits"
    ]
    assert "Earlier edits, and what they gained" in turns[-1]
    assert "points (" in turns[-1]


def test_every_kind_is_explained() -> None:
    """The system prompt has each kind of edit, and names no domain's words beside its own."""
    run_context = context(None, "supervisor.edits=2")
    request = Questions(settings(), run_context).request("edits", state())
    assert all(f"- {name} (needs {kind.needs})" in request.system for name, kind in EDITS.items())
    assert request.schema is not None
    assert set(request.schema["properties"]) == {"reasoning", "edits"}
