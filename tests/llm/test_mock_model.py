"""The mock in a model's place: its judgement is a rule's, its noise and faults are seeded."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import pytest

from islandgp.bt.core.language import parse
from islandgp.domains.island.vocabulary import VOCABULARY
from islandgp.scoring.state import PopulationState
from islandgp.supervision.llm.answers import Accepted, check_decision, check_proposal
from islandgp.supervision.llm.message import Request
from islandgp.supervision.llm.questions import Questions
from tests.llm.mock_model import MockModel
from tests.llm.samples import context, reply_of, settings, state
from tests.llm.test_informed import adviser, small_run


def wire(request: Request) -> dict[str, Any]:
    """A request as it arrives at a server."""
    return {
        "system": request.system,
        "messages": [{"role": "user", "content": turn} for turn in request.turns],
    }


@pytest.fixture(scope="module")
def paper() -> Questions:
    return Questions(settings(), context())


def rate(of: Questions, at: PopulationState, model: MockModel | None = None) -> Any:
    return (model or MockModel())(wire(of.request("rate", at)))


def tree(of: Questions, at: PopulationState, model: MockModel | None = None) -> Any:
    return (model or MockModel())(wire(of.request("tree", at)))


def test_it_judges_by_the_prompt(paper: Questions) -> None:
    """Phases by quality first, rates from the prompt's own table, trees for what is missing."""
    assert rate(paper, state())["phase"] == "early_exploration"
    assert rate(paper, state(ever=True))["phase"] == "aggressive_exploration"
    assert rate(paper, state(complete=1))["phase"] == "refinement"
    assert rate(paper, state(complete=5))["phase"] == "exploitation"  # the best rises by a third
    assert rate(paper, state(complete=5))["mutation_rate"] == pytest.approx(0.117)
    assert tree(paper, state())["target"] == "charging"  # nobody does it


def test_its_answers_can_be_used(paper: Questions) -> None:
    """With both prompt sets."""
    at = small_run()[1].states[-1]
    for questions in (paper, adviser()):
        limits = questions.context.limits
        proposal = check_proposal(reply_of(tree(questions, at)), limits, VOCABULARY, at.targets)
        assert isinstance(proposal, Accepted)
        decision = check_decision(reply_of(rate(questions, at)), questions.settings.rates)
        assert isinstance(decision, Accepted)


def test_it_goes_by_fates_and_traces() -> None:
    """A target whose trees died out twice gives way; the answer is no example of the prompt."""
    other = ("world.robot.charge_below=95", "world.humanoids.count=13")
    run = (*other, "gp.trees.kinds.parallel=0.5")  # one in which trees for a target die out
    at, questions = small_run(*run)[1].states[-1], adviser(run=run)
    assert at.rarest_behaviours[0] == "humanoid"
    assert tree(questions, at)["target"] == "clearing"  # two trees for humanoid died out
    assert tree(Questions(settings(), questions.context), at)["target"] == "humanoid"
    library = questions.context.library().trees.values()
    assert parse(tree(questions, at)["tree"]) not in library


@pytest.mark.slow
def test_noise_and_faults_are_seeded(paper: Questions) -> None:
    """The same seed, the same answers; the shares are those that were asked for."""
    states = [state(g, complete=g % 4) for g in range(200)]

    def answers(**options: Any) -> list[Any]:
        return [rate(paper, at, MockModel(**options)) for at in states]

    plain = answers()
    assert plain == answers(seed=3)  # without noise the seed decides nothing
    spoilt = [a for a in answers(faults=0.3) if not isinstance(a, Mapping)]
    assert 40 < len(spoilt) < 80
    noisy = answers(noise=0.5)
    assert noisy == answers(noise=0.5)
    assert noisy != answers(noise=0.5, seed=1)
    assert 50 < sum(a != b for a, b in zip(plain, noisy, strict=True)) < 120
