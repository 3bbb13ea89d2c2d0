"""Requests to a language model, its answers, and how servers spell them.

A failed attempt is a value, not an exception: it is recorded and counted, and followed by another
attempt or the fallback. Of the interfaces, `anthropic` is the Messages API, `chat` the chat
completions of OpenAI, llama.cpp, vLLM, Ollama and LM Studio. The SDKs' own models of answers are
not used, as they accept any values.
"""

from __future__ import annotations

import hashlib
import json
import re
from collections.abc import Callable, Iterable, Mapping
from contextlib import suppress
from dataclasses import asdict, astuple, dataclass, replace
from enum import StrEnum
from operator import add
from typing import Any, Final, NamedTuple, Protocol

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
    grammar: str | None = None  # of the answer, in GBNF, sent instead of the schema

    @property
    def digest(self) -> str:
        """SHA-256 of the whole request, hexadecimal."""
        return sha256_of(asdict(self))

    @property
    def characters(self) -> int:
        """The length of the prompt."""
        return len(self.system) + sum(map(len, self.turns))

    def most_tokens(self, *, longer: int = 0) -> Usage:
        """Upper bound of the tokens, of a request that quotes `longer` further characters.

        Prompts and JSON have three to four bytes per token; the bound assumes two. A quoted answer
        may be in any script, with as little as one byte per token, but has at most `max_tokens`.
        The constant is for the frame of the message.
        """
        texts = (self.system, *self.turns[::2], json.dumps(self.schema))
        known = sum(len(text.encode()) // 2 for text in texts) + 500
        quoted = longer + sum(len(text.encode()) for text in self.turns[1::2])
        return Usage(known + max(quoted // 2, min(quoted, self.max_tokens)), self.max_tokens)

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

    def send(self, request: Request, *, seconds: float) -> Reply | Failure:
        """Makes one attempt.

        Args:
            request: the request.
            seconds: deadline, > 0; in any case the call returns soon after this time.

        Returns:
            The reply, or the failure.
        """
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


STATUSES: Final = {
    402: FailureKind.NO_CREDIT,
    409: FailureKind.SERVER,
    413: FailureKind.TOO_LONG,
    429: FailureKind.RATE_LIMITED,
    **dict.fromkeys((401, 403), FailureKind.UNAUTHORISED),
    **dict.fromkeys((404, 405, 410, 501), FailureKind.NOT_FOUND),
    **dict.fromkeys((408, 504, 524), FailureKind.TIMEOUT),
}
"""Kinds of failures by HTTP status; others are SERVER from 500 on, and REJECTED below."""

WORDS: Final = {
    FailureKind.NO_CREDIT: r"credit balance|insufficient_quota|exceeded your .*quota",
    FailureKind.TOO_LONG: r"too long|context (length|size|window)|maximum context|exceed_context",
    FailureKind.NOT_FOUND: r"model\b.*(not found|does not exist|not exist)|unknown model",
}
"""Patterns in the text of an error with the status 400 or 429, by the kind that they show."""

DAY: Final = 86_400.0  # s, the longest wait that is understood
STOPS: Final = {"stop": "end_turn", "length": "max_tokens", "content_filter": "refusal"}
"""The names of the Messages API for the reasons why a chat completion ended."""


def _turns(request: Request) -> list[dict[str, str]]:
    roles = ("user", "assistant")
    return [{"role": roles[i % 2], "content": text} for i, text in enumerate(request.turns)]


def message_body(request: Request) -> dict[str, Any]:
    """The body of a request of the Messages API."""
    answer = {"format": {"type": "json_schema", "schema": request.schema}}
    optional = {"temperature": request.temperature, "output_config": request.schema and answer}
    return {
        "model": request.model,
        "max_tokens": request.max_tokens,
        "system": request.system,
        "messages": _turns(request),
        **{key: value for key, value in optional.items() if value is not None},
    }


def chat_body(request: Request) -> dict[str, Any]:
    """The body of a request for a chat completion."""
    system = [{"role": "system", "content": request.system}] if request.system else []
    answer = {"name": "answer", "strict": True, "schema": request.schema}
    schema = None if request.grammar else request.schema
    optional = {
        "temperature": request.temperature,
        "response_format": schema and {"type": "json_schema", "json_schema": answer},
        "grammar": request.grammar,  # llama.cpp
        "structured_outputs": request.grammar and {"grammar": request.grammar},  # vLLM
    }
    return {
        "model": request.model,
        "messages": [*system, *_turns(request)],
        "max_tokens": request.max_tokens,
        **{key: value for key, value in optional.items() if value is not None},
    }


def _read_message(message: dict[str, Any]) -> Reply:
    blocks = message["content"]
    text = "".join(block["text"] for block in blocks if block["type"] == "text")
    thoughts = [block.get("thinking") for block in blocks if block["type"] == "thinking"]
    counts = message.get("usage") or {}
    fields = ("input", "output", "cache_read_input", "cache_creation_input")
    usage = Usage(*_tokens(counts.get(f"{field}_tokens") for field in fields))
    # Counts of 0 for the request or for a non-empty answer mean that the server did not count.
    counted = usage.read > 0 and (usage.output > 0 or not blocks)
    stop = line(str(message.get("stop_reason") or ""))
    thinking = "\n".join(thought for thought in thoughts if isinstance(thought, str))
    return Reply(clean(text), stop, usage if counted else None, clean(thinking))


def _read_chat(answer: dict[str, Any]) -> Reply:
    choice = answer["choices"][0]
    message, stop = choice["message"], str(choice.get("finish_reason") or "")
    stop = "refusal" if message.get("refusal") else STOPS.get(stop, line(stop))
    text, thinking = message.get("content") or "", message.get("reasoning_content") or ""
    counts = answer.get("usage") or {}
    details = counts.get("prompt_tokens_details") or {}
    prompt, output, cached = _tokens(
        (counts.get("prompt_tokens"), counts.get("completion_tokens"), details.get("cached_tokens"))
    )
    usage = Usage(max(0, prompt - cached), output, cached) if prompt else None
    return Reply(clean(text), stop, usage, clean(thinking))


def _tokens(counts: Iterable[Any]) -> list[int]:
    """Numbers of tokens; missing ones are 0. Raises TypeError for values of other types."""
    tokens = [count or 0 for count in counts]
    if not all(type(value) is int and 0 <= value < 1e9 for value in tokens):
        raise TypeError("expected numbers of tokens")
    return tokens


class Interface(NamedTuple):
    """An interface of servers, the SDK that speaks it, and its variables of the environment."""

    server: str  # the default one
    keys: tuple[str, ...]  # variables with a key or token, sent in the same header
    address: str  # variable
    sdk: str  # class of its client; the default of `client_factory`
    path: str  # of a request
    body: Callable[[Request], dict[str, Any]]
    read: Callable[[dict[str, Any]], Reply]
    headers: Mapping[str, str] = {}


INTERFACES: Final = {
    "anthropic": Interface(
        "the Anthropic API",
        ("ANTHROPIC_API_KEY", "ANTHROPIC_AUTH_TOKEN"),
        "ANTHROPIC_BASE_URL",
        "anthropic:Anthropic",
        "/v1/messages",
        message_body,
        _read_message,
        {"anthropic-version": "2023-06-01"},  # later versions reject `temperature`
    ),
    "chat": Interface(
        "the OpenAI API",
        ("OPENAI_API_KEY",),
        "OPENAI_BASE_URL",
        "openai:OpenAI",
        "/chat/completions",
        chat_body,
        _read_chat,
    ),
    "local": Interface("this machine", (), "", "", "", chat_body, _read_chat),
}
"""By `supervisor.policy.interface`."""


def read_body(interface: str, body: str) -> Reply | Failure:
    """Reads the body of an answer with the status 200."""
    try:
        answer = json.loads(body)
        return INTERFACES[interface].read(answer)
    except (ValueError, LookupError, TypeError, AttributeError, RecursionError) as error:
        found = f"expected an answer, found {line(body)[:80]!r} ({type(error).__name__})"
        with suppress(UnboundLocalError, TypeError):
            if "error" in answer:
                found = f"status 200 with an error: {line(error_text(answer))}"
        return Failure(FailureKind.MALFORMED, found)


def error_text(body: Any) -> str:
    """The message in the body of an error, which has several forms."""
    for key in ("error", "message"):
        body = body.get(key, body) if isinstance(body, dict) else body
    return "" if body is None else str(body)


def refused(status: int, text: str, headers: Mapping[str, str]) -> Failure:
    """The failure of a status other than 200; `text` is the error of the server."""
    kind = STATUSES.get(status, FailureKind.SERVER if status >= 500 else FailureKind.REJECTED)
    if status in (400, 429):
        kind = next((k for k, words in WORDS.items() if re.search(words, text.lower())), kind)
    seconds = None
    with suppress(ValueError):
        seconds = min(DAY, max(0.0, float(headers.get("retry-after", ""))))
    return Failure(kind, f"status {status}: {line(text)}".rstrip(": "), seconds)
