"""Asynchronous supervision: exact in generations, for any time in seconds."""

from __future__ import annotations

from collections.abc import Sequence
from threading import Event

import numpy as np
import pytest

from islandgp.domain import Outcome
from islandgp.errors import SupervisionError
from islandgp.evaluation.base import Job
from islandgp.scoring.state import PopulationState
from islandgp.supervision.base import Guidance, Supervisor
from islandgp.supervision.guidance import SupervisorQueue
from tests.evolution.fake import Fake
from tests.evolution.runs import lines, plan, records, run
from tests.samples import snapshot, state

PATIENCE = 30  # s after which a test gives up


class Counts:
    """Wants rate 0.01 * generation, so that a rate shows which state it answers."""

    name = "counts"

    def advise(self, state: PopulationState, rng: np.random.Generator) -> Guidance:
        """See `Supervisor`."""
        notes = {"draw": str(rng.random())}
        return Guidance(0.01 * state.now.generation, None, self.name, notes=notes)


class Waits(Counts):
    """Answers generation g only when `ready[g]` is set."""

    def __init__(self, generations: int) -> None:
        self.ready = [Event() for _ in range(generations)]

    def advise(self, state: PopulationState, rng: np.random.Generator) -> Guidance:
        """See `Supervisor`."""
        if not self.ready[state.now.generation].wait(PATIENCE):
            raise SupervisionError("nobody evaluates while the supervisor thinks")
        return super().advise(state, rng)


class Releases(Fake):
    """Lets the supervisor answer generation g only when g + lag is being evaluated."""

    def __init__(self, waits: Waits, lag: int) -> None:
        super().__init__()
        self.waits = waits
        self.lag = lag

    def evaluate(self, jobs: Sequence[Job]) -> list[Outcome]:
        """See `Evaluator`."""
        if (generation := len(self.batches) - self.lag) >= 0:
            self.waits.ready[generation].set()
        return super().evaluate(jobs)


def queue(supervisor: Supervisor, lag: int) -> SupervisorQueue:
    """A queue of seed 1."""
    return SupervisorQueue(supervisor, seed=1, lag=lag)


@pytest.mark.parametrize("lag", [0, 1, 2, 5])
def test_answers_take_effect_lag_generations_later(lag: int) -> None:
    """After generation g the answer to g - lag is applied; before there is one, the rate stays."""
    history = records(run(plan(f"supervisor.lag={lag}"), Counts()))
    rates = [record.snapshot.rate for record in history[1:]]
    assert rates == [0.4 if g < lag else pytest.approx(0.01 * (g - lag)) for g in range(7)]
    states = [record.guidance.asked_at for record in history[lag:-1] if record.guidance]
    assert states == list(range(7 - lag))


@pytest.mark.parametrize("lag", [1, 3])
def test_evaluation_goes_on_meanwhile(lag: int) -> None:
    """A supervisor that answers as late as it may gives the same bytes as a quick one."""
    run_plan = plan(f"supervisor.lag={lag}")
    waits = Waits(8)
    slow = run(run_plan, waits, evaluator=Releases(waits, lag))
    assert list(lines(slow)) == list(lines(run(run_plan, Counts())))


def test_the_queue_waits_for_the_answer() -> None:
    """An answer that is due is waited for; one that is not due is not."""
    waits = Waits(2)
    lagging = queue(waits, 1)
    try:
        lagging.ask(state([snapshot(0)]))
        assert lagging.answer(0) is None
        lagging.ask(state([snapshot(0), snapshot(1)]))
        waits.ready[0].set()
        first = lagging.answer(1)
        assert first is not None
        assert first.mutation_rate == 0
    finally:
        waits.ready[1].set()
        lagging.close()


@pytest.mark.parametrize("lag", [0, 2])
def test_draws_belong_to_the_generation(lag: int) -> None:
    """A supervisor's generator depends on the generation it is asked about, not on the lag."""
    lagging = queue(Counts(), lag)
    histories = [[snapshot(g) for g in range(n)] for n in range(1, 5)]
    for history in histories:
        lagging.ask(state(history))
    answers = [lagging.answer(g + lag) for g in range(4)]
    lagging.close()
    straight = queue(Counts(), 0)
    for history in histories:
        straight.ask(state(history))
    assert answers == [straight.answer(g) for g in range(4)]
    assert len({answer.notes["draw"] for answer in answers if answer}) == 4


class Fails(Counts):
    """Cannot do its work from generation 2 on."""

    def advise(self, state: PopulationState, rng: np.random.Generator) -> Guidance:
        """See `Supervisor`."""
        if state.now.generation == 2:
            raise SupervisionError("no more")
        return super().advise(state, rng)


@pytest.mark.parametrize("lag", [0, 2])
def test_errors_come_through(lag: int) -> None:
    """A supervisor's error ends the run as it is, at the moment its answer is due."""
    with pytest.raises(SupervisionError, match="no more"):
        run(plan(f"supervisor.lag={lag}"), Fails())
