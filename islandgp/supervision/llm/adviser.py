"""Asks for the parts of the guidance, and combines the answers (section 2.4).

The guidance is a function of the state, the settings and the answers, which come from the network
or a transcript. So a replay uses the same code as the recorded run.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from functools import partial
from typing import Any, Final

import numpy as np

from islandgp.errors import SupervisionError
from islandgp.plugin import path_of, plugin_errors
from islandgp.scoring.state import PopulationState
from islandgp.supervision.base import GenerationView, Guidance, RunContext, Supervisor
from islandgp.supervision.guidance import ask
from islandgp.supervision.llm.answers import DecisionAnswer
from islandgp.supervision.llm.calls import Calls, Conversation, converse, in_thread, unasked
from islandgp.supervision.llm.message import (
    CHARGED,
    Failure,
    FailureKind,
    Request,
    ServerCapabilities,
)
from islandgp.supervision.llm.probe import capabilities_in
from islandgp.supervision.llm.questions import Questions
from islandgp.supervision.llm.settings import LLMSettings
from islandgp.supervision.llm.transcript import Played

REASON: Final = 600  # most characters of a fallback's reason in the record
FIELDS: Final = {
    "rate": [*DecisionAnswer.model_fields],
    "tree": ["tree", "target", "rationale"],
    "edits": ["edits"],
}
"""Fields of the guidance by the part that sets them."""


class Adviser:
    """Asks for a rate, a tree and edits, and combines the answers to a guidance."""

    def __init__(self, settings: LLMSettings, context: RunContext) -> None:
        """Makes the questions and the fallback. Raises SupervisionError as `Questions`."""
        self.settings, self.context = settings, context
        self.questions = Questions(settings, context)
        component = settings.fallback
        with plugin_errors(path_of(component.factory)):
            self.fallback: Supervisor = component.factory.make(component.settings(), context)

    def advise(self, state: PopulationState, rng: np.random.Generator, calls: Calls) -> Guidance:
        """Asks for all parts of the guidance; the fallback provides those without a usable answer.

        `rng` is consumed by the fallback.

        Raises:
            SupervisionError: too many unusable answers in a row, with `useless.then` "stop".
        """
        generation, questions = state.now.generation, self.questions
        server = self._given_up(calls, generation) or capabilities_in(
            generation, calls, self.settings
        )
        if isinstance(server, Failure):
            answers = {part: unasked(calls, generation, part, server) for part in questions.parts}
        else:
            answers = self._answers(state, calls, server)
            if episodes := questions.run_values(state).episodes:
                calls.transcript.add(Played(generation, episodes))
        missing = sum(answer.guidance is None for answer in answers.values())
        backup = ask(self.fallback, state, rng) if missing else None
        values: dict[str, Any] = {}
        for part, answer in answers.items():
            advice = answer.guidance or (backup if part != "edits" else None)
            if advice is not None:
                values |= {name: getattr(advice, name) for name in FIELDS[part]}
        source = "llm" if not missing else "llm and fallback" * (missing < len(answers))
        guidance = Guidance(None, None, source or "fallback", notes=_notes(answers))
        return replace(guidance, **values)

    def on_generation(self, generation: GenerationView) -> None:
        """See `GenerationListener`."""
        self.questions.on_generation(generation)

    def _given_up(self, calls: Calls, generation: int) -> Failure | None:
        """The failure if the model is no longer asked, because of unusable answers; else None."""
        limits, useless = self.settings.useless, calls.transcript.useless_before(generation)
        if limits is None or len(useless) < limits.most:
            return None
        last = f" (the last: {useless[-1].why})" if useless[-1].failed in CHARGED else ""
        if limits.then == "stop":
            raise SupervisionError(
                f"Expected a usable answer of {self.settings.model_name}, found none to the last"
                f" {len(useless)} questions{last}; set another supervisor.policy.model, or raise"
                " supervisor.policy.useless.most."
            )
        return Failure(
            FailureKind.USELESS, f"no usable answer to {len(useless)} questions in a row{last}"
        )

    def _answers(
        self,
        state: PopulationState,
        calls: Calls,
        capabilities: ServerCapabilities,
    ) -> dict[str, Conversation]:
        """Asks for all parts at the same time, or one by one if a cap is near."""
        requests = self.questions.requests(state, capabilities)
        work = {p: partial(self._ask, p, state, calls, request) for p, request in requests.items()}
        room = calls.room_for(tuple(requests.values()), self.settings.repairs)
        # The first is asked in this thread, the others beside it.
        aside = {part: in_thread(work[part]) for part in [*work][1:] if room}
        return {part: aside[part].result() if part in aside else work[part]() for part in work}

    def _ask(
        self, part: str, state: PopulationState, calls: Calls, request: Request
    ) -> Conversation:
        questions = self.questions
        return converse(
            calls,
            state.now.generation,
            part,
            request,
            questions.check(part, state),
            repairs=self.settings.repairs,
            repair=questions.repair,
        )


def _notes(answers: Mapping[str, Conversation]) -> dict[str, str]:
    """For the record: where each part comes from, and the hash of every prompt of it."""
    notes = {}
    for name, answer in answers.items():
        end = answer.end
        notes[name] = end.source + (f": {end.why[:REASON]}" if end.why else "")
        if answer.prompts:
            notes[f"{name}_prompts"] = " ".join(answer.prompts)
        if end.rejected:
            notes[f"{name}_rejected"] = " ".join(end.rejected)
    return notes
