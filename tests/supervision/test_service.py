"""Supervisors that hold something open: what a run does with them besides asking."""

from __future__ import annotations

from contextlib import closing
from typing import Any

import numpy as np
import pytest

from islandgp.errors import PartError, SupervisionError
from islandgp.evolution.loop import evolve
from islandgp.scoring.state import PopulationState
from islandgp.supervision.base import Guidance
from tests.evolution.fake import Fake
from tests.evolution.runs import Constant, plan, run


class Serves(Constant):
    """A supervisor that counts its questions."""

    def __init__(self) -> None:
        super().__init__()
        self.closed = 0

    def start(self) -> str:
        """See `SupervisorLifecycle`."""
        return "ready"

    def spent(self) -> dict[str, float]:
        """See `SupervisorLifecycle`."""
        return {"questions": float(len(self.states))}

    def close(self) -> None:
        """See `SupervisorLifecycle`."""
        self.closed += 1


def test_what_was_spent_is_in_each_generation_s_cost() -> None:
    """As sums from the start; empty for a supervisor that takes nothing."""
    costs = [step.cost.llm for step in run(supervisor=Serves())]
    assert costs == [{"questions": float(min(g + 1, 7))} for g in range(8)]
    assert all(step.cost.llm == {} for step in run())


@pytest.mark.parametrize(
    ("costs", "found"),
    [
        (None, "found None; correct it"),
        ({"eur": "much"}, "found eur='much': input should be a valid number; correct it"),
        ({"eur": float("nan")}, "found eur=nan: input should be a finite number; correct it"),
    ],
)
def test_costs_are_finite_numbers(costs: Any, found: str) -> None:
    """Others end the run with one message; they would be a damaged line in its folder."""

    class Careless(Serves):
        def spent(self) -> dict[str, float]:
            return costs  # type: ignore[no-any-return] # wrong types are what is tested

    expected = rf"Careless\.spent to return finite numbers by name, {found}"
    with pytest.raises(SupervisionError, match=expected):
        run(supervisor=Careless())


def test_a_run_closes_its_service_once() -> None:
    """At its end, and as well when it is left in the middle."""
    finished, interrupted = Serves(), Serves()
    run(supervisor=finished)
    with closing(evolve(plan(), 1, interrupted, Fake())) as steps:
        next(steps)
    assert (finished.closed, interrupted.closed) == (1, 1)


def test_no_question_without_a_generation_for_its_answer() -> None:
    """An answer that would take effect after the last generation is not asked for."""
    supervisor = Constant()
    steps = run(plan(), supervisor)
    asked_at = [step.record.guidance.asked_at for step in steps if step.record.guidance is not None]
    assert [s.now.generation for s in supervisor.states] == asked_at == list(range(7))


def test_an_error_of_a_supervisor_reaches_the_run() -> None:
    """Any exception ends the run and names the class."""

    class Fails(Constant):
        def advise(self, state: PopulationState, rng: np.random.Generator) -> Guidance:
            if state.now.generation == 1:
                raise LookupError("no such answer")
            return super().advise(state, rng)

    with pytest.raises(PartError, match=r"Fails failed .LookupError: no such answer") as excinfo:
        run(plan(), Fails())
    assert isinstance(excinfo.value.__cause__, LookupError)
