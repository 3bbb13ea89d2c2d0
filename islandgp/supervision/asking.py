"""Calls supervisors, directly or in a thread while episodes run, and checks their answers.

The asynchronous queue is named as future work in the paper (section 3.9). The lag is a number of
generations: the guidance for the state of generation g takes effect after generation g + lag,
so records do not depend on how long a supervisor takes.
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
    """Calls a supervisor's `advise` and checks the guidance.

    Args:
        supervisor: the supervisor.
        state: of the population.
        rng: for the supervisor's draws; it is consumed.
        vocabulary: of the domain; the tree must be parsable with it. None: any names.

    Returns:
        The guidance.

    Raises:
        SupervisionError: the guidance is of the wrong type, or a field of it has a wrong value.
        PartError: a supervisor of the user failed.
    """
    with plugin_errors(path_of(type(supervisor))):
        guidance = supervisor.advise(state, rng)
    if not isinstance(guidance, Guidance):
        raise _wrong(supervisor, "a Guidance", guidance)
    for field in fields(Guidance):
        wanted, fits = WANTED[field.name]
        if not fits(value := getattr(guidance, field.name)):
            raise _wrong(supervisor, f"a Guidance whose {field.name} is {wanted}", value)
    target, tree = guidance.target, guidance.tree
    if target is not None and target not in state.targets:
        wanted = f"a Guidance whose target is None or one of {', '.join(state.targets)}"
        raise _wrong(supervisor, wanted, target)
    if tree is not None and vocabulary is not None and not _in_words(tree, vocabulary):
        wanted = f"a Guidance whose tree is of the domain {vocabulary.domain}"
        raise _wrong(supervisor, wanted, to_text(tree))
    return guidance


def _wrong(supervisor: Supervisor, wanted: str, value: object) -> SupervisionError:
    shown = repr(value)
    return SupervisionError(
        f"Expected {path_of(type(supervisor))}.advise to return {wanted},"
        f" found {shown if len(shown) <= 60 else shown[:60] + '...'}; correct it."
    )


def _is_rate(value: Any) -> bool:
    return value is None or (
        isinstance(value, (int, float)) and not isinstance(value, bool) and 0 <= value <= 1
    )


def _is_tree(value: Any) -> bool:
    """True if a node survives printing and parsing; nodes of unknown kinds do not."""
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
    """True if a text can be encoded as UTF-8; half a surrogate pair cannot."""
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
    """Calls `advise` in a thread; its guidance takes effect `lag` generations later.

    States are processed in order. With lag 0 `advise` is called directly, without a thread.
    """

    def __init__(
        self,
        supervisor: Supervisor,
        *,
        seed: int,
        lag: int,
        vocabulary: Vocabulary | None = None,
    ) -> None:
        """Starts the thread.

        Args:
            supervisor: the supervisor.
            seed: of the run, for the supervisor's random stream.
            lag: generations, >= 0.
            vocabulary: of the domain, as for `ask`.
        """
        self.supervisor = supervisor
        self.vocabulary = vocabulary
        self.seed = seed
        self.lag = lag
        self._asked: dict[int, Future[Guidance]] = {}  # by generation
        self._waiting: SimpleQueue[Question | None] = SimpleQueue()
        if lag:
            # A daemon thread, so that an unfinished `advise` does not keep the process alive.
            Thread(target=self._work, name="supervisor", daemon=True).start()

    def recall(self, seen: GenerationView) -> None:
        """Passes a recorded generation to the supervisor; before the first `ask`."""
        if isinstance(self.supervisor, GenerationListener):
            with plugin_errors(path_of(type(self.supervisor))):
                self.supervisor.on_generation(seen)

    def ask(self, state: PopulationState, seen: GenerationView | None = None) -> None:
        """Requests guidance for a generation's state; `seen` is the generation as recorded."""
        answer: Future[Guidance] = Future()
        self._asked[state.now.generation] = answer
        if self.lag:
            self._waiting.put((state, seen, answer))
        else:
            answer.set_result(self._advise(state, seen))

    def answer(self, generation: int) -> Guidance | None:
        """Waits for the guidance that takes effect after a generation; None in the first `lag`."""
        answer = self._asked.pop(generation - self.lag, None)
        return answer.result() if answer is not None else None

    def spent(self) -> dict[str, float]:
        """The costs of supervision so far, by name; empty for a supervisor without any."""
        if not isinstance(self.supervisor, SupervisorLifecycle):
            return {}
        with plugin_errors(path_of(type(self.supervisor))):
            return self.supervisor.spent()

    def close(self) -> None:
        """Cancels pending requests and closes the supervisor."""
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
            except BaseException as error:  # raised again by `answer`
                answer.set_exception(error)
