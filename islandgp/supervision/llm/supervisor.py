"""The supervisor that asks a large language model (section 2.4), and the probe of its server.

The probe asks for a greeting in plain words and at the same time for a JSON schema. A server that
answers with JSON keeps to schemas; one that greets does not know them. What a server refuses is
left out the next time: the parameter that its error names, else the temperature, then the schema,
then both.
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
    Dialect,
    Failure,
    FailureKind,
    Reply,
    Request,
)
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
"""What an error says that refuses the one or the other parameter."""

Way = tuple[bool, float | None]
"""With a JSON schema or not, and the temperature that is sent."""


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
        """See `SupervisorLifecycle`: open the transcript and probe the server."""
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

    def on_generation(self, generation: GenerationView) -> None:
        """See `GenerationListener`."""
        self.adviser.on_generation(generation)

    def advise(self, state: PopulationState, rng: np.random.Generator) -> Guidance:
        """See `Supervisor`. A failure ends in the fallback.

        Raises:
            SupervisionError: the settings want the run to stop, or no request of it would
                ever be answered.
        """
        calls = self._open()
        if calls.transcript.start is None:
            self.start()
        generation = state.now.generation
        guidance = self.adviser.advise(state, rng, calls, self._dialects.at)
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
            folder, how = self.context.folder, self.settings
            transcript = Transcript(None if folder is None else folder / NAME)
            sweep = None
            if folder is not None and how.sweep_caps != SweepCaps():
                sweep = SweepLedger(folder.parent, how.price, how.sweep_caps)
            ledger = Ledger(transcript, how.price, how.caps, prices=how.prices.models, sweep=sweep)
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


class Dialects:
    """How the server wants to be asked, from the generation on in which it said so.

    What a probe learns from a server that is busy is nothing: the next generation probes again.
    """

    def __init__(self, settings: LLMSettings, transcript: Transcript, calls: Calls) -> None:
        self.settings, self.transcript, self.calls = settings, transcript, calls

    def start(self) -> Dialect | Failure:
        """The dialect at a run's start, from the transcript or by a probe."""
        if self.transcript.start is not None:
            known = self._known(self.transcript.learnt[0] if self.transcript.learnt else 0)
            return known or Failure(FailureKind.OVERLOADED, "none when the run was stopped")
        return find_dialect(self.calls, self.settings)

    def at(self, generation: int) -> Dialect | Failure:
        """The dialect for a generation's questions; a failure where there is still no answer.

        Raises:
            SupervisionError: as `find_dialect`.
        """
        if (known := self._known(generation)) is not None:
            return known
        found = find_dialect(self.calls, self.settings, generation)
        if isinstance(found, Dialect) and self.transcript.learnt is None:
            self.transcript.learn(generation, asdict(found))
        return found

    def _known(self, generation: int) -> Dialect | None:
        start, learnt = self.transcript.start, self.transcript.learnt
        if start is not None and start["dialect"] is not None:
            return from_json(Dialect, start["dialect"])
        if learnt is None or learnt[0] > generation:
            return None
        return from_json(Dialect, learnt[1])


def find_dialect(calls: Calls, settings: LLMSettings, generation: int = -1) -> Dialect | Failure:
    """Asks the server, with at most four calls; a failure where it does not answer just now.

    Raises:
        SupervisionError: no request of this run would ever be answered: the key, the model or
            the address is wrong, or no server listens there at the run's start.
    """
    untried, named = _ways(settings), frozenset[str]()
    turn = 0
    while True:
        structured, temperature = way = _best(untried, named)
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
            return Dialect(structured, temperature, "as the probe found")
        if generation < 0 and answer.kind is FailureKind.UNREACHABLE:
            raise _hopeless(answer, settings)
        if answer.kind in TRANSIENT or answer.kind is FailureKind.BUDGET:
            return answer
        untried.remove(way)
        if answer.kind is not FailureKind.REJECTED or not untried:
            raise _hopeless(answer, settings)
        named, turn = _named(answer.message, named), turn + 1


def _ways(settings: LLMSettings) -> list[Way]:
    """How requests may be made, the best way first: a schema is worth more than a temperature."""
    schemas = {"auto": (True, False), "structured": (True,), "text": (False,)}[settings.output]
    heats = dict.fromkeys((settings.temperature, None))
    return [(structured, heat) for structured in schemas for heat in heats]


def _named(refusal: str, before: frozenset[str]) -> frozenset[str]:
    """The parameters that refusals name: "temperature", "schema".

    A refusal may be worded in any way, so what it seems to say only decides what is tried first.
    One that names neither, or both, says nothing, and makes what was said before doubtful.
    """
    found = {"temperature": _SAMPLING.search(refusal), "schema": _OUTPUT.search(refusal)}
    new = {name for name, match in found.items() if match}
    return before | new if len(new) == 1 else frozenset()


def _best(untried: Sequence[Way], named: Collection[str]) -> Way:
    """The first way with the fewest of the parameters that refusals name."""
    return min(
        untried,
        key=lambda way: (
            ("schema" in named and way[0]) + ("temperature" in named and way[1] is not None)
        ),
    )


def _hopeless(failure: Failure, settings: LLMSettings) -> SupervisionError:
    where = settings.address or "the Anthropic API"
    address = settings.address or ""
    openai = (
        "a server that speaks only OpenAI's language needs LiteLLM's proxy before it, see"
        " docs/llm.md, Any model"
    )
    remedy = {
        FailureKind.UNAUTHORISED: "set another ANTHROPIC_API_KEY",
        FailureKind.FOREIGN: openai,
        FailureKind.NOT_FOUND: (
            f"drop /v1 from the address, as in {address.rstrip('/').removesuffix('/v1')}"
            if address.rstrip("/").endswith("/v1")
            else "set supervisor.policy.model, or supervisor.policy.base_url"
            + ("" if "model" in failure.message.lower() else f"; {openai}")
        ),
        FailureKind.UNREACHABLE: "start the server, or set supervisor.policy.base_url",
        FailureKind.UNTRUSTED: "set SSL_CERT_FILE to the certificate of whoever signed it",
    }.get(failure.kind, "see what it says, or use supervisor=expert, which asks nobody")
    return SupervisionError(
        f"Expected an answer of the model {settings.model_name} from {where}, found"
        f" {failure.kind} ({failure.message}); {remedy}."
    )
