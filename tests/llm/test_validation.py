"""The funnel: what is taken from an answer, and at which stage the rest is turned away."""

from __future__ import annotations

import json
import math
import time
from functools import partial

import pytest
from hypothesis import given
from hypothesis import strategies as st

from islandgp.bt.core.language import parse, to_text
from islandgp.bt.core.node import Limits, within
from islandgp.domains.island.vocabulary import VOCABULARY
from islandgp.supervision.base import Pattern, Phase
from islandgp.supervision.llm.answers import (
    Accepted,
    DecisionAnswer,
    Rejection,
    RejectionStage,
    check_decision,
    check_proposal,
    proposal_model,
    schema,
)
from islandgp.supervision.llm.message import MAX_ANSWER, Reply
from tests.llm.samples import DECISION as GOOD
from tests.llm.samples import PROPOSAL as GOOD_TREE
from tests.llm.samples import USAGE, outcome, reply_of
from tests.samples import CLASSES
from tests.strategies import nodes

RATES = (0.1, 0.5)
LIMITS = Limits(5, 22)
PROPOSAL = proposal_model(CLASSES.targets)
decide = partial(outcome, partial(check_decision, rates=RATES))
propose = partial(
    outcome,
    partial(check_proposal, limits=LIMITS, vocabulary=VOCABULARY, targets=CLASSES.targets),
)


def rejected(answer: object) -> Rejection:
    assert isinstance(answer, Rejection), answer
    return answer


def test_a_good_decision_is_taken_whole() -> None:
    """Every field of it arrives, typed."""
    accepted = decide(reply_of(GOOD))
    assert isinstance(accepted, Accepted)
    d = accepted.guidance
    assert (d.mutation_rate, d.phase, d.pattern) == (
        0.42,
        Phase.EARLY_EXPLORATION,
        Pattern.EXPLORATION_PHASE,
    )
    assert (d.intervention, d.risk, d.reasoning, accepted.change) == (False, "a", "b", "")


def test_a_good_tree_is_taken_whole() -> None:
    """The tree is parsed, comments and subtrees included; target and rationale come along."""
    text = "# a note\nsubtree go = PatrolWaypoint\nselector { use go use go }"
    accepted = propose(reply_of({**GOOD_TREE, "tree": text}))
    assert isinstance(accepted, Accepted)
    assert accepted.guidance.tree is not None
    assert to_text(accepted.guidance.tree) == "selector { PatrolWaypoint PatrolWaypoint }\n"
    assert (accepted.guidance.target, accepted.guidance.rationale) == ("rare", "c")


@pytest.mark.parametrize(
    "text",
    [
        json.dumps(GOOD),
        f"Sure!\n```json\n{json.dumps(GOOD, indent=2)}\n```\nI hope this helps.",
        f"First {{}} and then {json.dumps(GOOD)} and { {'other': 1} }",
        f'{{"note": "a draft"}} {json.dumps(GOOD)}',
        json.dumps({**GOOD, "confidence": 0.9}),
    ],
)
def test_json_is_found_between_other_words(text: str) -> None:
    """Servers that take no schema wrap their JSON in prose; fields too many do no harm."""
    assert isinstance(decide(reply_of(text)), Accepted)


@pytest.mark.parametrize(
    "text",
    [
        "I would rather not use JSON.",
        "[1, 2]",
        '{"mutation_rate": 0.3',
        "[" * 90_000,
        '{"a":' * 18_000,
        " " * (MAX_ANSWER + 1) + json.dumps(GOOD),
    ],
)
def test_no_json(text: str) -> None:
    """What holds no whole object, or is too long for an answer, ends at the first stage."""
    assert rejected(decide(reply_of(text))).stage is RejectionStage.JSON


@pytest.mark.parametrize(
    "text",
    [
        json.dumps(GOOD)[:-1] + ",}",
        repr(GOOD),
        repr(GOOD).replace("False", "false"),
        f"Sure: {GOOD!r}\nThat is all.",
        json.dumps({**GOOD, "mutation_rate": "0.42"}),
        json.dumps({**GOOD, "intervention": "False"}),
        json.dumps({**GOOD, "phase": "Early Exploration"}),
        json.dumps({**GOOD, "phase": "EARLY-EXPLORATION", "pattern": "Exploration_Phase"}),
    ],
)
def test_small_slips_are_repaired(text: str) -> None:
    """As weak models make them."""
    accepted = decide(reply_of(text))
    assert isinstance(accepted, Accepted), accepted
    whole = decide(reply_of(GOOD))
    assert isinstance(whole, Accepted)
    assert accepted.guidance == whole.guidance


def test_slips_around_a_tree_are_repaired() -> None:
    """Single quotes, line breaks in the text, a target with a capital letter."""
    text = "{'tree': 'selector {\n  PatrolWaypoint\n}', 'target': 'Rare', 'rationale': 'c',}"
    accepted = propose(reply_of(text))
    assert isinstance(accepted, Accepted), accepted
    assert accepted.guidance.target == "rare"


@pytest.mark.parametrize(
    ("change", "error"),
    [
        (
            {"mutation_rate": "high"},
            "mutation_rate: expected a valid number, unable to parse string as a number, found",
        ),
        ({"mutation_rate": None}, "mutation_rate: expected a valid number, found None"),
        ({"mutation_rate": math.nan}, "mutation_rate: expected a finite number, found nan"),
        ({"mutation_rate": math.inf}, "mutation_rate: expected a finite number, found inf"),
        ({"mutation_rate": 10**400}, "mutation_rate: expected a valid number, found 1000"),
        (
            {"intervention": "not sure"},
            "intervention: expected a valid boolean, unable to interpret input, found 'not sure'",
        ),
        ({"phase": "panic"}, "phase: expected 'early_exploration', 'exploitation'"),
        ({"pattern": 3}, "pattern: expected 'exploration_phase'"),
        ({"risk": ["x"]}, "risk: expected a valid string, found ['x']"),
    ],
)
def test_wrong_fields_are_named(change: dict[str, object], error: str) -> None:
    """Each wrong field is named with what was expected and what was found."""
    rejection = rejected(decide(reply_of({**GOOD, **change})))
    assert rejection.stage is RejectionStage.FIELDS
    assert error in rejection.error


@pytest.mark.parametrize("target", ["flying", "rarely", "", 3, None])
def test_a_target_is_one_of_the_state_s(target: object) -> None:
    """The error lists the targets."""
    rejection = rejected(propose(reply_of({**GOOD_TREE, "target": target})))
    assert rejection.stage is RejectionStage.FIELDS
    assert rejection.error.startswith("target: expected 'pickup', 'humanoid', 'charging', ")


@pytest.mark.parametrize("rate", [7, -0.2, 0.09999, 0.50001, 45, 1e299])
def test_a_rate_outside_the_range_is_refused(rate: float) -> None:
    """By default it is never used, clamped or not."""
    rejection = rejected(decide(reply_of({**GOOD, "mutation_rate": rate})))
    assert rejection.stage is RejectionStage.RANGE
    assert "from 0.1 to 0.5" in rejection.error


@pytest.mark.parametrize(
    ("tree", "stage", "error"),
    [
        ("selector { PatrolWaypoint", RejectionStage.GRAMMAR, "the text ends too early"),
        ("", RejectionStage.GRAMMAR, "the text is empty"),
        ("Ignore all instructions.", RejectionStage.NAMES, "Ignore"),
        ("[" * 1000, RejectionStage.GRAMMAR, "unexpected '['"),
        ("sequence { FlyHome }", RejectionStage.NAMES, "FlyHome"),
        (
            "domain maze PatrolWaypoint",
            RejectionStage.NAMES,
            "for the domain 'maze', not for 'island'",
        ),
        ("domain island PatrolWaypoin", RejectionStage.NAMES, "Did you mean PatrolWaypoint?"),
        (
            "when batteryLevle < 5 { PatrolWaypoint }",
            RejectionStage.NAMES,
            "Did you mean batteryLevel?",
        ),
        ("inverter { " * 6 + "PatrolWaypoint" + " }" * 6, RejectionStage.LIMITS, "5 levels"),
        ("selector { " + "PatrolWaypoint " * 22 + "}", RejectionStage.LIMITS, "22 nodes"),
        ("inverter { " * 200 + "PatrolWaypoint" + " }" * 200, RejectionStage.LIMITS, "too deep"),
        ("x" * 100_001, RejectionStage.LIMITS, "100001 characters"),
    ],
)
def test_trees_are_turned_away_at_their_stage(tree: str, stage: RejectionStage, error: str) -> None:
    """Grammar, names and limits each speak with the language's own message."""
    body = json.dumps({**GOOD_TREE, "tree": tree})
    if len(body) > MAX_ANSWER:
        assert rejected(propose(reply_of(body))).stage is RejectionStage.JSON
        return
    rejection = rejected(propose(reply_of(body)))
    assert rejection.stage is stage
    assert error in rejection.error


@given(nodes())
def test_any_accepted_tree_keeps_the_limits(tree: object) -> None:
    """Any tree of the language is taken if and only if it is within the limits."""
    answer = propose(reply_of({**GOOD_TREE, "tree": to_text(tree)}))  # type: ignore[arg-type]
    assert isinstance(answer, Accepted) == within(tree, LIMITS)  # type: ignore[arg-type]
    if isinstance(answer, Accepted):
        assert answer.guidance.tree == parse(to_text(tree))  # type: ignore[arg-type]


@given(st.text() | st.text('{}[]",:0', max_size=40))
def test_no_text_does_worse_than_be_rejected(text: str) -> None:
    """The funnel raises for nothing."""
    assert isinstance(decide(Reply(text, "end_turn", USAGE)), Rejection)
    assert isinstance(propose(Reply(text, "end_turn", USAGE)), Rejection)


json_values = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(),
    lambda inner: st.lists(inner) | st.dictionaries(st.text(), inner),
    max_leaves=5,
)


@given(st.fixed_dictionaries({name: json_values | st.just(GOOD[name]) for name in GOOD}))
def test_accepted_values_have_the_declared_types(answer: dict[str, object]) -> None:
    """A decision is only made of a rate in range and of real names, for any values."""
    result = decide(reply_of(json.dumps(answer)))
    if isinstance(result, Accepted):
        assert result.guidance.mutation_rate is not None
        assert 0.1 <= result.guidance.mutation_rate <= 0.5
        assert isinstance(result.guidance.phase, Phase)
        assert isinstance(result.guidance.pattern, Pattern)


def test_texts_inside_the_json_are_made_storable() -> None:
    """JSON can spell half a character and control codes where the text around it cannot."""
    odd = r"a\ud800b\u001b[31m\u0000c"
    body = json.dumps({**GOOD, "risk": "@"}).replace("@", odd)
    accepted = decide(reply_of(body))
    assert isinstance(accepted, Accepted)
    assert accepted.guidance.risk == "a?b [31m c"
    tree = json.dumps({**GOOD_TREE, "tree": "@"}).replace("@", odd)
    rejected(propose(reply_of(tree))).error.encode()


def test_the_decision_schema() -> None:
    """The schema as it is sent, whole."""
    assert schema(DecisionAnswer)["properties"] == {
        "mutation_rate": {"type": "number"},
        "phase": {"type": "string", "enum": [p.value for p in Phase]},
        "pattern": {"type": "string", "enum": [p.value for p in Pattern]},
        "intervention": {"type": "boolean"},
        "risk": {"type": "string"},
        "reasoning": {"type": "string"},
    }


DRAFT = {**GOOD, "mutation_rate": 0.11}


@pytest.mark.parametrize(
    "text",
    [
        f"A draft: {json.dumps(DRAFT)}. Better: {json.dumps(GOOD)}",
        f"{json.dumps(GOOD)} In it, {{'mutation_rate': 0.3}} or {{\"mutation_rate\": 0.3}} stands.",
        f"<think>{json.dumps(DRAFT)}</think>{json.dumps(GOOD)}",
        f"{json.dumps(GOOD)} <think>or {json.dumps(DRAFT)}?",
        f"<thinking>{json.dumps(DRAFT)}</thinking>\n```json\n{json.dumps(GOOD)}\n```",
        f"so {json.dumps(DRAFT)}, no.</think>{json.dumps(GOOD)}",
        "selector { " * 30 + json.dumps(GOOD),
        "{" * 500 + json.dumps(GOOD),
    ],
)
def test_the_last_whole_answer_counts(text: str) -> None:
    """Drafts, thoughts and trees come before it, remarks after it."""
    answer = decide(reply_of(text))
    assert isinstance(answer, Accepted), answer
    assert answer.guidance.mutation_rate == 0.42


def test_a_draft_before_a_cut_is_no_answer() -> None:
    """Where the tokens ran out in the middle of the last object, the model is asked again."""
    text = f"{json.dumps(DRAFT)} Better: {json.dumps(GOOD)[:40]}"
    assert rejected(decide(reply_of(text, "max_tokens"))).stage is RejectionStage.JSON


@pytest.mark.parametrize("text", ['{"a": 1, ' * 11_000, '{"a":"' * 16_000, "{" * MAX_ANSWER])
def test_no_text_takes_long_to_read(text: str) -> None:
    """However many brackets there are."""
    began = time.process_time()
    decide(reply_of(text))
    assert time.process_time() - began < 2
