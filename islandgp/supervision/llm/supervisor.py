"""The supervisor that asks a large language model (section 2.4).

The guidance is a function of the state, the settings and the answers, which come from the network
or a transcript. So a replay uses the same `Adviser` as the recorded run.
"""

from __future__ import annotations

import logging
from dataclasses import replace
from typing import Any, Final

import numpy as np

from islandgp.errors import SupervisionError
from islandgp.plugin import path_of, plugin_errors
from islandgp.scoring.state import PopulationState
from islandgp.supervision.base import GenerationView, Guidance, RunContext, Supervisor
from islandgp.supervision.guidance import ask
from islandgp.supervision.llm.answers import DecisionAnswer, ModelAnswer, schema
from islandgp.supervision.llm.calls import Answer, Calls, ask_with_less, converse, supported
from islandgp.supervision.llm.client import client_of, model_file, sdk_client
from islandgp.supervision.llm.message import (
    CHARGED,
    HOPELESS,
    TRANSIENT,
    Client,
    Failure,
    FailureKind,
    Reply,
    Request,
)
from islandgp.supervision.llm.questions import Questions
from islandgp.supervision.llm.settings import LLMSettings, check_address
from islandgp.supervision.llm.transcript import NAME, Call, Conclusion, Start, Transcript

SMALL: Final = {"smollm2-135m": "135 million parameters: valid trees, little judgement"}
"""What to expect of small models."""

_WAYS: Final = (
    "Expected a key or an address for supervisor=llm, found none; set ANTHROPIC_API_KEY in the"
    " environment, or supervisor.policy.base_url and supervisor.policy.model for another server"
    " (docs/llm.md). supervisor=local runs a small model in this process, supervisor=expert works"
    " without one."
)

_OPENAI: Final = "a server with OpenAI's API only needs supervisor.policy.interface=chat"
_REMEDIES: Final = {
    FailureKind.UNREACHABLE: "start the server, or set supervisor.policy.base_url (and"
    " SSL_CERT_FILE for a certificate of your own)",
    FailureKind.NOT_FOUND: f"set supervisor.policy.model or supervisor.policy.base_url; {_OPENAI}",
    FailureKind.MALFORMED: f"set supervisor.policy.base_url; {_OPENAI}",
    FailureKind.UNAUTHORISED: "set another key (docs/llm.md, Keys)",
}

FEW: Final = 0.4  # share of a prompt's expected tokens below which it was cut
FIELDS: Final = {
    "rate": [*DecisionAnswer.model_fields],
    "tree": ["tree", "target", "rationale"],
    "edits": ["edits"],
}
"""Fields of the guidance by the part that sets them."""

_GREETING_GRAMMAR: Final = 'root ::= "{\\"greeting\\": \\"Hello.\\"}"'


class Greeting(ModelAnswer, frozen=True):
    """The answer to the probe."""

    greeting: str


class Adviser:
    """Asks for a rate, a tree and edits, and combines the answers to a guidance."""

    def __init__(self, settings: LLMSettings, context: RunContext, calls: Calls) -> None:
        """Makes the questions and the fallback. Raises SupervisionError as `Questions`."""
        self.settings, self.context, self.calls = settings, context, calls
        self.questions = Questions(settings, context)
        component = settings.fallback
        with plugin_errors(path_of(component.factory)):
            self.fallback: Supervisor = component.factory.make(component.settings(), context)

    def on_generation(self, generation: GenerationView) -> None:
        """See `GenerationListener`."""
        self.questions.on_generation(generation)

    def advise(self, state: PopulationState, rng: np.random.Generator) -> Guidance:
        """See `Supervisor`. The fallback provides the parts without a usable answer.

        `rng` is consumed by the fallback.

        Raises:
            SupervisionError: no server answers and `on_outage` is "stop", no request can succeed,
                e.g. with an invalid key, or a replay's transcript has no answer for this state.
        """
        questions = self.questions
        answers = {part: self._answer(part, state) for part in questions.parts}
        missing = sum(advice is None for advice, _ in answers.values())
        backup = ask(self.fallback, state, rng) if missing else None
        values: dict[str, Any] = {"notes": {}, "episodes": sum(questions.episodes.values())}
        for part, (advice, end) in answers.items():
            values["notes"] |= end.notes
            if (advice := advice or (backup if part != "edits" else None)) is not None:
                values |= {name: getattr(advice, name) for name in FIELDS[part]}
        source = "llm" if not missing else "llm and fallback" * (missing < len(answers))
        return replace(Guidance(None, None, source or "fallback"), **values)

    def _answer(self, part: str, state: PopulationState) -> Answer:
        """Asks for a part of the guidance, unless the model is no longer asked."""
        generation, questions = state.now.generation, self.questions
        questions.episodes[part] = 0
        if reason := self._given_up(generation, part):
            failed = reason.partition(":")[0]
            end = Conclusion(generation, part, "fallback", reason, (), failed)
            self.calls.transcript.add(end)
            return None, end
        request, check = questions.request(part, state), questions.check(part, state)
        return converse(self.calls, questions, Call(generation, part, 0), request, check)

    def _given_up(self, generation: int, part: str) -> str:
        """The reason if the model is not asked for this part of a generation; "" if it is.

        A rejected answer is useless, and so is a failure that may be charged; others are skipped.
        """
        parts, useless = self.questions.parts, 0
        for end in self.calls.transcript.parts:
            if (end.generation, parts.index(end.part)) >= (generation, parts.index(part)):
                continue  # a resumed run asks again
            if end.failed in HOPELESS:
                return end.why
            if end.source != "fallback":
                useless = 0
            elif end.rejected or end.failed in CHARGED:
                useless, last = useless + 1, end.why
        if useless < self.settings.useless:
            return ""
        found = f"no usable answer to {useless} questions in a row (the last: {last})"
        return f"{FailureKind.USELESS}: {found}"


class LLM(Adviser):
    """Asks a model, records every attempt, and uses the fallback without a usable answer."""

    name = "llm"
    Settings = LLMSettings

    @classmethod
    def check(cls, settings: LLMSettings, context: RunContext) -> None:  # noqa: ARG003 -- the protocol's
        """Raises SupervisionError without a valid key or address, or if the factory fails."""
        factory, key, address = settings.client_factory, settings.key, settings.address
        if settings.interface == "local":
            model_file(settings.model)
        elif factory is None and key is None and address is None:
            raise SupervisionError(_WAYS)
        elif key is not None and not key.isprintable():  # an error of a header would quote it
            raise SupervisionError(
                "Expected a key in one line, found one with line breaks or control characters; set"
                " ANTHROPIC_API_KEY to the key alone."
            )
        elif factory is not None or settings.interface == "chat":
            sdk_client(settings)
        if address is not None:
            try:
                check_address(address)
            except ValueError as error:  # `base_url` is checked with the configuration
                raise SupervisionError(f"ANTHROPIC_BASE_URL: {error}.") from None

    @classmethod
    def make(cls, settings: LLMSettings, context: RunContext) -> LLM:
        """See `Supervisor`."""
        cls.check(settings, context)
        return cls(settings, context, client_of(settings))

    def __init__(self, settings: LLMSettings, context: RunContext, client: Client) -> None:
        """Sends and writes nothing; `start` or the first `advise` does."""
        transcript = Transcript(None if context.folder is None else context.folder / NAME)
        super().__init__(settings, context, Calls(client, transcript, settings, seed=context.seed))
        self._warned: set[str] = set()

    def start(self) -> str:
        """See `SupervisorLifecycle`. Opens the transcript and probes the server."""
        calls, name = self.calls, self.settings.model_name
        if calls.transcript.start is None:
            try:
                server = probe(calls, self.settings)
            except SupervisionError:
                self.close()
                raise
            settings = self.settings.model_dump(mode="json", exclude={"api_key", "client_factory"})
            calls.transcript.add(Start(settings))
        else:
            server = "asked before"
        lines = [f"Supervised by {name} at {self.settings.place}: {server}", SMALL.get(name, "")]
        return "\n".join(filter(None, lines))

    def advise(self, state: PopulationState, rng: np.random.Generator) -> Guidance:
        """See `Adviser`."""
        if self.calls.transcript.start is None:
            self.start()
        guidance = super().advise(state, rng)
        self._warn(guidance, state.now.generation)
        return guidance

    def spent(self) -> dict[str, float]:
        """See `SupervisorLifecycle`."""
        return self.calls.ledger.totals() if self.calls.transcript.of_kind(object) else {}

    def close(self) -> None:
        """See `SupervisorLifecycle`. An answer that comes later is not recorded."""
        self.calls.transcript.fixed = True

    def _warn(self, guidance: Guidance, generation: int) -> None:
        """Logs two things, each once: that the model is no longer asked, and that prompts are cut.

        Records have the former each time. A server that counts far fewer tokens than a prompt must
        have cuts it.
        """
        lines = {}
        kinds = (FailureKind.BUDGET, FailureKind.USELESS, *HOPELESS)
        for _, _, reason in (note.partition("fallback: ") for note in guidance.notes.values()):
            if reason.startswith(tuple(f"{kind}: " for kind in kinds)):
                lines["given up"] = (
                    f"Supervision continues with the fallback from generation {generation}:"
                    f" {reason.partition(': ')[2]}"
                )
        last = self.calls.transcript.attempts[-1]
        expected = last.request.characters / self.settings.facts.characters
        if isinstance(last.answer, Reply) and last.usage and last.usage.read < FEW * expected:
            lines["cut"] = (
                f"{self.settings.place} may cut prompts silently: it counted {last.usage.read}"
                f" tokens of a prompt of about {expected:.0f}; enlarge its context (for Ollama"
                " OLLAMA_CONTEXT_LENGTH)"
            )
        for kind in lines.keys() - self._warned:
            logging.getLogger("islandgp").warning("%s", lines[kind])
        self._warned |= lines.keys()


def probe(calls: Calls, settings: LLMSettings) -> str:
    """Asks for a greeting; returns what the server supports, in words.

    Raises:
        SupervisionError: no request of this run can succeed: the key, the model or the address
            is wrong, or no server listens there.
    """
    request = Request(
        settings.model_name,
        "Answer in one short sentence.",
        ("Please greet me.",),
        settings.reply_tokens,
        settings.temperature,
        schema(Greeting) if settings.sends_schema else None,
        _GREETING_GRAMMAR if settings.sends_grammar else None,
    )
    request, answer = ask_with_less(calls, Call(-1, "probe", 0), request)
    if isinstance(answer, Failure):
        busy = TRANSIENT - {FailureKind.UNREACHABLE, FailureKind.MALFORMED} | {FailureKind.BUDGET}
        if answer.kind in busy and settings.on_outage != "stop":
            return f"no answer yet: {answer.message}; the fallback is used meanwhile"
        remedy = "see the server's message, or use supervisor=expert, which needs no server"
        raise SupervisionError(
            f"Expected an answer of the model {settings.model_name} from {settings.place}, found"
            f" {answer.kind} ({answer.message}); {_REMEDIES.get(answer.kind, remedy)}."
        )
    known = supported(request, calls.transcript, 0)
    if settings.output == "grammar" and known.grammar is None:
        raise SupervisionError(
            "supervisor.policy.output=grammar: expected a server that decodes by a grammar at"
            f" {settings.place}, found an answer without it; set supervisor.policy.output=auto."
        )
    output = "structured output" if known.schema else "JSON found in text"
    output = "decoding by a grammar" if known.grammar else output
    heat = "no temperature" if known.temperature is None else f"temperature {known.temperature:g}"
    return f"{output}, {heat}"
