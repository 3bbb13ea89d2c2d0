"""Asynchronous supervision: answers are worked out while the next episodes run.

The paper names it as future work (section 3.9). The lag is counted in
generations and is exact: the answer to generation g's state takes effect after
generation g + lag, however long it took, so timing never changes a record.
"""

from __future__ import annotations

from concurrent.futures import Future, ThreadPoolExecutor

from islandgp.scoring.state import PopulationState
from islandgp.seeding import Stream, stream
from islandgp.supervision.base import Guidance, Supervisor


class Desk:
    """Where states are handed in and answers fetched."""

    def __init__(self, supervisor: Supervisor, *, seed: int, lag: int) -> None:
        self.supervisor = supervisor
        self.seed = seed
        self.lag = lag
        self._asked: dict[int, Future[Guidance]] = {}  # by generation
        self._thread = ThreadPoolExecutor(1, "supervisor") if lag else None

    def ask(self, state: PopulationState) -> None:
        """Hands a generation's state to the supervisor."""
        generation = state.now.generation
        rng = stream(self.seed, Stream.SUPERVISION, generation=generation)
        if self._thread is not None:
            self._asked[generation] = self._thread.submit(self.supervisor.advise, state, rng)
            return
        answer: Future[Guidance] = Future()
        answer.set_result(self.supervisor.advise(state, rng))
        self._asked[generation] = answer

    def answer(self, generation: int) -> Guidance | None:
        """What takes effect after `generation`: waits for it, None in the first `lag` ones."""
        answer = self._asked.pop(generation - self.lag, None)
        return answer.result() if answer is not None else None

    def close(self) -> None:
        """Forgets what is still asked."""
        if self._thread is not None:
            self._thread.shutdown(wait=False, cancel_futures=True)
