"""Settings, setups, states and a client without a network; a test changes what it is about."""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from pathlib import Path
from threading import Lock
from typing import Any

from islandgp.running.parts import run_context
from islandgp.scoring.generation_stats import GenerationStats
from islandgp.scoring.state import PopulationState
from islandgp.seeding import Stream, stream
from islandgp.supervision.base import Guidance, RunContext
from islandgp.supervision.llm.answers import Accepted, Check, Rejection
from islandgp.supervision.llm.message import Failure, FailureKind, Reply, Request, Usage
from islandgp.supervision.llm.settings import LLMSettings
from islandgp.supervision.llm.supervisor import LLM
from tests.composed import composed
from tests.samples import CLASSES, EARLY

DECISION = {
    "mutation_rate": 0.42,
    "phase": "early_exploration",
    "pattern": "exploration_phase",
    "intervention": False,
    "risk": "a",
    "reasoning": "b",
}
PROPOSAL = {"tree": "selector { PatrolWaypoint }", "target": "rare", "rationale": "c"}
MEANS = {
    "pickups": 1.25,
    "interactions": 0.5,
    "deliveries": 0.1,
    "charges": 0.2,
    "gathered": 2.72,
    "delivered": 1.1,
    "collisions": 0.7,
    "distance": 812.42,
    "inactive": 96.6,
    "laps": 0.4,
    "battery": 31.0,
}
USAGE = Usage(input=1000, output=100)


def settings(*overrides: str) -> LLMSettings:
    """The settings of `supervisor=llm`, with overrides below `supervisor.policy`."""
    below = [f"{'+' * o.startswith('+')}supervisor.policy.{o.lstrip('+')}" for o in overrides]
    composed_settings = composed("supervisor=llm", *below)
    policy = composed_settings.supervisor.settings()
    assert isinstance(policy, LLMSettings)
    return policy


def context(folder: Path | None = None, *overrides: str) -> RunContext:
    """The context of a run with the paper's numbers."""
    composed_settings = composed("supervisor=llm", *overrides)
    return run_context(composed_settings, folder)


def snapshot(
    generation: int, best: float, *, complete: int = 0, excellent: int = 0
) -> GenerationStats:
    """A generation whose numbers all differ."""
    return GenerationStats(
        generation=generation,
        epoch=2,
        stage=0,
        fitness_max=best,
        fitness_mean=best / 8,
        fitness_sd=best / 10,
        diversity=0.5 + generation / 100,
        overlapping=0.4,
        working=0.6,
        specialists={"patrol_only": 12, "pickup": 9, "humanoid": 5, "balanced": 4},
        behaviour_counts={"pickup": 14, "humanoid": 8, "charging": 0, "clearing": 2},
        tiers={
            "excellent": excellent,
            "complete": complete,
            "full_service": complete + 1,
            "balanced_elite": complete + 2,
        },
        counters=MEANS,
        size=17.25,
        rate=0.4,
    )


def state(
    generation: int = 7, *, complete: int = 0, excellent: int = 0, ever: bool | None = None
) -> PopulationState:
    """The state after a generation of a run of 41."""
    now = snapshot(generation, 4000.4, complete=complete, excellent=excellent)
    return PopulationState(
        now=now,
        history=(snapshot(generation - 1, 3000.6), now),
        best_rose=True,
        best_rise=0.333,
        best_change=999.8,
        mean_change=124.975,
        best_trend=999.8,
        mean_trend=124.975,
        diversity_change=0.01,
        diversity_trend=0.01,
        stagnant_generations=0,
        stagnant_epochs=0.0,
        crisis="",
        diversity_warning=False,
        milestones_reached={
            "complete": bool(complete) if ever is None else ever,
            "excellent": bool(excellent) if ever is None else ever,
        },
        dominant="patrol_only",
        rarest_behaviours=("charging", "clearing", "humanoid", "pickup"),
        targets=CLASSES.targets,
        mutation_rate=0.4,
        crossover_rate=0.8,
        population=30,
        generations=41,
        multipliers=EARLY,
    )


def reply_of(value: object, stop_reason: str = "end_turn") -> Reply:
    """A reply whose text is a JSON value, or a text as it is."""
    text = value if isinstance(value, str) else json.dumps(value)
    return Reply(text, stop_reason, USAGE)


def failed(kind: FailureKind, retry_after: float | None = None) -> Failure:
    return Failure(kind, f"a made-up {kind} failure", retry_after)


Script = Callable[[Request, int], Reply | Failure]


class FakeClient:
    """Answers from a script, at once; `requests` has all requests."""

    def __init__(self, script: Script | Sequence[Reply | Failure]) -> None:
        self.script = script
        self.requests: list[Request] = []
        self._lock = Lock()

    def send(self, request: Request, *, seconds: float) -> Reply | Failure:
        """See `Client`."""
        assert seconds > 0
        with self._lock:
            self.requests.append(request)
            n = len(self.requests) - 1
            return self.script(request, n) if callable(self.script) else self.script[n]

    def requests_for(self, kind: str) -> list[Request]:
        """The requests of one kind, in their order; questions of two kinds go out together."""
        return [request for request in self.requests if kind_of(request) == kind]


def kind_of(request: Request) -> str:
    """Which question a request asks: "probe", "rate" or "tree"."""
    if "mutation_rate" not in request.system and "rationale" not in request.system:
        return "probe"
    return "tree" if '"rationale"' in request.system else "rate"


def answering(
    *,
    rate: Callable[[int], object] | object = DECISION,
    tree: Callable[[int], object] | object = PROPOSAL,
) -> Script:
    """Answers each kind of question; a callable gets how often it was asked before."""
    counts: dict[str, int] = {}

    def script(request: Request, n: int) -> Reply | Failure:  # noqa: ARG001 -- a script's form
        kind = kind_of(request)
        if kind == "probe":
            return reply_of({"greeting": "Hello."})
        answer: Any = rate if kind == "rate" else tree
        if callable(answer):
            answer = answer(counts.get(kind, 0))
        counts[kind] = counts.get(kind, 0) + 1
        return answer if isinstance(answer, (Reply, Failure)) else reply_of(answer)

    return script


def supervisor(
    script: Script | Sequence[Reply | Failure],
    *overrides: str,
    folder: Path | None = None,
    run_context: RunContext | None = None,
) -> tuple[LLM, FakeClient]:
    """A supervisor over a script, which never waits."""
    client = FakeClient(script)
    quick = ("retry.first_wait=0", "retry.longest_wait=0")
    return LLM(settings(*quick, *overrides), run_context or context(folder), client), client


def advise(llm: LLM, at: PopulationState | None = None) -> Guidance:
    """One piece of guidance, with the generator that a run would give."""
    population_state = at or state()
    return llm.advise(
        population_state, stream(0, Stream.SUPERVISION, generation=population_state.now.generation)
    )


def outcome(check: Check, reply: Reply) -> Accepted | Rejection:
    """What a check says of an answer."""
    try:
        return check(reply)
    except Rejection as rejection:
        return rejection
