"""The interfaces of servers: bodies of requests, and readers of answers.

`anthropic` is the Messages API, `chat` the chat completions of OpenAI, llama.cpp, vLLM, Ollama and
LM Studio. The SDKs' own models of answers are not used, as they accept any values.
"""

from __future__ import annotations

import json
import math
import re
import time
from collections.abc import Awaitable, Callable, Mapping
from contextlib import suppress
from email.utils import parsedate_to_datetime
from typing import Any, Final, NamedTuple

from islandgp.supervision.llm.message import Failure, FailureKind, Reply, Request, Usage, clean

STATUSES: Final = {
    402: FailureKind.NO_CREDIT,
    413: FailureKind.TOO_LONG,
    **dict.fromkeys((401, 403), FailureKind.UNAUTHORISED),
    **dict.fromkeys((404, 405, 410, 501), FailureKind.NOT_FOUND),
    **dict.fromkeys((408, 504, 524), FailureKind.LATE),
    409: FailureKind.SERVER,
    429: FailureKind.RATE_LIMITED,
    529: FailureKind.OVERLOADED,
}
"""Kinds of failures by HTTP status; others are SERVER from 500 on, and REJECTED below."""

_WORDS: Final = {
    FailureKind.NO_CREDIT: re.compile(r"credit balance|insufficient_quota|exceeded your .*quota"),
    FailureKind.TOO_LONG: re.compile(r"too long|context (length|size|window)|maximum context"),
    FailureKind.NOT_FOUND: re.compile(
        r"model\b.*(not found|does not exist|not exist)|unknown model"
    ),
}
"""Errors with the status 400 or 429 that have a kind of their own."""

STOPS: Final = {"stop": "end_turn", "length": "max_tokens", "content_filter": "refusal"}
"""The names of the Messages API for the reasons why a chat completion ended."""

Hide = Callable[[str], str]
"""Removes secrets from a text."""


def _turns(request: Request) -> list[dict[str, str]]:
    roles = ("user", "assistant")
    return [{"role": roles[i % 2], "content": text} for i, text in enumerate(request.turns)]


def message_body(request: Request) -> dict[str, Any]:
    """The body of a request of the Messages API."""
    system: Any = request.system
    if request.cache:  # the cache ends here, as the text after it changes each time
        system = [{"type": "text", "text": system, "cache_control": {"type": "ephemeral"}}]
    extra = request.extra or {}
    output = {"format": {"type": "json_schema", "schema": request.schema}} if request.schema else {}
    if output := {**extra.get("output_config", {}), **output}:
        extra = {**extra, "output_config": output}
    optional = {"temperature": request.temperature}
    return {
        "model": request.model,
        "max_tokens": request.max_tokens,
        "system": system,
        "messages": _turns(request),
        **{key: value for key, value in optional.items() if value is not None},
        **extra,
    }


def chat_body(request: Request) -> dict[str, Any]:
    """The body of a request for a chat completion."""
    system = [{"role": "system", "content": request.system}] if request.system else []
    answer = {"name": "answer", "strict": True, "schema": request.schema}
    optional = {
        "temperature": request.temperature,
        "response_format": request.schema and {"type": "json_schema", "json_schema": answer},
        "grammar": request.grammar,  # llama.cpp
        "structured_outputs": request.grammar and {"grammar": request.grammar},  # vLLM
    }
    return {
        "model": request.model,
        "messages": [*system, *_turns(request)],
        "max_tokens": request.max_tokens,
        **{key: value for key, value in optional.items() if value is not None},
        **(request.extra or {}),
    }


def _read_message(message: dict[str, Any], hide: Hide) -> Reply:
    text = "".join(b["text"] for b in message["content"] if b["type"] == "text")
    blocks = [b.get("thinking") for b in message["content"] if b["type"] == "thinking"]
    thinking = "\n".join(block for block in blocks if isinstance(block, str))
    counts = message.get("usage") or {}
    fields = ("input", "output", "cache_read_input", "cache_creation_input")
    usage = Usage(*_tokens(counts.get(f"{field}_tokens") for field in fields))
    # Counts of 0 for the request or for a non-empty answer mean that the server did not count.
    counted = usage.read > 0 and (usage.output > 0 or not message["content"])
    stop = str(message.get("stop_reason") or "")
    return Reply(
        clean(hide(text)), line(hide(stop)), usage if counted else None, clean(hide(thinking))
    )


def _read_chat(answer: dict[str, Any], hide: Hide) -> Reply:
    choice = answer["choices"][0]
    message, stop = choice["message"], str(choice.get("finish_reason") or "")
    stop = "refusal" if message.get("refusal") else STOPS.get(stop, stop)
    text, thinking = message.get("content") or "", message.get("reasoning_content") or ""
    counts = answer.get("usage") or {}
    details = counts.get("prompt_tokens_details") or {}
    prompt, output, cached = _tokens(
        (counts.get("prompt_tokens"), counts.get("completion_tokens"), details.get("cached_tokens"))
    )
    usage = Usage(max(0, prompt - cached), output, cached) if prompt else None
    return Reply(clean(hide(text)), line(hide(stop)), usage, clean(hide(thinking)))


def _tokens(counts: Any) -> list[int]:
    """Numbers of tokens; missing ones are 0. Raises TypeError for values of other types."""
    tokens = [count or 0 for count in counts]
    if not all(type(value) is int and 0 <= value < 1e9 for value in tokens):
        raise TypeError("expected numbers of tokens")
    return tokens


class Interface(NamedTuple):
    """An interface of servers, and the SDK that speaks it."""

    sdk: str  # class of its client; the default of `client_factory`
    create: Callable[[Any], Callable[..., Awaitable[Any]]]  # the method of a client
    body: Callable[[Request], dict[str, Any]]
    typed: frozenset[str]  # fields of the body that are arguments of the method
    content: str  # field of an answer
    read: Callable[[dict[str, Any], Hide], Reply]
    headers: Mapping[str, str]


INTERFACES: Final = {
    "anthropic": Interface(
        "anthropic:AsyncAnthropic",
        lambda sdk: sdk.messages.with_raw_response.create,
        message_body,
        frozenset(("model", "messages", "max_tokens", "system", "output_config")),
        "content",
        _read_message,
        {"anthropic-version": "2023-06-01"},  # later versions reject `temperature`
    ),
    "chat": Interface(
        "openai:AsyncOpenAI",
        lambda sdk: sdk.chat.completions.with_raw_response.create,
        chat_body,
        frozenset(("model", "messages", "max_tokens")),
        "choices",
        _read_chat,
        {},
    ),
}
"""By `supervisor.policy.interface`."""


def read_body(interface: str, body: bytes, hide: Hide) -> Reply | Failure:
    """Reads the body of an answer with the status 200."""
    expected = INTERFACES[interface]
    try:
        answer = json.loads(body)
        if expected.content not in answer and "choices" in answer:
            return Failure(FailureKind.FOREIGN, "an answer in OpenAI's format")
        if expected.content not in answer and "error" in answer:
            error = answer["error"]
            text = line(
                hide(str(error.get("message", error) if isinstance(error, dict) else error))
            )
            unknown = "endpoint" in text.lower() or "/messages" in text
            kind = FailureKind.NOT_FOUND if unknown else FailureKind.MALFORMED
            return Failure(kind, f"status 200 with an error: {text}")
        return expected.read(answer, hide)
    except (ValueError, LookupError, TypeError, AttributeError, RecursionError) as error:
        start = line(hide(body.decode("utf-8", "replace")))[:80]
        return Failure(
            FailureKind.MALFORMED,
            f"expected a message, found a body of {len(body)} bytes that begins with"
            f" {start!r} ({type(error).__name__})",
        )


def line(text: str) -> str:
    """A text as one line of at most 300 characters."""
    return " ".join(clean(text).split())[:300]


def refused(status: int, text: str, headers: Mapping[str, str], hide: Hide) -> Failure:
    """The failure of a status other than 200; `text` is the error of the server."""
    message = f"status {status}" + (f": {line(hide(text))}" if text else "")
    if location := headers.get("location"):
        message += f", which leads to {line(hide(location))}"
    kind = STATUSES.get(status, FailureKind.SERVER if status >= 500 else FailureKind.REJECTED)
    if status in (400, 429):
        kind = next((k for k, words in _WORDS.items() if words.search(text.lower())), kind)
    return Failure(
        kind,
        message,
        retry_after(headers.get("retry-after"), headers.get("retry-after-ms")),
        {"true": True, "false": False}.get(headers.get("x-should-retry", "").strip().lower()),
    )


def retry_after(value: str | None, milliseconds: str | None = None) -> float | None:
    """Seconds to wait, >= 0, by the headers `retry-after` (seconds or a date) and `retry-after-ms`.

    The latter takes precedence. None if neither has a valid value.
    """
    for text, unit in ((milliseconds, 1000), (value, 1)):
        with suppress(ValueError, TypeError):
            if math.isfinite(seconds := float(text or "nan") / unit):
                return max(0.0, seconds)
    with suppress(ValueError, TypeError, OverflowError):
        return max(0.0, parsedate_to_datetime(value or "").timestamp() - time.time())
    return None
