"""The supervisor that asks a large language model (section 2.4), and the probe of its server.

The probe asks for a greeting and sends a JSON schema. A server that answers with JSON supports
schemas; one that answers with a greeting ignores them. If the server rejects the request, the next
one omits a parameter: the one named in the error, or else the temperature, the schema, or both.
"""

from __future__ import annotations

import logging
import os
import re
from collections.abc import Collection, Sequence
from dataclasses import asdict, replace
from typing import Any, Final

import numpy as np

from islandgp.errors import SupervisionError
from islandgp.plain import from_json
from islandgp.redaction import secrets_in, without_secrets
from islandgp.scoring.state import PopulationState
from islandgp.supervision.base import GenerationView, Guidance, RunContext
from islandgp.supervision.llm.adviser import Adviser
from islandgp.supervision.llm.answers import find_object
from islandgp.supervision.llm.calls import Calls, LiveCalls
from islandgp.supervision.llm.client import AnthropicClient
from islandgp.supervision.llm.ledger import Ledger, SweepLedger, recorded_requests
from islandgp.supervision.llm.message import (
    TRANSIENT,
    Client,
    Failure,
    FailureKind,
    Reply,
    Request,
    ServerCapabilities,
)
from islandgp.supervision.llm.services import CLOUDS, check_cloud, cloud_secrets
from islandgp.supervision.llm.settings import LLMSettings, SweepCaps, check_address
from islandgp.supervision.llm.transcript import NAME, Call, Transcript

_SYSTEM: Final = "Answer in one short sentence."
_QUESTION: Final = "Please greet me."
_SCHEMA: Final[dict[str, Any]] = {
    "type": "object",
    "properties": {"greeting": {"type": "string"}},
    "required": ["greeting"],
    "additionalProperties": False,
}


_SAMPLING: Final = re.compile(r"temperature|sampling|top[_ ][pk]\b", re.IGNORECASE)
_OUTPUT: Final = re.compile(r"output_config|output_format|schema|structured|json", re.IGNORECASE)
"""Patterns in the errors of servers that reject the temperature or the schema."""

Way = tuple[bool, float | None]
"""Whether a JSON schema is sent, and the temperature that is sent, if any."""


_WAYS = """\
Expected a key or an address for supervisor=llm, found none. There are four ways:
  1. the Anthropic API: set ANTHROPIC_API_KEY (or ANTHROPIC_AUTH_TOKEN) in the environment;
  2. a local server with the same API (Ollama, vLLM, llama.cpp):
     supervisor.policy.base_url=http://localhost:11434 supervisor.policy.model=<its model>;
  3. Amazon Bedrock, Google Vertex AI or Microsoft Foundry:
     supervisor.policy.service=bedrock, vertex or foundry (docs/llm.md, Clouds);
  4. no model: supervisor=expert works offline and free of charge, and
     supervisor=replay supervisor.policy.transcript=<a run's folder> repeats a recorded run."""


_AGAIN = "the fallback is used, and each generation tries again"


class LLM:
    """Asks a model, records every attempt, and uses the fallback without a usable answer."""

    name = "llm"
    Settings = LLMSettings

    @classmethod
    def check(cls, settings: LLMSettings, context: RunContext) -> None:  # noqa: ARG003 -- the protocol's
        """Raises SupervisionError without a valid key or address, or without a cloud's settings."""
        if settings.service != "anthropic":
            check_cloud(settings.service, settings.base_url)
            return
        key = _key(settings)
        if key is None and settings.address is None:
            raise SupervisionError(_WAYS)
        if key is not None and not key.isprintable():  # an error of a header would quote it
            raise SupervisionError(
                "Expected a key in one line, found one with line breaks or control characters; set"
                " ANTHROPIC_API_KEY to the key alone."
            )
        try:
            check_address(settings.address or "https://api.anthropic.com")
        except ValueError as error:  # `base_url` is checked with the configuration
            raise SupervisionError(f"ANTHROPIC_BASE_URL: {error}.") from None

    @classmethod
    def make(cls, settings: LLMSettings, context: RunContext) -> LLM:
        """See `Supervisor`."""
        cls.check(settings, context)
        client = AnthropicClient(
            key=_key(settings),
            base_url=settings.address,
            service=settings.service,
            secrets=(*secrets_in(settings.extra_body), *cloud_secrets(settings.service)),
        )
        return cls(settings, context, client)

    def __init__(self, settings: LLMSettings, context: RunContext, client: Client) -> None:
        """Sends and writes nothing; `start` or the first `advise` does."""
        self.settings, self.context, self.client = settings, context, client
        self.adviser = Adviser(settings, context)
        self._calls: LiveCalls | None = None
        self._warned = False

    def start(self) -> str:
        """See `SupervisorLifecycle`. Opens the transcript and probes the server."""
        calls = self._open()
        try:
            self._check_complete(calls.transcript)
            capabilities = self._capabilities.start()
        except SupervisionError:
            self.close()
            raise
        if isinstance(capabilities, ServerCapabilities):
            dialect, server = asdict(capabilities), str(capabilities)
        else:
            dialect, server = None, f"no answer yet: {capabilities.message}; {_AGAIN}"
        if calls.transcript.start is None:
            settings = self.settings.model_dump(mode="json", exclude={"api_key"})
            settings["extra_body"] = without_secrets(settings["extra_body"])
            calls.transcript.begin({"settings": settings, "dialect": dialect})
        name, retires = self.settings.model_name, self.settings.facts.retires
        lines = [
            f"Supervised by {name} at {self.settings.place}: {server}",
            f"{name} retires on {retires}" if retires else "",
            self.adviser.questions.too_short(),
        ]
        return "\n".join(line for line in lines if line)

    def on_generation(self, generation: GenerationView) -> None:
        """See `GenerationListener`."""
        self.adviser.on_generation(generation)

    def advise(self, state: PopulationState, rng: np.random.Generator) -> Guidance:
        """See `Supervisor`. After a failure the guidance is that of the fallback.

        Raises:
            SupervisionError: no server answers and `on_outage` is "stop", or no request can
                succeed, e.g. with an invalid key.
        """
        calls = self._open()
        if calls.transcript.start is None:
            self.start()
        generation = state.now.generation
        guidance = self.adviser.advise(state, rng, calls, self._capabilities.at)
        self._warn(guidance, generation)
        played = [p.episodes for p in calls.transcript.played if p.generation == generation]
        return replace(guidance, episodes=sum(played))

    def spent(self) -> dict[str, float]:
        """See `SupervisorLifecycle`."""
        return {} if self._calls is None else self._calls.ledger.totals()

    def close(self) -> None:
        """See `SupervisorLifecycle`."""
        if self._calls is not None:
            self._calls.close()
        self.client.close()

    def _open(self) -> LiveCalls:
        if self._calls is None:
            folder, settings = self.context.folder, self.settings
            transcript = Transcript(None if folder is None else folder / NAME)
            sweep = None
            if folder is not None and settings.sweep_caps != SweepCaps():
                sweep = SweepLedger(folder.parent, settings.price, settings.sweep_caps)
            ledger = Ledger(
                transcript,
                settings.price,
                settings.caps,
                prices=settings.prices.models,
                sweep=sweep,
            )
            self._calls = LiveCalls(
                self.client,
                transcript,
                ledger,
                settings.retry.model_copy(update={"deadline": settings.deadline}),
                seed=self.context.seed,
                on_outage=settings.on_outage,
                useless=None if settings.useless is None else settings.useless.most,
            )
            self._capabilities = CapabilitiesByGeneration(settings, transcript, self._calls)
        return self._calls

    def _check_complete(self, transcript: Transcript) -> None:
        """Raises SupervisionError if requests of the run are missing in its transcript.

        The ledger is computed from them; without them the caps would start again at 0.
        """
        if transcript.path is None:
            return
        attempts, unanswered = transcript.requests()
        expected, count = recorded_requests(transcript.path.parent), len(attempts) + len(unanswered)
        if count < expected:
            raise SupervisionError(
                f"Expected the {expected} requests that the run's costs.jsonl counts in"
                f" {transcript.path}, found {count}: the caps would start again at 0. Restore the"
                " transcript, or start the run again with resume=never."
            )

    def _warn(self, guidance: Guidance, generation: int) -> None:
        """Logs one warning when the model is no longer asked; records have it each time."""
        final = ("fallback: budget: ", "fallback: useless: ")
        reasons = [note for note in guidance.notes.values() if note.startswith(final)]
        if reasons and not self._warned:
            self._warned = True
            logging.getLogger("islandgp").warning(
                "Supervision continues with the fallback from generation %d: %s",
                generation,
                reasons[0].split(": ", 2)[2],
            )


def _key(settings: LLMSettings) -> str | None:
    """The API key or token, without surrounding white space; None if there is none.

    The API accepts both in the same header.
    """
    configured = settings.api_key.get_secret_value() if settings.api_key is not None else ""
    variables = ("ANTHROPIC_API_KEY", "ANTHROPIC_AUTH_TOKEN")
    keys = (configured, *(os.environ.get(name, "") for name in variables))
    return next((key.strip() for key in keys if key.strip()), None)


class CapabilitiesByGeneration:
    """The server's capabilities by generation.

    A run that starts while the server is busy probes it in each generation until it answers.
    """

    def __init__(self, settings: LLMSettings, transcript: Transcript, calls: Calls) -> None:
        self.settings, self.transcript, self.calls = settings, transcript, calls

    def start(self) -> ServerCapabilities | Failure:
        """The capabilities at a run's start, from the transcript or by a probe."""
        if self.transcript.start is not None:
            recorded = self._known(self.transcript.learnt[0] if self.transcript.learnt else 0)
            return recorded or Failure(FailureKind.OVERLOADED, "none when the run was stopped")
        return probe_capabilities(self.calls, self.settings)

    def at(self, generation: int) -> ServerCapabilities | Failure:
        """The capabilities for the requests of a generation; a failure if there is no answer yet.

        Raises:
            SupervisionError: as `probe_capabilities`.
        """
        if (recorded := self._known(generation)) is not None:
            return recorded
        capabilities = probe_capabilities(self.calls, self.settings, generation)
        if isinstance(capabilities, ServerCapabilities) and self.transcript.learnt is None:
            self.transcript.learn(generation, asdict(capabilities))
        return capabilities

    def _known(self, generation: int) -> ServerCapabilities | None:
        start, learnt = self.transcript.start, self.transcript.learnt
        if start is not None and start["dialect"] is not None:
            return from_json(ServerCapabilities, start["dialect"])
        if learnt is None or learnt[0] > generation:
            return None
        return from_json(ServerCapabilities, learnt[1])


def probe_capabilities(
    calls: Calls, settings: LLMSettings, generation: int = -1
) -> ServerCapabilities | Failure:
    """Probes the server with at most four calls.

    Args:
        calls: to make the requests with.
        settings: of the model.
        generation: to which the calls belong in the transcript; -1: the start of the run.

    Returns:
        The capabilities, or a transient failure.

    Raises:
        SupervisionError: no request of this run can succeed: the key, the model or the address
            is wrong, or at the start of the run no server listens there.
    """
    untried, named = _parameter_choices(settings), frozenset[str]()
    turn = 0
    while True:
        structured, temperature = mode = _best(untried, named)
        request = Request(
            settings.model_name,
            _SYSTEM,
            (_QUESTION,),
            settings.reply_tokens,
            temperature,
            _SCHEMA if structured else None,
            thinking=settings.thinking_value,
            effort=settings.effort,
            extra=settings.extra_body,
        )
        answer = calls.ask(Call(generation, "probe", turn), request)
        if isinstance(answer, Reply):
            if settings.output == "auto" and structured and answer.text:
                structured = find_object(answer.text, ["greeting"]) is not None
            return ServerCapabilities(structured, temperature, "as the probe found")
        if generation < 0 and answer.kind is FailureKind.UNREACHABLE:
            raise _hopeless(answer, settings)
        if answer.kind in TRANSIENT or answer.kind is FailureKind.BUDGET:
            return answer
        untried.remove(mode)
        if answer.kind is not FailureKind.REJECTED or not untried:
            raise _hopeless(answer, settings)
        named, turn = _named(answer.message, named), turn + 1


def _parameter_choices(settings: LLMSettings) -> list[Way]:
    """The combinations of parameters to try, the best first; a schema is preferred."""
    schemas = {"auto": (True, False), "structured": (True,), "text": (False,)}[settings.output]
    heats = dict.fromkeys((settings.temperature, None))
    return [(structured, heat) for structured in schemas for heat in heats]


def _named(refusal: str, before: frozenset[str]) -> frozenset[str]:
    """The parameters named in the errors so far: "temperature", "schema".

    The wording of errors is not standardised, so the result only orders the next attempts. An
    error that names neither or both parameters resets it.
    """
    matches = {"temperature": _SAMPLING.search(refusal), "schema": _OUTPUT.search(refusal)}
    new = {name for name, match in matches.items() if match}
    return before | new if len(new) == 1 else frozenset()


def _best(untried: Sequence[Way], named: Collection[str]) -> Way:
    """The first combination with the fewest parameters named in errors."""
    return min(
        untried,
        key=lambda mode: (
            ("schema" in named and mode[0]) + ("temperature" in named and mode[1] is not None)
        ),
    )


def _hopeless(failure: Failure, settings: LLMSettings) -> SupervisionError:
    cloud = CLOUDS.get(settings.service)
    address = settings.address or ""
    openai = (
        "a server with OpenAI's API only needs LiteLLM's proxy in front of it, see"
        " docs/llm.md, Any model"
    )
    remedy = {
        FailureKind.UNAUTHORISED: (
            "set another ANTHROPIC_API_KEY" if cloud is None else f"set {cloud.credentials}"
        ),
        FailureKind.FOREIGN: openai,
        FailureKind.NOT_FOUND: (
            f"drop /v1 from the address, as in {address.rstrip('/').removesuffix('/v1')}"
            if address.rstrip("/").endswith("/v1")
            else "set supervisor.policy.model, or supervisor.policy.base_url"
            + ("" if "model" in failure.message.lower() else f"; {openai}")
        ),
        FailureKind.UNREACHABLE: "start the server, or set supervisor.policy.base_url",
        FailureKind.UNTRUSTED: "set SSL_CERT_FILE to the certificate of its authority",
    }.get(failure.kind, "see the server's message, or use supervisor=expert, which needs no server")
    return SupervisionError(
        f"Expected an answer of the model {settings.model_name} from {settings.place}, found"
        f" {failure.kind} ({failure.message}); {remedy}."
    )
