"""The queue between evolution and a supervisor, which may answer while episodes run.

The paper names it as future work (section 3.9). The lag is counted in
generations and is exact: the answer to generation g's state takes effect after
generation g + lag, however long it took, so timing never changes a record.
"""

from __future__ import annotations

from concurrent.futures import Future
from queue import SimpleQueue
from threading import Thread

from islandgp.bt.vocabulary import Vocabulary
from islandgp.plugin import blaming, path_of
from islandgp.scoring.state import PopulationState
from islandgp.seeding import Stream, stream
from islandgp.supervision.asking import ask
from islandgp.supervision.base import Guidance, Seen, Service, Supervisor, Witness

Question = tuple[PopulationState, Seen | None, Future[Guidance]]


class SupervisorQueue:
    """Runs `advise` in a thread; answers apply `lag` generations later.

    States are answered in their order. With lag 0 they are answered at once, without a thread.
    """

    def __init__(
        self,
        supervisor: Supervisor,
        *,
        seed: int,
        lag: int,
        vocabulary: Vocabulary | None = None,
    ) -> None:
        """With a vocabulary, trees in other words are refused: see `ask`."""
        self.supervisor = supervisor
        self.vocabulary = vocabulary
        self.seed = seed
        self.lag = lag
        self._asked: dict[int, Future[Guidance]] = {}  # by generation
        self._waiting: SimpleQueue[Question | None] = SimpleQueue()
        if lag:
            # A daemon: a slow answer that is not waited for must not keep the process from ending.
            Thread(target=self._work, name="supervisor", daemon=True).start()

    def recall(self, seen: Seen) -> None:
        """Tells the supervisor of a generation that is not asked about; before the first `ask`."""
        if isinstance(self.supervisor, Witness):
            with blaming(path_of(type(self.supervisor))):
                self.supervisor.see(seen)

    def ask(self, state: PopulationState, seen: Seen | None = None) -> None:
        """Hands a generation's state to the supervisor, and what else is known of it."""
        answer: Future[Guidance] = Future()
        self._asked[state.now.generation] = answer
        if self.lag:
            self._waiting.put((state, seen, answer))
        else:
            answer.set_result(self._advise(state, seen))

    def answer(self, generation: int) -> Guidance | None:
        """What takes effect after `generation`: waits for it, None in the first `lag` ones."""
        answer = self._asked.pop(generation - self.lag, None)
        return answer.result() if answer is not None else None

    def spent(self) -> dict[str, float]:
        """What supervision has taken so far, by name; empty for a supervisor that takes nothing."""
        if not isinstance(self.supervisor, Service):
            return {}
        with blaming(path_of(type(self.supervisor))):
            return self.supervisor.spent()

    def close(self) -> None:
        """Forgets what is still asked, and lets the supervisor go."""
        for answer in self._asked.values():
            answer.cancel()
        self._waiting.put(None)
        if isinstance(self.supervisor, Service):
            with blaming(path_of(type(self.supervisor))):
                self.supervisor.close()

    def _advise(self, state: PopulationState, seen: Seen | None) -> Guidance:
        if seen is not None:
            self.recall(seen)
        rng = stream(self.seed, Stream.SUPERVISION, generation=state.now.generation)
        return ask(self.supervisor, state, rng, self.vocabulary)

    def _work(self) -> None:
        while (next_one := self._waiting.get()) is not None:
            state, seen, answer = next_one
            if not answer.set_running_or_notify_cancel():
                continue
            try:
                answer.set_result(self._advise(state, seen))
            except BaseException as error:  # raised again where the answer is fetched
                answer.set_exception(error)
