"""The Anthropic Messages API: arguments of requests, bodies, statuses and headers of answers."""

from __future__ import annotations

import json
import math
import re
import time
from collections.abc import Callable, Mapping
from contextlib import suppress
from email.utils import parsedate_to_datetime
from typing import Any, Final

from islandgp.supervision.llm.message import Failure, FailureKind, Reply, Request, Usage, clean

HEADERS: Final = {
    "accept-encoding": "identity",  # a compressed body is a failure
    "anthropic-version": "2023-06-01",  # later versions reject `temperature`
}

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


def arguments(request: Request) -> dict[str, Any]:
    """The arguments of the SDK's `messages.create` for a request."""
    roles = ("user", "assistant")
    system: Any = request.system
    if request.cache:  # the cache ends here, as the text after it changes each time
        system = [{"type": "text", "text": system, "cache_control": {"type": "ephemeral"}}]
    output = {
        "format": request.schema and {"type": "json_schema", "schema": request.schema},
        "effort": request.effort,
    }
    extra = {} if request.temperature is None else {"temperature": request.temperature}
    optional = {
        "output_config": {key: value for key, value in output.items() if value is not None},
        "thinking": request.thinking,
        "extra_body": {**extra, **(request.extra or {})},
    }
    return {
        "model": request.model,
        "max_tokens": request.max_tokens,
        "system": system,
        "messages": [
            {"role": roles[i % 2], "content": text} for i, text in enumerate(request.turns)
        ],
        "extra_headers": HEADERS,
        **{key: value for key, value in optional.items() if value},
    }


def read_message(
    body: bytes, line: Callable[[str], str], hide: Callable[[str], str]
) -> Reply | Failure:
    """Reads the body of a message. The SDK's models are not used, as they accept any values.

    `line` makes one short line of a text, `hide` removes secrets from it.
    """
    try:
        message = json.loads(body)
        if other := _other_language(message, line):
            return other
        text = "".join(b["text"] for b in message["content"] if b["type"] == "text")
        blocks = [b.get("thinking") for b in message["content"] if b["type"] == "thinking"]
        thinking = "\n".join(block for block in blocks if isinstance(block, str))
        stop = message.get("stop_reason") or ""
        usage = _usage(message.get("usage") or {})
        # Counts of 0 for the request or for a non-empty answer mean that the server did not count.
        counted = usage.read > 0 and (usage.output > 0 or not message["content"])
        answer, thoughts = clean(hide(text)), clean(hide(thinking))
        return Reply(answer, line(str(stop)), usage if counted else None, thoughts)
    except (ValueError, KeyError, TypeError, AttributeError, RecursionError) as error:
        start = line(body.decode("utf-8", "replace"))[:80]
        return Failure(
            FailureKind.MALFORMED,
            f"expected a message, found a body of {len(body)} bytes that begins with"
            f" {start!r} ({type(error).__name__})",
        )


def _other_language(message: Any, line: Callable[[str], str]) -> Failure | None:
    """The failure if a body of status 200 is an error or in OpenAI's format; None otherwise."""
    if not isinstance(message, dict) or "content" in message:
        return None
    if "choices" in message:
        return Failure(FailureKind.FOREIGN, "an answer in OpenAI's format")
    if "error" not in message:
        return None
    error = message["error"]
    text = line(str(error.get("message", error) if isinstance(error, dict) else error))
    unknown = "endpoint" in text.lower() or "/messages" in text
    kind = FailureKind.NOT_FOUND if unknown else FailureKind.MALFORMED
    return Failure(kind, f"status 200 with an error: {text}")


def _usage(counts: dict[str, Any]) -> Usage:
    """The usage in a message; missing counts are 0. Raises TypeError for values of other types."""
    fields = ("input", "output", "cache_read_input", "cache_creation_input")
    tokens = [counts.get(f"{field}_tokens") or 0 for field in fields]
    if not all(type(value) is int and 0 <= value < 1e9 for value in tokens):
        raise TypeError("expected numbers of tokens")
    return Usage(*tokens)


def refused(
    status: int, text: str, headers: Mapping[str, str], line: Callable[[str], str]
) -> Failure:
    """The failure of a status other than 200; `text` is the error of the server."""
    message = f"status {status}" + (f": {line(text)}" if text else "")
    if location := headers.get("location"):
        message += f", which leads to {line(location)}"
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
