"""The Anthropic SDK behind the seam. It is imported here and nowhere else.

The second half of this file lies between our nouns and the Messages API's: requests, bodies,
statuses, waiting times.

The SDK's own timeout bounds each read and not the call, so that a server which
sends a byte now and then holds a caller for ever. Here an attempt is a task of
an event loop, which is cancelled at the deadline whatever it is doing: looking
up a name, connecting, reading headers or a body. The SDK's retries are off.
"""

from __future__ import annotations

import asyncio
import json
import math
import re
import ssl
import time
from collections.abc import AsyncIterator, Callable, Sequence
from concurrent.futures import CancelledError
from contextlib import suppress
from contextvars import ContextVar
from email.utils import parsedate_to_datetime
from threading import Lock, Thread
from typing import TYPE_CHECKING, Any, Final

from islandgp.supervision.llm.message import Failure, FailureKind, Reply, Request, Usage, clean

if TYPE_CHECKING:
    import anthropic
    import httpx2

HEADERS: Final = {
    "accept-encoding": "identity",  # a body that is compressed all the same is refused
    "anthropic-version": "2023-06-01",  # later ones refuse `temperature`
}

LARGEST: Final = 8_000_000  # bytes of a body; an honest one has some 10,000
GRACE: Final = 5.0  # s for a cancelled attempt to end; it needs none of it
HIDDEN: Final = "[key]"
ENCODING: Final = "islandgp.encoding"  # of a body, where it has one; an extension of a response
_BEGUN: Final[ContextVar[list[str]]] = ContextVar("begun")
"""What of an attempt's request is sent so far, as events; empty: nothing."""


class AnthropicClient:
    """Sends requests to the Messages API, or to a server that speaks it."""

    def __init__(
        self,
        *,
        key: str | None,
        base_url: str | None,
        secrets: Sequence[str] = (),
        transport: httpx2.AsyncBaseTransport | None = None,
    ) -> None:
        """A local server needs no `key`; `transport` takes the network's place in tests.

        `secrets` are fields of requests that answers must not show.
        """
        self._key, self._base_url, self._transport = key, base_url, transport
        # A key of few characters is a local server's, and no secret.
        hidden = [text for text in (key, *secrets) if text and len(text) >= 8]
        self._secret = re.compile("|".join(map(spellings, hidden))) if hidden else None
        self._running: tuple[asyncio.AbstractEventLoop, Thread, anthropic.AsyncAnthropic] | None
        self._running = None
        self._closed = False
        self._lock = Lock()

    def open(self) -> None:
        """See `Client`: importing the SDK takes seconds."""
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
            attempt.cancel()  # after Ctrl-C; does nothing to one that is over

    def close(self) -> None:
        """See `Client`."""
        with self._lock:
            self._closed = True
            running, self._running = self._running, None
        if running is None:
            return
        loop, thread, sdk = running
        with suppress(TimeoutError):  # at the end of a process its threads stand still
            asyncio.run_coroutine_threadsafe(_end(sdk), loop).result(GRACE)
        loop.call_soon_threadsafe(loop.stop)
        thread.join(GRACE)
        if not thread.is_alive():
            loop.close()

    def _run(self) -> tuple[asyncio.AbstractEventLoop, Thread, anthropic.AsyncAnthropic]:
        sdk = _sdk(self._key or "none", self._base_url, self._transport)
        assert sdk.messages  # it is imported when it is first asked for
        loop = asyncio.new_event_loop()
        # A daemon: a hanging name lookup must not keep the process from ending.
        thread = Thread(target=loop.run_forever, name="llm", daemon=True)
        thread.start()
        return loop, thread, sdk

    async def _bounded(
        self, sdk: anthropic.AsyncAnthropic, request: Request, seconds: float
    ) -> Reply | Failure:
        """An attempt that ends at the deadline."""
        begun = [] if self._transport is None else ["transport"]  # that one tells no events
        _BEGUN.set(begun)
        try:
            return await asyncio.wait_for(self._attempt(sdk, request), seconds)
        except TimeoutError:
            if begun:
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
                    "expected a body that is not compressed, as was asked for, found the"
                    f" encoding {self._line(encoding)}; turn compression off in the server",
                )
            return read_message(response.content, self._line, self._hide)
        except anthropic.APIStatusError as error:
            return self._refused(error)
        except anthropic.APITimeoutError:
            return Failure(FailureKind.TIMEOUT, "the connection timed out")
        except anthropic.APIConnectionError as error:
            cause = error.__cause__ or error
            return Failure(_unconnected(cause), self._line(str(cause)) or type(cause).__name__)
        except Exception as error:  # whatever the SDK makes of a broken answer is a broken answer
            kind = FailureKind.MALFORMED if _BEGUN.get() else FailureKind.UNREACHABLE
            return Failure(kind, self._line(f"{type(error).__name__}: {error}"))

    def _refused(self, error: anthropic.APIStatusError) -> Failure:
        said = error.api_message if isinstance(error.api_message, str) else ""
        message = f"status {error.status_code}" + (f": {self._line(said)}" if said else "")
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
        """What the other side said, as one short line without the key."""
        return " ".join(clean(self._hide(text)).split())[:300]

    def _hide(self, text: str) -> str:
        """The text without the key, in whatever way JSON can spell it."""
        return self._secret.sub(HIDDEN, text) if self._secret else text


def _late(seconds: float) -> Failure:
    return Failure(FailureKind.TIMEOUT, f"no whole answer within {seconds:g} s")


def _unconnected(cause: BaseException) -> FailureKind:
    """Why there is no answer at all."""
    import httpx2

    if not isinstance(cause, (httpx2.ConnectError, httpx2.ProxyError)):
        return FailureKind.CUT
    reason: BaseException | None = cause
    while reason is not None:
        if isinstance(reason, ssl.SSLCertVerificationError):
            return FailureKind.UNTRUSTED
        reason = reason.__cause__ or reason.__context__
    return FailureKind.UNREACHABLE


async def _end(sdk: anthropic.AsyncAnthropic) -> None:
    """Ends an attempt that is under way in another thread, and closes every connection."""
    others = asyncio.all_tasks() - {asyncio.current_task()}
    for task in others:
        task.cancel()
    await asyncio.gather(*others, return_exceptions=True)
    await sdk.close()


def _sdk(
    key: str, base_url: str | None, transport: httpx2.AsyncBaseTransport | None
) -> anthropic.AsyncAnthropic:
    import anthropic
    import httpx2

    class Bounded(httpx2.AsyncByteStream):
        """A body that ends with an error before it fills the memory."""

        def __init__(self, body: httpx2.AsyncByteStream) -> None:
            self.body = body

        async def __aiter__(self) -> AsyncIterator[bytes]:
            size = 0
            async for chunk in self.body:
                size += len(chunk)
                if size > LARGEST:
                    raise ValueError(f"expected a body of at most {LARGEST} bytes, found more")
                yield chunk

        async def aclose(self) -> None:
            await self.body.aclose()

    async def bound(response: httpx2.Response) -> None:
        # A small body could unpack to a huge one: a body is not unpacked, only told.
        encoding = response.headers.pop("content-encoding", "identity")
        if encoding.strip().lower() not in ("", "identity"):
            response.extensions[ENCODING] = encoding
        if isinstance(response.stream, httpx2.AsyncByteStream):
            response.stream = Bounded(response.stream)

    async def watch(request: httpx2.Request) -> None:
        begun = _BEGUN.get()

        async def note(event: str, info: dict[str, Any]) -> None:
            # A proxy is asked for a connection first, with a request of its own.
            if (
                event.endswith("send_request_headers.started")
                and info["request"].method != b"CONNECT"
            ):
                begun.append(event)

        request.extensions["trace"] = note

    http = httpx2.AsyncClient(
        transport=transport,
        timeout=None,
        follow_redirects=False,  # one could carry the key to another place; the API has none
        event_hooks={"request": [watch], "response": [bound]},
    )
    return anthropic.AsyncAnthropic(
        api_key=key, base_url=base_url, http_client=http, max_retries=0, timeout=None
    )


def arguments(request: Request) -> dict[str, Any]:
    """A request as the SDK's `messages.create` takes it."""
    roles = ("user", "assistant")
    system: Any = request.system
    if request.cache:  # marked as what is to be kept: what follows it changes each time
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
    """A message's body. The SDK's models are not used: they take whatever comes.

    `line` makes one short line of a text, `hide` takes the key out of it.
    """
    try:
        message = json.loads(body)
        if other := _other_language(message, line):
            return other
        text = "".join(b["text"] for b in message["content"] if b["type"] == "text")
        thoughts = [b.get("thinking") for b in message["content"] if b["type"] == "thinking"]
        thinking = "\n".join(thought for thought in thoughts if isinstance(thought, str))
        stop = message.get("stop_reason") or ""
        usage = _usage(message.get("usage") or {})
        # A server has counted where the request has tokens, and the answer has some, too.
        counted = usage.read > 0 and (usage.output > 0 or not message["content"])
        said, thought = clean(hide(text)), clean(hide(thinking))
        return Reply(said, line(str(stop)), usage if counted else None, thought)
    except (ValueError, KeyError, TypeError, AttributeError, RecursionError) as error:
        start = line(body.decode("utf-8", "replace"))[:80]
        return Failure(
            FailureKind.MALFORMED,
            f"expected a message, found a body of {len(body)} bytes that begins with"
            f" {start!r} ({type(error).__name__})",
        )


def _other_language(message: Any, line: Callable[[str], str]) -> Failure | None:
    """The failure where a body of status 200 is an OpenAI server's answer, or an error."""
    if not isinstance(message, dict) or "content" in message:
        return None
    if "choices" in message:
        return Failure(FailureKind.FOREIGN, "an answer in OpenAI's language")
    if "error" not in message:
        return None
    error = message["error"]
    said = line(str(error.get("message", error) if isinstance(error, dict) else error))
    unknown = "endpoint" in said.lower() or "/messages" in said
    kind = FailureKind.NOT_FOUND if unknown else FailureKind.MALFORMED
    return Failure(kind, f"status 200 with an error: {said}")


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


def kind_of(status: int) -> FailureKind:
    """What a status other than 200 means."""
    known = {
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
    return known.get(status, FailureKind.SERVER if status >= 500 else FailureKind.REJECTED)


def retry_after(said: str | None, milliseconds: str | None = None) -> float | None:
    """The seconds that a server asks to wait, given as a number or as a date.

    `milliseconds` is the header `retry-after-ms`, which is more precise and comes first.
    """
    with suppress(ValueError, TypeError):
        if math.isfinite(exact := float(milliseconds or "nan") / 1000):
            return max(0.0, exact)
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
