"""Requests to a language model and its answers.

A failed attempt is a value, not an exception: it is recorded and counted, and followed by another
attempt or the fallback.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterable
from dataclasses import asdict, astuple, dataclass, replace
from enum import StrEnum
from operator import add
from typing import Any, Final, Protocol

from islandgp.redaction import without_secrets

MAX_ANSWER: Final = 100_000
"""Most characters of an answer that are read; 2048 tokens have about 8,000."""

NO_TEXT: Final = "(no text)"  # replaces an empty answer in a repair turn
MAX_QUOTED: Final = 6000  # most characters of a rejected answer that a repair turn quotes


class FailureKind(StrEnum):
    """Reason why an attempt has no answer."""

    TIMEOUT = "timeout"  # no complete answer before the deadline; also that of a gateway
    UNREACHABLE = "unreachable"  # no connection before the deadline; nothing was sent
    CUT = "cut"  # the connection was closed early
    RATE_LIMITED = "rate_limited"  # 429
    SERVER = "server"  # 5xx, and 409, which can be retried
    MALFORMED = "malformed"  # the body is no answer of the interface: HTML, truncated, wrong types
    REJECTED = "rejected"  # 400 and other 4xx: the request itself is invalid
    UNAUTHORISED = "unauthorised"  # 401, 403: the key is invalid
    NOT_FOUND = "not_found"  # 404, 405, 410, 501: unknown model or address
    NO_CREDIT = "no_credit"  # 402, and errors that say so: the account is used up
    TOO_LONG = "too_long"  # 413, and errors that say so: the model's context is too short
    BUDGET = "budget"  # a cap is reached; nothing was sent
    USELESS = "useless"  # too many unusable answers in a row; nothing was sent


_K = FailureKind
CHARGED: Final = frozenset({_K.TIMEOUT, _K.CUT, _K.MALFORMED})
"""Failures whose request may have been processed and charged, by an unknown amount."""

TRANSIENT: Final = CHARGED | {_K.UNREACHABLE, _K.RATE_LIMITED, _K.SERVER}
"""Failures after which another attempt may succeed."""

HOPELESS: Final = frozenset({_K.UNAUTHORISED, _K.NOT_FOUND, _K.NO_CREDIT, _K.TOO_LONG})
"""Failures that no later attempt heals; their question is not asked again in a run."""


@dataclass(frozen=True, slots=True)
class Usage:
    """Token counts in an answer. `input` excludes tokens that were read from a cache."""

    input: int = 0
    output: int = 0
    cache_read: int = 0
    cache_write: int = 0

    @property
    def read(self) -> int:
        """All tokens of the request."""
        return self.input + self.cache_read + self.cache_write

    def __add__(self, other: Usage) -> Usage:
        return Usage(*map(add, astuple(self), astuple(other)))


@dataclass(frozen=True, slots=True)
class Request:
    """The content of a request; equal requests have equal digests."""

    model: str
    system: str
    turns: tuple[str, ...]  # user and assistant in turn, user first and last
    max_tokens: int  # of the answer, thinking included
    temperature: float | None = None  # None: not sent
    schema: dict[str, Any] | None = None  # JSON schema of the answer; None: not sent
    cache: bool = False  # let the server cache the system prompt
    extra: dict[str, Any] | None = None  # further fields of the request's body; None: none
    grammar: str | None = None  # of the answer, in GBNF, sent instead of the schema

    @property
    def digest(self) -> str:
        """SHA-256 of the whole request, hexadecimal."""
        return sha256_of(self.plain())

    @property
    def prompt_digest(self) -> str:
        """SHA-256 of the rendered prompt alone, hexadecimal."""
        return sha256_of([self.system, *self.turns])

    @property
    def characters(self) -> int:
        """The length of the prompt."""
        return len(self.system) + sum(map(len, self.turns))

    def plain(self) -> dict[str, Any]:
        """The request as JSON values, without secrets in the extra fields."""
        return {**asdict(self), "extra": without_secrets(self.extra)}

    def without(self, names: Iterable[str]) -> Request:
        """The request with None for optional parameters."""
        none: dict[str, Any] = dict.fromkeys(names)
        return replace(self, **none)

    def followed_by(self, answer: str, question: str) -> Request:
        """The request extended by an answer and a further user turn; no turn is empty."""
        return replace(self, turns=(*self.turns, answer if answer.strip() else NO_TEXT, question))


@dataclass(frozen=True, slots=True)
class Reply:
    """The answer of a model, not yet checked."""

    text: str
    stop_reason: str  # "end_turn", "max_tokens", "refusal", ..., or "" if missing
    usage: Usage | None  # None: the server does not count tokens
    thinking: str = ""  # thinking before the answer, if the server returns it


@dataclass(frozen=True, slots=True)
class Failure:
    """An attempt without an answer."""

    kind: FailureKind
    message: str  # one line
    retry_after: float | None = None  # s to wait, as requested by the server


class Client(Protocol):
    """Makes single attempts at requests. A server cannot make it raise an exception."""

    def open(self) -> None:
        """Imports the SDK, which may take seconds that do not count toward an attempt."""
        ...

    def send(self, request: Request, *, seconds: float) -> Reply | Failure:
        """Makes one attempt.

        Args:
            request: the request.
            seconds: deadline, > 0; in any case the call returns soon after this time.

        Returns:
            The reply, or the failure.
        """
        ...

    def close(self) -> None:
        """Closes connections; the client is not used afterwards."""
        ...


def clean(text: str) -> str:
    """Text without lone surrogates and control characters, cut after MAX_ANSWER characters."""
    encodable = text[: MAX_ANSWER + 1].encode("utf-8", "replace").decode("utf-8")
    return "".join(c if c.isprintable() or c in "\n\t" else " " for c in encodable)


def line(text: str) -> str:
    """A text as one line of at most 300 characters."""
    return " ".join(clean(text).split())[:300]


def sha256_of(value: Any) -> str:
    """SHA-256 of JSON values, hexadecimal; the order of their keys does not matter."""
    body = json.dumps(value, sort_keys=True, ensure_ascii=False, separators=(",", ":"))
    return hashlib.sha256(body.encode()).hexdigest()
