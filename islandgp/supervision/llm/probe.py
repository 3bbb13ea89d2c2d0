"""The probe of a server: which optional parameters it supports.

The probe asks for a greeting and sends a JSON schema. A server that answers with JSON supports
schemas; one that answers with a greeting ignores them. If the server rejects the request, the next
one omits a parameter: the one named in the error, or else the temperature, the schema, or both.
"""

from __future__ import annotations

import re
from collections.abc import Collection
from itertools import count
from math import inf
from typing import Any, Final

from islandgp.errors import SupervisionError
from islandgp.supervision.llm.answers import find_object
from islandgp.supervision.llm.calls import Calls
from islandgp.supervision.llm.message import (
    TRANSIENT,
    Failure,
    FailureKind,
    Reply,
    Request,
    ServerCapabilities,
)
from islandgp.supervision.llm.settings import LLMSettings
from islandgp.supervision.llm.transcript import Call, Learnt

_SYSTEM: Final = "Answer in one short sentence."
_QUESTION: Final = "Please greet me."
_SCHEMA: Final[dict[str, Any]] = {
    "type": "object",
    "properties": {"greeting": {"type": "string"}},
    "required": ["greeting"],
    "additionalProperties": False,
}


_NAMES: Final = {
    "temperature": re.compile(r"temperature|sampling|top[_ ][pk]\b", re.IGNORECASE),
    "grammar": re.compile(r"grammar|structured_outputs", re.IGNORECASE),
    "schema": re.compile(r"output_config|output_format|schema|structured|json", re.IGNORECASE),
}
"""Patterns in the errors of servers that reject a parameter. The wording is not standardised, so
they only order the next attempts."""

_GRAMMAR: Final = 'root ::= "{\\"greeting\\": \\"by a grammar\\"}"'
"""A server that decodes by it has no other answer."""

Parameters = tuple[str, float | None]
"""What bounds the answer (grammar, schema or text), and the temperature that is sent, if any."""


def capabilities_in(
    generation: int, calls: Calls, settings: LLMSettings
) -> ServerCapabilities | Failure:
    """The capabilities for the requests of a generation; a failure if there is no answer yet.

    They are those of the transcript, or of a probe. A run that starts while the server is busy
    probes it in each generation until it answers.

    Args:
        generation: of the requests; -1: the start of the run.
        calls: to make the requests with.
        settings: of the model.

    Raises:
        SupervisionError: as `probe_capabilities`.
    """
    transcript = calls.transcript
    if generation < 0 and transcript.start is not None:
        known = transcript.capabilities(inf)
        return known or Failure(FailureKind.OVERLOADED, "none when the run was stopped")
    if generation >= 0 and (known := transcript.capabilities(generation)):
        return known
    answer = probe_capabilities(calls, settings, generation)
    if generation >= 0 and isinstance(answer, ServerCapabilities):
        transcript.add(Learnt(generation, answer))
    return answer


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
    untried, named = _parameter_choices(settings), set[str]()
    greeting = {"greeting": "by a grammar"}
    for turn in count():
        bound, temperature = mode = min(untried, key=lambda mode: _parameters(mode, named))
        request = Request(
            settings.model_name,
            _SYSTEM,
            (_QUESTION,),
            settings.reply_tokens,
            temperature,
            _SCHEMA if bound == "schema" else None,
            extra=settings.extra_body,
            grammar=_GRAMMAR if bound == "grammar" else None,
        )
        answer = calls.ask(Call(generation, "probe", turn), request)
        if isinstance(answer, Reply):
            found = find_object(answer.text, ["greeting"])
            if bound == "grammar" and found != greeting:
                untried = [each for each in untried if each[0] != "grammar"]
                if untried:
                    continue
                raise SupervisionError(
                    f"supervisor.policy.output=grammar: expected a server that decodes by a grammar"
                    f" at {settings.place}, found an answer without it; set"
                    " supervisor.policy.output=auto."
                )
            structured = bound == "schema"
            if settings.output == "auto" and structured and answer.text:
                structured = found is not None
            note, by_grammar = "as the probe found", bound == "grammar"
            return ServerCapabilities(structured, temperature, note, by_grammar)
        never_there = generation < 0 and answer.kind is FailureKind.UNREACHABLE
        if not never_there and (answer.kind in TRANSIENT or answer.kind is FailureKind.BUDGET):
            return answer
        untried.remove(mode)
        if answer.kind is not FailureKind.REJECTED or not untried:
            raise _hopeless(answer, settings)
        new = {name for name, pattern in _NAMES.items() if pattern.search(answer.message)}
        named = named | new if len(new) == 1 else set()  # an error that names both tells nothing
    raise AssertionError


def _parameter_choices(settings: LLMSettings) -> list[Parameters]:
    """The combinations of parameters to try, the best first; a schema is preferred."""
    bounds = {
        "auto": ("grammar", "schema", "text")[settings.interface == "anthropic" :],
        "grammar": ("grammar",),
        "structured": ("schema",),
        "text": ("text",),
    }[settings.output]
    heats = dict.fromkeys((settings.temperature, None))
    return [(bound, heat) for bound in bounds for heat in heats]


def _parameters(mode: Parameters, named: Collection[str]) -> int:
    """The number of parameters of a combination that the errors so far have named."""
    sent = {mode[0], "temperature" if mode[1] is not None else ""}
    return len(sent.intersection(named))


_OPENAI: Final = "a server with OpenAI's API only needs supervisor.policy.interface=chat"
_REMEDIES: Final = {
    FailureKind.FOREIGN: _OPENAI,
    FailureKind.UNREACHABLE: "start the server, or set supervisor.policy.base_url",
    FailureKind.UNTRUSTED: "set SSL_CERT_FILE to the certificate of its authority",
}


def _hopeless(failure: Failure, settings: LLMSettings) -> SupervisionError:
    address = (settings.address or "").rstrip("/")
    remedy = _REMEDIES.get(
        failure.kind, "see the server's message, or use supervisor=expert, which needs no server"
    )
    if failure.kind is FailureKind.UNAUTHORISED:
        custom = settings.client_factory
        remedy = f"set the credentials of {custom}" if custom else "set another ANTHROPIC_API_KEY"
    elif failure.kind is FailureKind.NOT_FOUND:
        remedy = "set supervisor.policy.model, or supervisor.policy.base_url"
        if address.endswith("/v1"):
            remedy = f"drop /v1 from the address, as in {address.removesuffix('/v1')}"
        elif "model" not in failure.message.lower():
            remedy += f"; {_OPENAI}"
    return SupervisionError(
        f"Expected an answer of the model {settings.model_name} from {settings.place}, found"
        f" {failure.kind} ({failure.message}); {remedy}."
    )
