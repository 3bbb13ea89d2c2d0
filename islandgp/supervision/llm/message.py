"""The seam in front of the SDK: a request goes in, a reply or a failure comes out.

A failed attempt is a value, not an exception: it is written down, counted, and
answered with another attempt or with the fallback.
"""

from __future__ import annotations

import hashlib
import json
from dataclasses import asdict, dataclass, replace
from enum import StrEnum
from typing import Any, Final, Protocol

from islandgp.redaction import without_secrets

SANE: Final = 100_000  # characters of an answer that are looked at; 2048 tokens have about 8,000

NO_TEXT: Final = "(no text)"  # takes the place of an empty answer in a repair turn

QUOTED: Final = 6000  # characters of a useless answer that a repair turn sends back


class FailureKind(StrEnum):
    """Why there is no answer."""

    TIMEOUT = "timeout"  # no whole answer before the deadline
    LATE = "late"  # 408, 504, 524: a gateway in between did not wait for the answer
    UNREACHABLE = "unreachable"  # no connection, or none before the deadline; nothing was sent
    UNTRUSTED = "untrusted"  # the certificate is signed by no known authority; nothing was sent
    CUT = "cut"  # the connection broke off
    RATE_LIMITED = "rate_limited"  # 429
    OVERLOADED = "overloaded"  # 529
    SERVER = "server"  # other 5xx, and 409, which asks for another attempt
    MALFORMED = "malformed"  # a body that is no message: HTML, cut off, of wrong types
    FOREIGN = "foreign"  # an answer in OpenAI's language
    REJECTED = "rejected"  # 400 and the like: the request itself is refused
    UNAUTHORISED = "unauthorised"  # 401, 403: the key is refused
    NOT_FOUND = "not_found"  # 404, 405, 410, 501: no such model, or no such address
    BUDGET = "budget"  # a cap is reached; nothing was sent
    USELESS = "useless"  # too many useless answers in a row; nothing was sent


TRANSIENT: Final = frozenset(
    {
        FailureKind.TIMEOUT,
        FailureKind.LATE,
        FailureKind.UNREACHABLE,
        FailureKind.CUT,
        FailureKind.RATE_LIMITED,
        FailureKind.OVERLOADED,
        FailureKind.SERVER,
        FailureKind.MALFORMED,
    }
)
"""Failures that another attempt may mend."""

CHARGED: Final = frozenset(
    {
        FailureKind.TIMEOUT,
        FailureKind.LATE,
        FailureKind.CUT,
        FailureKind.MALFORMED,
        FailureKind.FOREIGN,
    }
)
"""Failures whose request may have been worked on and charged, without our hearing how much."""

UNSENT: Final = frozenset({FailureKind.UNREACHABLE, FailureKind.UNTRUSTED})
"""Failures of attempts that found no connection: nothing was sent, so it is no request."""


@dataclass(frozen=True, slots=True)
class Usage:
    """Tokens that an answer says it took. `input` leaves out what was read from a cache."""

    input: int = 0
    output: int = 0
    cache_read: int = 0
    cache_write: int = 0

    @property
    def read(self) -> int:
        """All tokens of the request."""
        return self.input + self.cache_read + self.cache_write


@dataclass(frozen=True, slots=True)
class Request:
    """Everything that an answer depends on; two equal requests have one digest."""

    model: str
    system: str
    turns: tuple[str, ...]  # ours and the model's by turns, ours first and last
    max_tokens: int
    temperature: float | None = None  # None: not sent
    schema: dict[str, Any] | None = None  # JSON schema; None: not sent
    cache: bool = False  # ask the server to keep the system prompt
    thinking: dict[str, Any] | None = None  # as the API takes it; None: not sent
    effort: str | None = None  # None: not sent
    extra: dict[str, Any] | None = None  # more fields of the request's body; None: none

    @property
    def digest(self) -> str:
        """SHA-256 of the whole request, hexadecimal."""
        return sha256_of(self.plain())

    @property
    def prompt_digest(self) -> str:
        """SHA-256 of the rendered prompt alone, hexadecimal."""
        return sha256_of([self.system, *self.turns])

    def plain(self) -> dict[str, Any]:
        """As JSON values. Fields that came later stand there only where they say something.

        Secrets among the extra fields are hidden, in records and for the digest.
        """
        later = ("thinking", "effort", "extra")
        values = {**asdict(self), "extra": without_secrets(self.extra)}
        return {k: v for k, v in values.items() if v is not None or k not in later}

    def followed_by(self, answer: str, question: str) -> Request:
        """The request that goes on after an answer; the API takes no empty turn."""
        return replace(self, turns=(*self.turns, answer if answer.strip() else NO_TEXT, question))


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


@dataclass(frozen=True, slots=True)
class Reply:
    """What came back, as it came back: nothing in it is checked yet."""

    text: str
    stop_reason: str  # "end_turn", "max_tokens", "refusal", ..., or "" where none is given
    usage: Usage | None  # None: the server does not say
    thinking: str = ""  # what the model thought before, as far as the server tells it


@dataclass(frozen=True, slots=True)
class Failure:
    """What came instead of an answer."""

    kind: FailureKind
    message: str  # one line for people
    retry_after: float | None = None  # s that the server asks to wait
    should_retry: bool | None = None  # what the server says about another attempt; None: nothing


class Client(Protocol):
    """One attempt at one request. Never raises for anything the other side does."""

    def open(self) -> None:
        """Loads what is needed, which may take seconds: they are no part of an attempt."""
        ...

    def send(self, request: Request, *, seconds: float) -> Reply | Failure:
        """Returns after at most `seconds`, whatever the other side does."""
        ...

    def close(self) -> None:
        """Frees what the client holds; it is not used afterwards."""
        ...


def clean(text: str) -> str:
    """Text that can be stored and shown anywhere: no lone surrogates, no control characters."""
    kept = text[: SANE + 1].encode("utf-8", "replace").decode("utf-8")
    return "".join(c if c.isprintable() or c in "\n\t" else " " for c in kept)


def sha256_of(value: Any) -> str:
    """SHA-256 of JSON values, hexadecimal; the order of their keys does not matter."""
    body = json.dumps(value, sort_keys=True, ensure_ascii=False, separators=(",", ":"))
    return hashlib.sha256(body.encode()).hexdigest()
