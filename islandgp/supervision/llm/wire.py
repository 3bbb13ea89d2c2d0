"""Between our nouns and the Messages API's: requests, bodies, statuses, waiting times."""

from __future__ import annotations

import json
import math
import re
import time
from collections.abc import Callable
from email.utils import parsedate_to_datetime
from typing import Any, Final

from islandgp.supervision.llm.message import Failure, FailureKind, Reply, Request, Usage, clean

HEADERS: Final = {
    "accept-encoding": "identity",  # a body that is compressed all the same is refused
    "anthropic-version": "2023-06-01",  # later ones refuse `temperature`
}


def arguments(request: Request) -> dict[str, Any]:
    """A request as the SDK's `messages.create` takes it."""
    roles = ("user", "assistant")
    found: dict[str, Any] = {
        "model": request.model,
        "max_tokens": request.max_tokens,
        "system": _system(request),
        "messages": [
            {"role": roles[i % 2], "content": text} for i, text in enumerate(request.turns)
        ],
        "extra_headers": HEADERS,
    }
    output: dict[str, Any] = {}
    if request.schema is not None:
        output["format"] = {"type": "json_schema", "schema": request.schema}
    if request.effort is not None:
        output["effort"] = request.effort
    if output:
        found["output_config"] = output
    if request.thinking is not None:
        found["thinking"] = request.thinking
    extra = {} if request.temperature is None else {"temperature": request.temperature}
    if extra := {**extra, **(request.extra or {})}:
        found["extra_body"] = extra
    return found


def _system(request: Request) -> str | list[dict[str, Any]]:
    """The system prompt, marked where it is to be kept: what follows it changes each time."""
    if not request.cache:
        return request.system
    return [{"type": "text", "text": request.system, "cache_control": {"type": "ephemeral"}}]


def read_message(
    body: bytes, line: Callable[[str], str], hide: Callable[[str], str]
) -> Reply | Failure:
    """A message's body. The SDK's models are not used: they take whatever comes.

    `line` makes one short line of a text, `hide` takes the key out of it.
    """
    try:
        message = json.loads(body)
        text = "".join(b["text"] for b in message["content"] if b["type"] == "text")
        thoughts = [b.get("thinking") for b in message["content"] if b["type"] == "thinking"]
        thinking = "\n".join(thought for thought in thoughts if isinstance(thought, str))
        stop = message.get("stop_reason") or ""
        usage = _usage(message.get("usage") or {})
        told = _counts(usage, text)
        return Reply(
            clean(hide(text)), line(str(stop)), usage if told else None, clean(hide(thinking))
        )
    except (ValueError, KeyError, TypeError, AttributeError, RecursionError) as error:
        start = line(body.decode("utf-8", "replace"))[:80]
        return Failure(
            FailureKind.MALFORMED,
            f"expected a message, found a body of {len(body)} bytes that begins with"
            f" {start!r} ({type(error).__name__})",
        )


def _usage(found: dict[str, Any]) -> Usage:
    """Servers may leave some of it out. Raises TypeError where it is no usage."""

    def tokens(value: Any) -> int:
        if isinstance(value, bool) or not isinstance(value, int) or not 0 <= value < 1e9:
            raise TypeError("expected a number of tokens")
        return value

    return Usage(
        tokens(found.get("input_tokens") or 0),
        tokens(found.get("output_tokens") or 0),
        tokens(found.get("cache_read_input_tokens") or 0),
        tokens(found.get("cache_creation_input_tokens") or 0),
    )


def _counts(usage: Usage, text: str) -> bool:
    """Whether a server has counted: a request has tokens, and a text has some, too."""
    asked = usage.input + usage.cache_read + usage.cache_write
    return asked > 0 and (usage.output > 0 or not text)


def kind_of(status: int) -> FailureKind:
    """What a status other than 200 means."""
    known = {
        401: FailureKind.UNAUTHORISED,
        403: FailureKind.UNAUTHORISED,
        404: FailureKind.NOT_FOUND,
        408: FailureKind.SERVER,
        409: FailureKind.SERVER,
        429: FailureKind.RATE_LIMITED,
        529: FailureKind.OVERLOADED,
    }
    return known.get(status, FailureKind.SERVER if status >= 500 else FailureKind.REJECTED)


def retry_after(said: str | None) -> float | None:
    """The seconds that a server asks to wait, given as a number or as a date."""
    if said is None:
        return None
    try:
        seconds = float(said)
    except ValueError:
        try:
            seconds = parsedate_to_datetime(said).timestamp() - time.time()
        except (ValueError, TypeError, OverflowError):
            return None
    return max(0.0, seconds) if math.isfinite(seconds) else None


def should_retry(said: str | None) -> bool | None:
    """Whether a server says that another attempt is of use; None: it says nothing."""
    return {"true": True, "false": False}.get((said or "").strip().lower())


def spellings(key: str) -> str:
    """A pattern of every way in which a JSON string can spell a key.

    An answer's text is JSON of its own: "sk" is a key's beginning as "\\u0073k", too.
    """
    return "".join(rf"\\*(?:{re.escape(c)}|(?<=\\)u(?i:{ord(c):04x}))" for c in key)
