"""policy.candidates: several trees of one answer, of which the best for its target is injected."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from islandgp.bt.core.language import parse, to_text
from islandgp.bt.core.node import Limits, Node
from islandgp.domain import Domain, Outcome
from islandgp.domains.island.vocabulary import VOCABULARY
from islandgp.errors import SupervisionError
from islandgp.resources import resource
from islandgp.supervision.base import Guidance, RunContext
from islandgp.supervision.llm.answers import Accepted, Rejection, RejectionStage, check_proposal
from islandgp.supervision.llm.episode import try_out
from islandgp.supervision.llm.questions import Questions
from tests.llm.samples import advise, answering, context, reply_of, settings, state, supervisor
from tests.llm.server import MessagesServer
from tests.llm.test_prompts import CAPABILITIES
from tests.llm.test_whole_run import lines, live, replayed
from tests.samples import CLASSES, outcome

PATROL, CHARGE, PICK = "PatrolWaypoint\n", "ExecuteCharge\n", "PickupGarbage\n"
OUTCOMES = {
    PATROL: outcome(components={"garbage": 900.0}),
    CHARGE: outcome(components={"garbage": 100.0}, charges=3.0, pickups=1.0),
    PICK: outcome(components={"garbage": 500.0}, pickups=2.0),
}
TREES = tuple(parse(text) for text in OUTCOMES)


def candidate(target: str) -> Guidance:
    """The first candidate for a target."""
    return Guidance(None, TREES[0], "llm", target=target)


class Scripted:
    """A domain whose outcomes are written down."""

    def __init__(self, domain: Domain) -> None:
        self.schema, self.step_s = domain.schema, domain.step_s
        self.seeds: list[int] = []

    def run_episode(
        self, tree: Node, seed: int, weights: Mapping[str, float], observer: Any = None
    ) -> Outcome:
        """See `Domain`."""
        assert weights
        assert observer is None
        self.seeds.append(seed)
        return OUTCOMES[to_text(tree)]


def scripted() -> tuple[RunContext, Scripted]:
    run_context = context()
    domain = Scripted(run_context.domain)
    return replace(run_context, domain=domain, domain_in=lambda _: domain), domain  # type: ignore[arg-type,return-value] # it makes no other


@pytest.mark.parametrize(
    ("target", "best"),
    [
        ("charging", CHARGE),
        ("pickup", PICK),
        ("rare", CHARGE),  # charging is the rarest of the state
        ("integration", CHARGE),
        ("exploration", PATROL),
        ("humanoid", PATROL),  # none of them takes anything over: points decide
    ],
)
def test_the_best_for_its_target(target: str, best: str) -> None:
    """Its behaviour first, then points; all are tried in one world."""
    run_context, domain = scripted()
    selected, trial, _ = try_out(candidate(target), TREES[1:], state(), run_context)
    assert selected.tree is not None
    assert to_text(selected.tree) == best
    assert trial.episodes == 3
    assert trial.gain == OUTCOMES[best].fitness - OUTCOMES[PATROL].fitness
    assert len(domain.seeds) == 3
    assert len(set(domain.seeds)) == 1


def test_each_generation_has_its_trial_world() -> None:
    """Another generation has another one, the same generation the same."""
    run_context, domain = scripted()
    for generation in (3, 3, 4):
        try_out(candidate("pickup"), TREES[1:2], state(generation), run_context)
    first, repeated, later = domain.seeds[::2]
    assert first == repeated != later


def test_a_trial_has_the_world_of_the_stage_that_the_tree_will_join() -> None:
    """That of the next generation, not the one that `world` gives."""
    run_context, domain = scripted()
    generations: list[int] = []
    staged = replace(run_context, domain_in=lambda g: generations.append(g) or domain)  # type: ignore[func-returns-value,arg-type,return-value] # it makes no other
    try_out(candidate("pickup"), TREES[1:2], state(3), staged)
    assert generations == [4]


def checked(*trees: object, candidates: int = 3) -> Accepted | Rejection:
    reply = reply_of({"trees": list(trees), "target": "rare", "rationale": "r"})
    return check_proposal(reply, Limits(3, 5), VOCABULARY, CLASSES.targets, candidates)


def test_candidates_that_cannot_be_used_are_left_out() -> None:
    """The others stay, in their order, and the change is noted; too many are cut off."""
    accepted = checked("FlyHome", PATROL, CHARGE, PICK)
    assert isinstance(accepted, Accepted)
    assert (accepted.guidance.tree, accepted.others) == (TREES[0], TREES[1:2])
    assert accepted.change == "2 of 3 trees"


def test_if_none_can_be_used_the_first_error_is_the_reason() -> None:
    """It is the error of the repair turn."""
    rejection = checked("FlyHome", "selector {")
    assert isinstance(rejection, Rejection)
    assert rejection.stage is RejectionStage.NAMES
    for trees in ([], "x", [7]):
        reply = reply_of({"trees": trees, "target": "rare", "rationale": "r"})
        answer = check_proposal(reply, Limits(3, 5), VOCABULARY, CLASSES.targets, 2)
        assert isinstance(answer, Rejection)
        assert answer.stage is RejectionStage.FIELDS
        assert "trees: expected a list of texts, one at least" in answer.error


def test_the_question_asks_for_so_many() -> None:
    """In its text and in its schema, with both prompt sets."""
    for name in ("paper", "informed"):
        questions = Questions(settings("candidates=4", f"prompts={name}"), context())
        request = questions.request("tree", state(), CAPABILITIES)
        assert "- trees: 4 trees for the same target" in request.system
        assert '"trees": [TEXT, TEXT, ...]' in request.system
        assert request.schema is not None
        assert request.schema["properties"]["trees"]["type"] == "array"


def test_cost_and_gain_of_a_trial_are_recorded(tmp_path: Path) -> None:
    """In the record's notes and in the costs."""
    run_context, _ = scripted()
    answer = {"trees": [PATROL, CHARGE], "target": "charging", "rationale": "c"}
    llm, _ = supervisor(
        answering(tree=answer), "candidates=2", run_context=replace(run_context, folder=tmp_path)
    )
    guidance = advise(llm)
    assert guidance.tree == TREES[1]
    assert "number 2 of 2 tried in world" in guidance.notes["trial"]
    assert "3 for charging, 100 points; the first has 0 and 900" in guidance.notes["trial"]
    spent = llm.spent()
    assert (spent["trials"], spent["episodes"], spent["trial_gain"]) == (1, 2, -800)
    assert guidance.episodes == 2


def test_runs_with_candidates_repeat(tmp_path: Path) -> None:
    """Live and from the transcript: the same bytes, and real episodes."""
    short = ("gp.generations=4", "world.episode.length=20")

    def answer(request: Mapping[str, Any]) -> Any:
        if "trees" not in str(request.get("system")):
            return "no"
        return {"trees": [PATROL, PICK, "wrong"], "target": "pickup", "rationale": "r"}

    with MessagesServer(answer=answer) as server:
        steps = live(server, tmp_path / "live", *short, "supervisor.policy.candidates=3")
    assert lines(replayed(tmp_path / "live", tmp_path / "again", *short)) == lines(steps)
    assert steps[-1].cost.llm["trials"] == 3
    for step in steps[:-1]:
        assert step.record.guidance is not None
        assert "of 2 tried in world" in step.record.guidance.notes["trial"]


def test_a_user_s_prompts_must_have_the_form_of_the_answer(tmp_path: Path) -> None:
    """Without the variables of the answer's form a model would not know that it may give more."""
    for file in resource("prompts").glob("*.md"):
        text = file.read_text(encoding="utf-8").replace("{{answer}}", "an answer")
        (tmp_path / file.name).write_text(text, encoding="utf-8")
    assert Questions(settings(f"prompts={tmp_path}"), context())
    with pytest.raises(SupervisionError, match=r"Expected \{\{answer\}\} and"):
        Questions(settings(f"prompts={tmp_path}", "candidates=2"), context())
