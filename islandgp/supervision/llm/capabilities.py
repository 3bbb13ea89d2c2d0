"""The probe at a run's start: how the server wants to be asked.

It asks for a greeting in plain words and at the same time for a JSON schema.
A server that answers with JSON keeps to schemas; one that greets does not know
them. What a server refuses is left out the next time: the parameter that its
error names, else the temperature, then the schema, then both.
"""

from __future__ import annotations

import re
from collections.abc import Collection, Sequence
from dataclasses import asdict, dataclass
from typing import Any, Final

from islandgp.errors import SupervisionError
from islandgp.plain import from_json
from islandgp.supervision.llm.calls import Calls
from islandgp.supervision.llm.message import TRANSIENT, Failure, FailureKind, Reply, Request
from islandgp.supervision.llm.settings import LLMSettings
from islandgp.supervision.llm.transcript import Call, Transcript
from islandgp.supervision.llm.validation import find_object

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


@dataclass(frozen=True, slots=True)
class Dialect:
    """How requests are made."""

    structured: bool  # with a JSON schema; else a JSON object is looked for in the text
    temperature: float | None  # None: not sent
    note: str  # one line for people: what the probe found

    def __str__(self) -> str:
        output = "structured output" if self.structured else "JSON found in text"
        heat = "no temperature" if self.temperature is None else f"temperature {self.temperature:g}"
        return f"{output}, {heat} ({self.note})"


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
