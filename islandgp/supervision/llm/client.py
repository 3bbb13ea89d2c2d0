"""The client of the Messages API.

The second half converts requests, bodies, statuses and waiting times between our types and those
of the API.

The SDK's timeout applies to each read, not to the whole call: a server that sends a byte now and
then would block the caller forever. So each attempt is a task of an event loop, which is cancelled
at the deadline in any phase: name lookup, connection, headers or body. The SDK's retries are off.
"""

from __future__ import annotations

import asyncio
import json
import math
import re
import ssl
import time
from collections.abc import Callable, Sequence
from concurrent.futures import CancelledError
from contextlib import suppress
from email.utils import parsedate_to_datetime
from threading import Lock, Thread
from typing import TYPE_CHECKING, Any, Final

from islandgp.supervision.llm.message import Failure, FailureKind, Reply, Request, Usage, clean
from islandgp.supervision.llm.services import ENCODING, REQUEST_EVENTS, Service, sdk_client

if TYPE_CHECKING:
    import anthropic
    import httpx2

HEADERS: Final = {
    "accept-encoding": "identity",  # a compressed body is a failure
    "anthropic-version": "2023-06-01",  # later versions reject `temperature`
}

GRACE: Final = 5.0  # s for a cancelled attempt to end; usually it ends immediately
HIDDEN: Final = "[key]"


class AnthropicClient:
    """Sends requests to the Messages API or to a compatible server."""

    def __init__(
        self,
        *,
        key: str | None,
        base_url: str | None,
        service: Service = "anthropic",
        secrets: Sequence[str] = (),
        transport: httpx2.AsyncBaseTransport | None = None,
    ) -> None:
        """Opens no connection.

        Args:
            key: API key or token; None for a local server without one.
            base_url: of the server; None: the address of the service.
            service: that offers the models.
            secrets: values in requests that are removed from answers, as the key is.
            transport: replaces the network in tests.
        """
        self._key, self._base_url, self._transport = key, base_url, transport
        self._service: Service = service
        # A key of a few characters belongs to a local server and is not secret.
        hidden = [text for text in (key, *secrets) if text and len(text) >= 8]
        self._secret = re.compile("|".join(map(spellings, hidden))) if hidden else None
        self._running: tuple[asyncio.AbstractEventLoop, Thread, anthropic.AsyncAnthropic] | None
        self._running = None
        self._closed = False
        self._lock = Lock()

    def open(self) -> None:
        """See `Client`. Importing the SDK takes seconds."""
        with self._lock:  # `close` may be called by another thread
            if not self._closed and self._running is None:
                self._running = self._run()

    def send(self, request: Request, *, seconds: float) -> Reply | Failure:
        """See `Client`."""
        self.open()
        with self._lock:
            if self._running is None:
                return Failure(FailureKind.CUT, "the client is closed")
            loop, _, sdk = self._running
            attempt = asyncio.run_coroutine_threadsafe(self._bounded(sdk, request, seconds), loop)
        try:
            return attempt.result(seconds + GRACE)
        except (TimeoutError, CancelledError):
            return _late(seconds)
        finally:
            attempt.cancel()  # after Ctrl-C; has no effect on a finished attempt

    def close(self) -> None:
        """See `Client`."""
        with self._lock:
            self._closed = True
            running, self._running = self._running, None
        if running is None:
            return
        loop, thread, sdk = running
        with suppress(TimeoutError):  # daemon threads do not run while the process exits
            asyncio.run_coroutine_threadsafe(_end(sdk), loop).result(GRACE)
        loop.call_soon_threadsafe(loop.stop)
        thread.join(GRACE)
        if not thread.is_alive():
            loop.close()

    def _run(self) -> tuple[asyncio.AbstractEventLoop, Thread, anthropic.AsyncAnthropic]:
        sdk = sdk_client(self._service, self._key, self._base_url, self._transport)
        assert sdk.messages  # the SDK imports it at the first access
        loop = asyncio.new_event_loop()
        # A daemon thread, so that a hanging name lookup does not keep the process alive.
        thread = Thread(target=loop.run_forever, name="llm", daemon=True)
        thread.start()
        return loop, thread, sdk

    async def _bounded(
        self, sdk: anthropic.AsyncAnthropic, request: Request, seconds: float
    ) -> Reply | Failure:
        """An attempt that ends at the deadline."""
        events = [] if self._transport is None else ["transport"]  # it emits no events
        REQUEST_EVENTS.set(events)
        try:
            return await asyncio.wait_for(self._attempt(sdk, request), seconds)
        except TimeoutError:
            if events:
                return _late(seconds)
            return Failure(FailureKind.UNREACHABLE, f"no connection within {seconds:g} s")

    async def _attempt(self, sdk: anthropic.AsyncAnthropic, request: Request) -> Reply | Failure:
        import anthropic

        try:
            answer = await sdk.messages.with_raw_response.create(**arguments(request))
            response = answer.http_response
            if encoding := response.extensions.get(ENCODING):
                return Failure(
                    FailureKind.MALFORMED,
                    "expected an uncompressed body, as requested, found the encoding"
                    f" {self._line(encoding)}; turn compression off in the server",
                )
            return read_message(response.content, self._line, self._hide)
        except anthropic.APIStatusError as error:
            return self._refused(error)
        except anthropic.APITimeoutError:
            return Failure(FailureKind.TIMEOUT, "the connection timed out")
        except anthropic.APIConnectionError as error:
            cause = error.__cause__ or error
            return Failure(_unconnected(cause), self._line(str(cause)) or type(cause).__name__)
        except Exception as error:  # the SDK raises various types for a damaged answer
            kind = FailureKind.MALFORMED if REQUEST_EVENTS.get() else unsent(error)
            return Failure(kind, self._line(f"{type(error).__name__}: {error}"))

    def _refused(self, error: anthropic.APIStatusError) -> Failure:
        text = error.api_message if isinstance(error.api_message, str) else ""
        message = f"status {error.status_code}" + (f": {self._line(text)}" if text else "")
        headers = error.response.headers
        if location := headers.get("location"):
            message += f", which leads to {self._line(location)}"
        return Failure(
            kind_of(error.status_code),
            message,
            retry_after(headers.get("retry-after"), headers.get("retry-after-ms")),
            should_retry(headers.get("x-should-retry")),
        )

    def _line(self, text: str) -> str:
        """A text of the server as one line of at most 300 characters, without secrets."""
        return " ".join(clean(self._hide(text)).split())[:300]

    def _hide(self, text: str) -> str:
        """A text without secrets, also those with JSON escapes."""
        return self._secret.sub(HIDDEN, text) if self._secret else text


def _late(seconds: float) -> Failure:
    return Failure(FailureKind.TIMEOUT, f"no complete answer within {seconds:g} s")


def _unconnected(cause: BaseException) -> FailureKind:
    """The kind of a connection error."""
    import httpx2

    if not isinstance(cause, (httpx2.ConnectError, httpx2.ProxyError)):
        return FailureKind.CUT
    reason: BaseException | None = cause
    while reason is not None:
        if isinstance(reason, ssl.SSLCertVerificationError):
            return FailureKind.UNTRUSTED
        reason = reason.__cause__ or reason.__context__
    return FailureKind.UNREACHABLE


def unsent(error: BaseException) -> FailureKind:
    """The kind of an error before a request was sent, such as missing credentials of a cloud."""
    classes = {c.__name__ for c in type(error).__mro__}
    if "GoogleAuthError" in classes and "TransportError" not in classes:
        return FailureKind.UNAUTHORISED
    return FailureKind.UNAUTHORISED if "credentials" in str(error) else FailureKind.UNREACHABLE


async def _end(sdk: anthropic.AsyncAnthropic) -> None:
    """Cancels the attempts of other threads and closes all connections."""
    others = asyncio.all_tasks() - {asyncio.current_task()}
    for task in others:
        task.cancel()
    await asyncio.gather(*others, return_exceptions=True)
    await sdk.close()


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

    def tokens(value: Any) -> int:
        if isinstance(value, bool) or not isinstance(value, int) or not 0 <= value < 1e9:
            raise TypeError("expected a number of tokens")
        return value

    return Usage(
        tokens(counts.get("input_tokens") or 0),
        tokens(counts.get("output_tokens") or 0),
        tokens(counts.get("cache_read_input_tokens") or 0),
        tokens(counts.get("cache_creation_input_tokens") or 0),
    )


def kind_of(status: int) -> FailureKind:
    """The kind of failure of an HTTP status other than 200."""
    kinds = {
        401: FailureKind.UNAUTHORISED,
        403: FailureKind.UNAUTHORISED,
        404: FailureKind.NOT_FOUND,
        405: FailureKind.NOT_FOUND,
        408: FailureKind.LATE,
        409: FailureKind.SERVER,
        410: FailureKind.NOT_FOUND,
        429: FailureKind.RATE_LIMITED,
        501: FailureKind.NOT_FOUND,
        504: FailureKind.LATE,
        524: FailureKind.LATE,
        529: FailureKind.OVERLOADED,
    }
    return kinds.get(status, FailureKind.SERVER if status >= 500 else FailureKind.REJECTED)


def retry_after(value: str | None, milliseconds: str | None = None) -> float | None:
    """Seconds to wait, >= 0, by the headers `retry-after` (seconds or a date) and `retry-after-ms`.

    The latter takes precedence. None if neither has a valid value.
    """
    with suppress(ValueError, TypeError):
        if math.isfinite(exact := float(milliseconds or "nan") / 1000):
            return max(0.0, exact)
    if value is None:
        return None
    try:
        seconds = float(value)
    except ValueError:
        try:
            seconds = parsedate_to_datetime(value).timestamp() - time.time()
        except (ValueError, TypeError, OverflowError):
            return None
    return max(0.0, seconds) if math.isfinite(seconds) else None


def should_retry(value: str | None) -> bool | None:
    """Parses the header `x-should-retry`; None if it is missing or has another value."""
    return {"true": True, "false": False}.get((value or "").strip().lower())


def spellings(key: str) -> str:
    """A regular expression that matches a key with any of its characters escaped as in JSON.

    The text of an answer is JSON itself, so "sk" may also be written as "\\u0073k".
    """
    return "".join(rf"\\*(?:{re.escape(c)}|(?<=\\)u(?i:{ord(c):04x}))" for c in key)
