"""Asking a supervisor: at once, or by a queue while episodes run.

Its answer is checked here before anything is made of it. The queue is what the paper names as
future work (section 3.9). The lag is counted in generations and is exact: the answer to
generation g's state takes effect after generation g + lag, however long it took, so timing
never changes a record.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from concurrent.futures import Future
from dataclasses import fields
from functools import lru_cache
from math import isfinite
from queue import SimpleQueue
from threading import Thread
from typing import Any, Final

import numpy as np

from islandgp.bt.core.language import parse, to_text
from islandgp.bt.core.node import Node
from islandgp.bt.core.vocabulary import Vocabulary
from islandgp.errors import SupervisionError, TreeError
from islandgp.gp.edits import Edit
from islandgp.plugin import path_of, plugin_errors
from islandgp.scoring.state import PopulationState
from islandgp.seeding import Stream, stream
from islandgp.supervision.base import (
    GenerationListener,
    GenerationView,
    Guidance,
    Pattern,
    Phase,
    Supervisor,
    SupervisorLifecycle,
)


def ask(
    supervisor: Supervisor,
    state: PopulationState,
    rng: np.random.Generator,
    vocabulary: Vocabulary | None = None,
) -> Guidance:
    """What the supervisor advises; its tree must be in the words of the vocabulary, if given.

    Raises:
        SupervisionError: it is no guidance that a population could be given.
        PartError: a supervisor of the user's own failed.
    """
    with plugin_errors(path_of(type(supervisor))):
        found = supervisor.advise(state, rng)
    if not isinstance(found, Guidance):
        raise _wrong(supervisor, "a Guidance", found)
    for field in fields(Guidance):
        wanted, fits = WANTED[field.name]
        if not fits(value := getattr(found, field.name)):
            raise _wrong(supervisor, f"a Guidance whose {field.name} is {wanted}", value)
    if found.target is not None and found.target not in state.targets:
        wanted = f"a Guidance whose target is None or one of {', '.join(state.targets)}"
        raise _wrong(supervisor, wanted, found.target)
    if found.tree is not None and vocabulary is not None and not _in_words(found.tree, vocabulary):
        wanted = f"a Guidance whose tree is of the domain {vocabulary.domain}"
        raise _wrong(supervisor, wanted, to_text(found.tree))
    return found


def _wrong(supervisor: Supervisor, wanted: str, found: object) -> SupervisionError:
    shown = repr(found)
    return SupervisionError(
        f"Expected from the supervisor {path_of(type(supervisor))} {wanted},"
        f" found {shown if len(shown) <= 60 else shown[:60] + '...'}; mend its advise."
    )


def _is_rate(value: Any) -> bool:
    return value is None or (
        isinstance(value, (int, float)) and not isinstance(value, bool) and 0 <= value <= 1
    )


def _is_tree(value: Any) -> bool:
    """Whether the language has it: a node of a made-up kind could not be ticked or written down."""
    if not isinstance(value, Node):
        return value is None
    try:
        return _in_language(value)
    except (TreeError, LookupError, TypeError, ValueError, AttributeError):
        return False


@lru_cache(maxsize=64)  # supervisors give the same trees again
def _in_language(tree: Node) -> bool:
    return parse(to_text(tree)) == tree


def _in_words(tree: Node, vocabulary: Vocabulary) -> bool:
    try:
        parse(to_text(tree), vocabulary)
    except TreeError:
        return False
    return True


def _is_text(value: Any) -> bool:
    """Whether it can be written down; half a surrogate pair cannot."""
    return isinstance(value, str) and value.encode("utf-8", "ignore").decode("utf-8") == value


def _are_notes(value: Any) -> bool:
    return isinstance(value, dict) and all(
        _is_text(text) for pair in value.items() for text in pair
    )


def _is_count(value: Any) -> bool:
    return isinstance(value, int) and not isinstance(value, bool) and value >= 0


def _are_edits(value: Any) -> bool:
    return isinstance(value, tuple) and all(
        isinstance(edit, Edit)
        and all(map(_is_text, (edit.of, edit.at, edit.donor, edit.donor_at, edit.reason)))
        and _is_tree(edit.branch)
        and (edit.number is None or _is_number(edit.number))
        and isinstance(edit.term, int)
        for edit in value
    )


def _is_number(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool) and isfinite(value)


WANTED: Final[Mapping[str, tuple[str, Callable[[Any], bool]]]] = {
    # a field of Guidance: what it must be, and whether a value is that
    "mutation_rate": ("a number in [0, 1] or None", _is_rate),
    "tree": ("a tree of the language (bt.language.parse makes one of a text) or None", _is_tree),
    "source": ("a text that is not empty", lambda value: _is_text(value) and value != ""),
    "phase": ("a Phase or None", lambda value: value is None or value in list(Phase)),
    "pattern": ("a Pattern or None", lambda value: value is None or value in list(Pattern)),
    "target": ("a text or None", lambda value: value is None or _is_text(value)),
    "intervention": ("True or False", lambda value: isinstance(value, bool)),
    "risk": ("a text", _is_text),
    "reasoning": ("a text", _is_text),
    "rationale": ("a text", _is_text),
    "notes": ("a dict of texts", _are_notes),
    "edits": ("a tuple of Edits whose fields are as declared", _are_edits),
    "episodes": ("a count, 0 or more", _is_count),
}


Question = tuple[PopulationState, GenerationView | None, Future[Guidance]]


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

    def recall(self, seen: GenerationView) -> None:
        """Tells the supervisor of a generation that is not asked about; before the first `ask`."""
        if isinstance(self.supervisor, GenerationListener):
            with plugin_errors(path_of(type(self.supervisor))):
                self.supervisor.on_generation(seen)

    def ask(self, state: PopulationState, seen: GenerationView | None = None) -> None:
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
        if not isinstance(self.supervisor, SupervisorLifecycle):
            return {}
        with plugin_errors(path_of(type(self.supervisor))):
            return self.supervisor.spent()

    def close(self) -> None:
        """Forgets what is still asked, and lets the supervisor go."""
        for answer in self._asked.values():
            answer.cancel()
        self._waiting.put(None)
        if isinstance(self.supervisor, SupervisorLifecycle):
            with plugin_errors(path_of(type(self.supervisor))):
                self.supervisor.close()

    def _advise(self, state: PopulationState, seen: GenerationView | None) -> Guidance:
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
