"""The Anthropic SDK behind the seam. It is imported here and nowhere else.

The SDK's own timeout bounds each read and not the call, so that a server which
sends a byte now and then holds a caller for ever. Here an attempt is a task of
an event loop, which is cancelled at the deadline whatever it is doing: looking
up a name, connecting, reading headers or a body. The SDK's retries are off.
"""

from __future__ import annotations

import asyncio
import re
import ssl
from collections.abc import AsyncIterator
from concurrent.futures import CancelledError
from contextlib import suppress
from threading import Lock, Thread
from typing import TYPE_CHECKING, Final

from islandgp.supervision.llm.message import Failure, FailureKind, Reply, Request, clean
from islandgp.supervision.llm.wire import (
    arguments,
    kind_of,
    read_message,
    retry_after,
    should_retry,
    spellings,
)

if TYPE_CHECKING:
    import anthropic
    import httpx2

LARGEST: Final = 8_000_000  # bytes of a body; an honest one has some 10,000
GRACE: Final = 5.0  # s for a cancelled attempt to end; it needs none of it
HIDDEN: Final = "[key]"
ENCODING: Final = "islandgp.encoding"  # of a body, where it has one; an extension of a response


class AnthropicClient:
    """Sends requests to the Messages API, or to a server that speaks it."""

    def __init__(
        self,
        *,
        key: str | None,
        base_url: str | None,
        transport: httpx2.AsyncBaseTransport | None = None,
    ) -> None:
        """A local server needs no `key`; `transport` takes the network's place in tests."""
        self._key, self._base_url, self._transport = key, base_url, transport
        # A key of few characters is a local server's, and no secret.
        self._secret = re.compile(spellings(key)) if key and len(key) >= 8 else None
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
        late = Failure(FailureKind.TIMEOUT, f"no whole answer within {seconds:g} s")
        self.open()
        with self._lock:
            if self._running is None:
                return Failure(FailureKind.CUT, "the client is closed")
            loop, _, sdk = self._running
            attempt = asyncio.run_coroutine_threadsafe(
                asyncio.wait_for(self._attempt(sdk, request), seconds), loop
            )
        try:
            return attempt.result(seconds + GRACE)
        except (TimeoutError, CancelledError):
            return late
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
            return Failure(FailureKind.MALFORMED, self._line(f"{type(error).__name__}: {error}"))

    def _refused(self, error: anthropic.APIStatusError) -> Failure:
        said = error.api_message if isinstance(error.api_message, str) else ""
        message = f"status {error.status_code}" + (f": {self._line(said)}" if said else "")
        headers = error.response.headers
        return Failure(
            kind_of(error.status_code),
            message,
            retry_after(headers.get("retry-after")),
            should_retry(headers.get("x-should-retry")),
        )

    def _line(self, text: str) -> str:
        """What the other side said, as one short line without the key."""
        return " ".join(clean(self._hide(text)).split())[:300]

    def _hide(self, text: str) -> str:
        """The text without the key, in whatever way JSON can spell it."""
        return self._secret.sub(HIDDEN, text) if self._secret else text


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

    http = httpx2.AsyncClient(
        transport=transport,
        timeout=None,
        follow_redirects=False,  # one could carry the key to another place; the API has none
        event_hooks={"response": [bound]},
    )
    return anthropic.AsyncAnthropic(
        api_key=key, base_url=base_url, http_client=http, max_retries=0, timeout=None
    )
