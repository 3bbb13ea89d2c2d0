"""The supervisor that asks a large language model (section 2.4)."""

from __future__ import annotations

import logging
import os
from dataclasses import replace
from typing import Final

import numpy as np

from islandgp.errors import SupervisionError
from islandgp.redaction import secrets_in, without_secrets
from islandgp.scoring.state import PopulationState
from islandgp.supervision.base import GenerationView, Guidance, RunContext
from islandgp.supervision.llm.adviser import Adviser
from islandgp.supervision.llm.budget import Ledger, recorded_requests
from islandgp.supervision.llm.calls import LiveCalls
from islandgp.supervision.llm.client import AnthropicClient, sdk_client
from islandgp.supervision.llm.message import Client, Failure, ServerCapabilities
from islandgp.supervision.llm.probe import capabilities_in
from islandgp.supervision.llm.settings import LLMSettings, check_address
from islandgp.supervision.llm.transcript import NAME, Start, Transcript

_WAYS: Final = """\
Expected a key or an address for supervisor=llm, found none. There are four ways:
  1. the Anthropic API: set ANTHROPIC_API_KEY (or ANTHROPIC_AUTH_TOKEN) in the environment;
  2. a local server with the same API (Ollama, vLLM, llama.cpp):
     supervisor.policy.base_url=http://localhost:11434 supervisor.policy.model=<its model>;
  3. a cloud such as Amazon Bedrock or Google Vertex AI:
     supervisor.policy.client_factory=anthropic:AsyncAnthropicBedrock (docs/llm.md, Clouds);
  4. no model: supervisor=expert works offline and free of charge, and
     supervisor=replay supervisor.policy.transcript=<a run's folder> repeats a recorded run."""


class LLM:
    """Asks a model, records every attempt, and uses the fallback without a usable answer."""

    name = "llm"
    Settings = LLMSettings

    @classmethod
    def check(cls, settings: LLMSettings, context: RunContext) -> None:  # noqa: ARG003 -- the protocol's
        """Raises SupervisionError without a valid key or address, or if the factory fails."""
        if settings.client_factory is not None:
            sdk_client(settings.client_factory, None, settings.base_url)
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
            _key(settings),
            settings.address,
            factory=settings.client_factory,
            secrets=tuple(secrets_in(settings.extra_body)),
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
            capabilities = capabilities_in(-1, calls, self.settings)
        except SupervisionError:
            self.close()
            raise
        known = capabilities if isinstance(capabilities, ServerCapabilities) else None
        if calls.transcript.start is None:
            settings = self.settings.model_dump(mode="json", exclude={"api_key", "client_factory"})
            settings["extra_body"] = without_secrets(settings["extra_body"])
            calls.transcript.add(Start(settings, known))
        server = str(capabilities)
        if isinstance(capabilities, Failure):
            server = f"no answer yet: {capabilities.message}; the fallback is used meanwhile"
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
        guidance = self.adviser.advise(state, rng, calls)
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
            self._calls = LiveCalls(
                self.client,
                transcript,
                Ledger(transcript, settings.price, settings.caps),
                settings.retry.model_copy(update={"deadline": settings.deadline}),
                seed=self.context.seed,
                on_outage=settings.on_outage,
                useless=None if settings.useless is None else settings.useless.most,
            )
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
