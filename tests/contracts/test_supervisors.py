"""What every supervisor guarantees.

A new supervisor is one entry of MAKERS.
"""

from __future__ import annotations

from collections.abc import Callable
from copy import deepcopy
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given
from hypothesis import strategies as st

from islandgp.bt.core.language import parse, to_text
from islandgp.bt.core.node import within
from islandgp.domains.island.vocabulary import VOCABULARY
from islandgp.records.files import dump
from islandgp.resources import resource
from islandgp.running.parts import make_supervisor, run_context
from islandgp.scoring.state import PopulationState
from islandgp.supervision.base import Guidance, Pattern, Phase, Supervisor, SupervisorLifecycle
from islandgp.supervision.expert import Expert
from islandgp.supervision.llm.calls import Calls
from islandgp.supervision.llm.message import FailureKind
from islandgp.supervision.llm.supervisor import LLM
from islandgp.supervision.replay import Replay
from studies.controls.yoked import Yoked
from studies.distillation.policy import Answer, Distilled, Policy, Question
from tests.composed import composed
from tests.llm import samples
from tests.profiles import examples
from tests.strategies import population_states
from tests.studies.configured import CONF, studied

LIMITS = composed().gp.limits


def by_configuration(name: str) -> Callable[[], Supervisor]:
    return lambda: make_supervisor(studied(f"supervisor={name}"), None)


def llm() -> LLM:
    return samples.supervisor(samples.answering())[0]


def failing_llm() -> LLM:
    return samples.supervisor(lambda request, n: samples.failed(FailureKind.SERVER))[0]  # noqa: ARG005


class Recorder:
    """A replay of answers that are recorded just before: there is a record of any state."""

    name = "replay"

    def advise(self, state: PopulationState, rng: np.random.Generator) -> Guidance:
        """The replay's answer to a state that a live supervisor has answered."""
        live = llm()
        live.advise(state, deepcopy(rng))
        live.close()
        calls = Calls(None, live.calls.transcript, live.settings, seed=0)
        return Replay(live.settings, live.context, calls).advise(state, rng)


def yoked() -> Yoked:
    tree = parse("PatrolWaypoint")
    guidance = Guidance(
        0.25, tree, "yoked", Phase.REFINEMENT, None, "pickup", notes={"led_by": "x"}
    )
    return Yoked([guidance] * 41)


def distilled() -> Distilled:
    """A policy of one question each."""
    ends = [Answer(answer=rate, cases=1) for rate in (0.2, 0.4)]
    policy = Policy(
        format=1,
        teacher="me",
        target=Answer(answer="charging", cases=1),
        rate=Question(feature="diversity", at_most=0.5, yes=ends[0], no=ends[1]),
        report={},
    )
    expert = make_supervisor(composed("supervisor=expert"), None)
    assert isinstance(expert, Expert)
    return Distilled(policy, expert)


MAKERS: dict[str, Callable[[], Supervisor]] = {
    "baseline": by_configuration("baseline"),
    "expert": by_configuration("expert"),
    "editor": by_configuration("editor"),
    "editor_random_branch": by_configuration("editor_random_branch"),
    "editor_random_tree": by_configuration("editor_random_tree"),
    "editor_constant": by_configuration("editor_constant"),
    "fixed": by_configuration("fixed"),
    "untargeted": by_configuration("untargeted"),
    "llm": llm,
    "llm, nobody answers": failing_llm,
    "replay": Recorder,
    "yoked": yoked,
    "distilled": distilled,
}

every_supervisor = pytest.mark.parametrize("name", MAKERS)
some_states = examples(
    max_examples=15, suppress_health_check=[HealthCheck.too_slow], database=None, deadline=None
)


@every_supervisor
@some_states
@given(state=population_states(), seed=st.integers(0, 2**32 - 1))
def test_guidance_is_of_the_promised_kind(name: str, state: PopulationState, seed: int) -> None:
    """A rate in [0, 1] or none, a tree within the limits or none, and the paper's names.

    Texts and notes go through JSON and UTF-8; a tree goes through its text. The same state and
    draws give the same guidance, also from another instance, and the state stays as it was.
    """
    before = deepcopy(state)
    supervisor = MAKERS[name]()
    guidance = supervisor.advise(state, np.random.default_rng(seed))
    assert guidance.mutation_rate is None or 0 <= guidance.mutation_rate <= 1
    assert guidance.tree is None or within(guidance.tree, LIMITS)
    assert guidance.phase is None or isinstance(guidance.phase, Phase)
    assert guidance.pattern is None or isinstance(guidance.pattern, Pattern)
    assert guidance.target is None or guidance.target in state.targets
    assert guidance.source
    assert type(guidance.intervention) is bool
    texts = [guidance.source, guidance.risk, guidance.reasoning, guidance.rationale, guidance.notes]
    dump(texts).encode()
    assert all(isinstance(k, str) and isinstance(v, str) for k, v in guidance.notes.items())
    assert guidance.tree is None or parse(to_text(guidance.tree), VOCABULARY) == guidance.tree
    assert supervisor.advise(state, np.random.default_rng(seed)) == guidance
    assert MAKERS[name]().advise(state, np.random.default_rng(seed)) == guidance
    assert state == before


@every_supervisor
def test_it_has_a_name(name: str) -> None:
    """The name is what folders, records and charts call it."""
    supervisor = MAKERS[name]()
    assert supervisor.name.isidentifier()


@every_supervisor
def test_order_does_not_matter(name: str) -> None:
    """What was asked before changes no answer: a resumed run starts in the middle."""
    states = [samples.state(g) for g in (3, 9, 5)]
    straight = MAKERS[name]()
    for state in states:
        straight.advise(state, np.random.default_rng(1))
    reversed_advice = [straight.advise(s, np.random.default_rng(2)) for s in reversed(states)]
    fresh = [MAKERS[name]().advise(s, np.random.default_rng(2)) for s in reversed(states)]
    assert reversed_advice == fresh


@pytest.mark.parametrize(
    "option",
    sorted(
        p.stem for conf in (resource("conf"), CONF) for p in (conf / "supervisor").glob("*.yaml")
    ),
)
def test_every_option_can_be_chosen(option: str, tmp_path: Path) -> None:
    """Each file of the group names a class with Settings, make and a name: `local` is an llm."""
    part = studied(f"supervisor={option}").supervisor
    assert part.name == option
    assert part.factory.name == {"local": "llm"}.get(option, option)
    assert isinstance(part.settings(), part.factory.Settings)
    settings = studied(f"supervisor={option}")
    assert run_context(settings, tmp_path).folder == tmp_path


def test_services_can_be_closed_unused_and_twice() -> None:
    """A supervisor releases its resources, with or without earlier use."""
    for name, make in MAKERS.items():
        supervisor = make()
        assert isinstance(supervisor, SupervisorLifecycle) == name.startswith("llm")
        if isinstance(supervisor, SupervisorLifecycle):
            assert supervisor.spent() == {}
            supervisor.close()
            supervisor.close()
