"""What a generation costs, in seconds and episodes."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from time import perf_counter

from islandgp.evaluation.base import Evaluator
from islandgp.evolution.record import Cost


class Meter:
    """Made when a generation begins; what no `part` claims is the operators'."""

    def __init__(self, evaluator: Evaluator) -> None:
        self._evaluator = evaluator
        self._before = evaluator.simulated
        self._began = perf_counter()
        self._spent = {"evaluation": 0.0, "supervision": 0.0}

    @contextmanager
    def part(self, name: str) -> Iterator[None]:
        """Counts the seconds inside for "evaluation" or "supervision"."""
        began = perf_counter()
        yield
        self._spent[name] += perf_counter() - began

    def cost(self, *, episodes: int, llm: dict[str, float]) -> Cost:
        """What the generation took until now."""
        return Cost(
            **self._spent,
            operators=perf_counter() - self._began - sum(self._spent.values()),
            episodes=episodes,
            simulated=self._evaluator.simulated - self._before,
            llm=llm,
        )
