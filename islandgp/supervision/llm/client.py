"""The client of a language model: a request in, a reply or a failure out, before the deadline.

The SDK's timeout applies to each read, not to the whole call: a server that sends a byte now and
then would block the caller forever. So each attempt is a task of an event loop, which is cancelled
at the deadline in any phase: name lookup, connection, headers or body. The SDK's retries are off.
"""

from __future__ import annotations

import asyncio
import re
import ssl
from collections.abc import AsyncIterator, Sequence
from concurrent.futures import CancelledError
from contextlib import suppress
from contextvars import ContextVar
from importlib import import_module
from importlib.util import find_spec
from threading import Lock, Thread
from typing import TYPE_CHECKING, Any, Final
from urllib.parse import urlsplit

from islandgp.errors import SupervisionError
from islandgp.plugin import imported
from islandgp.redaction import secrets_in
from islandgp.supervision.llm.interfaces import INTERFACES, line, read_body, refused
from islandgp.supervision.llm.message import Failure, FailureKind, Reply, Request

if TYPE_CHECKING:
    import httpx2

MAX_BODY: Final = 8_000_000  # bytes of a body; usual ones have about 10,000
GRACE: Final = 5.0  # s for a cancelled attempt to end; usually it ends immediately
HIDDEN: Final = "[key]"
_ENCODING: Final = "islandgp.encoding"  # extension of a response: the encoding of its body
_EVENTS: Final[ContextVar[list[str]]] = ContextVar("events")
"""Events of sending the attempt's request so far; empty: nothing is sent yet."""


class ServerClient:
    """Sends requests by a client of the SDK, which works in a thread with an event loop."""

    def __init__(
        self,
        key: str | None,
        base_url: str | None,
        *,
        interface: str = "anthropic",
        factory: str | None = None,
        secrets: Sequence[str] = (),
        transport: httpx2.AsyncBaseTransport | None = None,
    ) -> None:
        """Opens no connection.

        Args:
            key: API key or token; None for a local server without one.
            base_url: of the server; None: the address of the SDK's client.
            interface: a key of INTERFACES.
            factory: see `sdk_client`.
            secrets: values in requests that are removed from answers, as the key is.
            transport: replaces the network in tests.
        """
        self._key, self._base_url, self._factory = key, base_url, factory
        self._interface = interface
        self._transport = transport
        self._secrets = [key or "", *secrets]
        self._secret = re.compile("(?!)")  # matches nothing
        self._running: tuple[asyncio.AbstractEventLoop, Thread, Any] | None
        self._running = None
        self._closed = False
        self._lock = Lock()  # `close` may be called by another thread

    def open(self) -> None:
        """See `Client`."""
        with self._lock:
            if self._closed or self._running is not None:
                return
            sdk = sdk_client(
                self._factory, self._key, self._base_url, self._interface, self._transport
            )
            # A key of a few characters belongs to a local server and is not secret.
            hidden = [s for s in (*self._secrets, *secrets_in(vars(sdk))) if len(s) >= 8]
            if hidden:
                self._secret = re.compile("|".join(map(spellings, hidden)))
            loop = asyncio.new_event_loop()
            # A daemon thread, so that a hanging name lookup does not keep the process alive.
            thread = Thread(target=loop.run_forever, name="llm", daemon=True)
            thread.start()
            self._running = loop, thread, sdk

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

    async def _bounded(self, sdk: Any, request: Request, seconds: float) -> Reply | Failure:
        """An attempt that ends at the deadline."""
        events = [] if self._transport is None else ["sent"]  # a transport emits no events
        _EVENTS.set(events)
        try:
            return await asyncio.wait_for(self._attempt(sdk, request), seconds)
        except TimeoutError:
            if events:
                return _late(seconds)
            return Failure(FailureKind.UNREACHABLE, f"no connection within {seconds:g} s")

    async def _attempt(self, sdk: Any, request: Request) -> Reply | Failure:
        interface = INTERFACES[self._interface]
        errors = import_module(interface.sdk.partition(":")[0])
        body, headers = interface.body(request), {"accept-encoding": "identity"}
        typed = {key: body.pop(key) for key in interface.typed & body.keys()}
        try:
            answer = await interface.create(sdk)(
                **typed, extra_body=body, extra_headers={**headers, **interface.headers}
            )
            response = answer.http_response
            if encoding := response.extensions.get(_ENCODING):
                return Failure(
                    FailureKind.MALFORMED,
                    "expected an uncompressed body, as requested, found the encoding"
                    f" {self._line(encoding)}; turn compression off in the server",
                )
            return read_body(self._interface, response.content, self._hide)
        except errors.APIStatusError as error:
            details = error.body if isinstance(error.body, dict) else {}
            text = getattr(error, "api_message", None) or details.get("message")
            text = text if isinstance(text, str) else ""
            return refused(error.status_code, text, error.response.headers, self._hide)
        except errors.APITimeoutError:
            return Failure(FailureKind.TIMEOUT, "the connection timed out")
        except errors.APIConnectionError as error:
            cause = error.__cause__ or error
            return Failure(_unconnected(cause), self._line(str(cause)) or type(cause).__name__)
        except Exception as error:  # of the SDK for a damaged answer, or for missing credentials
            kind = FailureKind.UNREACHABLE
            if _EVENTS.get():
                kind = FailureKind.MALFORMED
            elif "credentials" in f"{type(error).__name__}: {error}".lower():
                kind = FailureKind.UNAUTHORISED
            return Failure(kind, self._line(f"{type(error).__name__}: {error}"))

    def _line(self, text: str) -> str:
        """A text of the server as one line, without secrets."""
        return line(self._hide(text))

    def _hide(self, text: str) -> str:
        """A text without secrets, also those with JSON escapes."""
        return self._secret.sub(HIDDEN, text)


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


async def _end(sdk: Any) -> None:
    """Cancels the attempts of other threads and closes all connections."""
    others = asyncio.all_tasks() - {asyncio.current_task()}
    for task in others:
        task.cancel()
    await asyncio.gather(*others, return_exceptions=True)
    await sdk.close()


def spellings(key: str) -> str:
    """A regular expression that matches a key with any of its characters escaped as in JSON.

    The text of an answer is JSON itself, so "sk" may also be written as "\\u0073k".
    """
    return "".join(rf"\\*(?:{re.escape(c)}|(?<=\\)u(?i:{ord(c):04x}))" for c in key)


def sdk_client(
    factory: str | None,
    key: str | None,
    base_url: str | None,
    interface: str = "anthropic",
    transport: httpx2.AsyncBaseTransport | None = None,
) -> Any:
    """A client of the SDK, without a connection.

    Args:
        factory: path of a class or function, "module:name", that makes an asynchronous client of
            the Anthropic SDK from the keyword arguments `http_client`, `max_retries`, `timeout`
            and, if it is set, `base_url`. None: `AsyncAnthropic`, which gets the key as well.
        key: of the Anthropic API; None: of a local server without one.
        base_url: of the server; None: the client's own.
        interface: a key of INTERFACES.
        transport: replaces the network in tests.

    Raises:
        SupervisionError: the factory cannot be imported, or raises an exception.
    """
    options: dict[str, Any] = {"max_retries": 0, "timeout": None}
    sdk = INTERFACES[interface].sdk
    package = sdk.partition(":")[0]
    if factory is None and find_spec(package) is None:
        raise SupervisionError(
            f"Expected the package {package} for supervisor.policy.interface={interface}, found"
            f" none; install it by pip install 'islandgp[{interface}]'."
        )
    if base_url is not None:
        has_path = interface == "anthropic" or urlsplit(base_url).path.strip("/")
        options["base_url"] = base_url if has_path else base_url.rstrip("/") + "/v1"
    if factory is None:
        options["api_key"] = key or "none"
    try:
        client = imported(factory or sdk)(http_client=_http(transport), **options)
        # The SDK imports it at the first access.
        assert client.messages if interface == "anthropic" else client.chat
    except Exception as error:  # the SDK raises various types for missing settings and packages
        reason = " ".join(str(error).split()).rstrip(".")
        raise SupervisionError(
            f"supervisor.policy.client_factory: expected {factory or sdk} to make a client of the"
            f" SDK, found: {reason}."
        ) from None
    return client


def _http(transport: httpx2.AsyncBaseTransport | None) -> httpx2.AsyncClient:
    import httpx2

    class Bounded(httpx2.AsyncByteStream):
        """A body that raises ValueError after MAX_BODY bytes."""

        def __init__(self, body: httpx2.AsyncByteStream) -> None:
            self.body = body

        async def __aiter__(self) -> AsyncIterator[bytes]:
            size = 0
            async for chunk in self.body:
                size += len(chunk)
                if size > MAX_BODY:
                    raise ValueError(f"expected a body of at most {MAX_BODY} bytes, found more")
                yield chunk

        async def aclose(self) -> None:
            await self.body.aclose()

    async def bound(response: httpx2.Response) -> None:
        # A small body could decompress to a huge one, so it is not decompressed but reported.
        encoding = response.headers.pop("content-encoding", "identity")
        if encoding.strip().lower() not in ("", "identity"):
            response.extensions[_ENCODING] = encoding
        if isinstance(response.stream, httpx2.AsyncByteStream):
            response.stream = Bounded(response.stream)

    async def watch(request: httpx2.Request) -> None:
        events = _EVENTS.get()

        async def note(event: str, info: dict[str, Any]) -> None:
            # CONNECT is the request to a proxy, before the actual request.
            if event.endswith("send_request_headers.started") and (
                info["request"].method != b"CONNECT"
            ):
                events.append(event)

        request.extensions["trace"] = note

    return httpx2.AsyncClient(
        transport=transport,
        timeout=None,
        follow_redirects=False,  # a redirect could send the key elsewhere; the API has none
        event_hooks={"request": [watch], "response": [bound]},
    )
