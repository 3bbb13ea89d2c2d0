"""The supervisor that asks a large language model (section 2.4)."""

from __future__ import annotations

import logging
import os
from dataclasses import asdict

import numpy as np

from islandgp.errors import SupervisionError
from islandgp.redaction import secrets_in, without_secrets
from islandgp.scoring.state import PopulationState
from islandgp.supervision.base import Guidance, RunContext, Seen
from islandgp.supervision.llm.adviser import Adviser
from islandgp.supervision.llm.calls import LiveCalls
from islandgp.supervision.llm.capabilities import Dialect, Dialects
from islandgp.supervision.llm.client import AnthropicClient
from islandgp.supervision.llm.ledger import Ledger, recorded_requests
from islandgp.supervision.llm.message import Client
from islandgp.supervision.llm.settings import LLMSettings, check_address
from islandgp.supervision.llm.transcript import NAME, Transcript

_WAYS = """\
Expected a key or an address for supervisor=llm, found none. There are three ways:
  1. the Anthropic API: set ANTHROPIC_API_KEY (or ANTHROPIC_AUTH_TOKEN) in the environment;
  2. a local server that speaks its language (Ollama, vLLM, llama.cpp):
     supervisor.policy.base_url=http://localhost:11434 supervisor.policy.model=<its model>;
  3. no model: supervisor=expert works offline and free of charge, and
     supervisor=replay supervisor.policy.transcript=<a run's folder> repeats a recorded run."""


_AGAIN = "the fallback stands in, and each generation asks again"


class LLM:
    """Asks, and writes down every attempt; falls back where there is no usable answer."""

    name = "llm"
    Settings = LLMSettings

    @classmethod
    def ready(cls, settings: LLMSettings, context: RunContext) -> None:  # noqa: ARG003 -- the protocol's
        """Raises SupervisionError where there is neither a key nor an address, or a wrong one."""
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
        cls.ready(settings, context)
        client = AnthropicClient(
            key=_key(settings),
            base_url=settings.address,
            secrets=tuple(secrets_in(settings.extra_body)),
        )
        return cls(settings, context, client)

    def __init__(self, settings: LLMSettings, context: RunContext, client: Client) -> None:
        """Nothing is sent and nothing written before `start`, or the first question."""
        self.settings, self.context, self.client = settings, context, client
        self.adviser = Adviser(settings, context)
        self._calls: LiveCalls | None = None
        self._warned = False

    def start(self) -> str:
        """See `Service`: opens the transcript, and finds out how the server wants to be asked."""
        calls = self._open()
        try:
            self._check_complete(calls.transcript)
            found = self._dialects.start()
        except SupervisionError:
            self.close()
            raise
        if calls.transcript.start is None:
            settings = self.settings.model_dump(mode="json", exclude={"api_key"})
            settings["extra_body"] = without_secrets(settings["extra_body"])
            known = asdict(found) if isinstance(found, Dialect) else None
            calls.transcript.begin({"settings": settings, "dialect": known})
        place = self.settings.address or "the Anthropic API"
        name, retires = self.settings.model_name, self.settings.facts.retires
        how = found if isinstance(found, Dialect) else f"no answer yet: {found.message}; {_AGAIN}"
        lines = [
            f"Supervised by {name} at {place}: {how}",
            f"{name} retires on {retires}" if retires else "",
            self.adviser.too_short(),
        ]
        return "\n".join(line for line in lines if line)

    def see(self, generation: Seen) -> None:
        """See `Witness`."""
        self.adviser.see(generation)

    def advise(self, state: PopulationState, rng: np.random.Generator) -> Guidance:
        """See `Supervisor`. A failure ends in the fallback.

        Raises:
            SupervisionError: the settings want the run to stop, or no request of it would
                ever be answered.
        """
        calls = self._open()
        if calls.transcript.start is None:
            self.start()
        guidance = self.adviser.advise(state, rng, calls, self._dialects.at)
        self._warn(guidance, state.now.generation)
        return guidance

    def spent(self) -> dict[str, float]:
        """See `Service`."""
        return {} if self._calls is None else self._calls.ledger.totals()

    def close(self) -> None:
        """See `Service`."""
        if self._calls is not None:
            self._calls.close()
        self.client.close()

    def _open(self) -> LiveCalls:
        if self._calls is None:
            folder, how = self.context.folder, self.settings
            transcript = Transcript(None if folder is None else folder / NAME)
            ledger = Ledger(transcript, how.price, how.caps)
            self._calls = LiveCalls(
                self.client,
                transcript,
                ledger,
                how.retry.model_copy(update={"deadline": how.deadline}),
                seed=self.context.seed,
                on_outage=how.on_outage,
                useless=None if how.useless is None else how.useless.most,
            )
            self._dialects = Dialects(how, transcript, self._calls)
        return self._calls

    def _check_complete(self, transcript: Transcript) -> None:
        """Raises SupervisionError where requests of the run are missing in its transcript.

        Without them the ledger, and so the caps, would begin again.
        """
        if transcript.path is None:
            return
        made, lost = transcript.taken()
        expected, found = recorded_requests(transcript.path.parent), len(made) + len(lost)
        if found < expected:
            raise SupervisionError(
                f"Expected the {expected} requests that the run's costs.jsonl counts in"
                f" {transcript.path}, found {found}: the caps would begin again. Put the"
                " transcript back, or begin again with resume=never."
            )

    def _warn(self, guidance: Guidance, generation: int) -> None:
        """Tells once that the model is not asked any more; the record tells it every time."""
        ends = ("fallback: budget: ", "fallback: useless: ")
        said = [why for why in guidance.notes.values() if why.startswith(ends)]
        if said and not self._warned:
            self._warned = True
            logging.getLogger("islandgp").warning(
                "Supervision goes on with the fallback from generation %d: %s",
                generation,
                said[0].split(": ", 2)[2],
            )


def _key(settings: LLMSettings) -> str | None:
    """The credential, None where there is none; the API takes keys and tokens in one header.

    Space around it, such as a file's last line end, is none of it.
    """
    given = settings.api_key.get_secret_value() if settings.api_key is not None else ""
    found = (given, *(os.environ.get(n, "") for n in ("ANTHROPIC_API_KEY", "ANTHROPIC_AUTH_TOKEN")))
    return next((key.strip() for key in found if key.strip()), None)
