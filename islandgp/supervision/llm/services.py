"""The SDK's clients for the Anthropic API and for the clouds that offer the same models.

Only this module and `client` import the Anthropic SDK.
"""

from __future__ import annotations

import os
from collections.abc import AsyncIterator
from contextvars import ContextVar
from dataclasses import dataclass
from importlib.util import find_spec
from typing import TYPE_CHECKING, Any, Final, Literal, cast

from islandgp.errors import SupervisionError

if TYPE_CHECKING:
    import anthropic
    import httpx2

MAX_BODY: Final = 8_000_000  # bytes of a body; usual ones have about 10,000
ENCODING: Final = "islandgp.encoding"  # extension of a response: the encoding of its body
REQUEST_EVENTS: Final[ContextVar[list[str]]] = ContextVar("begun")
"""Events of sending the attempt's request so far; empty: nothing is sent yet."""

Service = Literal["anthropic", "bedrock", "vertex", "foundry"]
"""Where the models are offered."""


@dataclass(frozen=True, slots=True)
class Cloud:
    """A service beside the Anthropic API. The SDK reads its credentials from the environment."""

    title: str  # in messages
    client: str  # class of the SDK
    module: str | None  # needed besides the SDK; an extra of the service's name installs it
    credentials: str  # environment variables and other sources of them
    secrets: tuple[str, ...] = ()  # variables whose values are removed from answers


CLOUDS: Final[dict[Service, Cloud]] = {
    "bedrock": Cloud(
        "Amazon Bedrock",
        "AsyncAnthropicBedrock",
        "boto3",
        "AWS_REGION, and AWS_BEARER_TOKEN_BEDROCK or the credentials of an AWS profile",
        ("AWS_BEARER_TOKEN_BEDROCK", "AWS_SECRET_ACCESS_KEY", "AWS_SESSION_TOKEN"),
    ),
    "vertex": Cloud(
        "Google Vertex AI",
        "AsyncAnthropicVertex",
        "google.auth",
        "CLOUD_ML_REGION, ANTHROPIC_VERTEX_PROJECT_ID and Google's application default credentials",
    ),
    "foundry": Cloud(
        "Microsoft Foundry",
        "AsyncAnthropicFoundry",
        None,
        "ANTHROPIC_FOUNDRY_API_KEY and ANTHROPIC_FOUNDRY_RESOURCE",
        ("ANTHROPIC_FOUNDRY_API_KEY",),
    ),
}
"""By the value of `supervisor.policy.service`."""


def check_cloud(service: Service, base_url: str | None) -> None:
    """Raises SupervisionError if a package or a setting of a cloud is missing; sends nothing."""
    cloud = CLOUDS[service]
    if cloud.module is not None and not _installed(cloud.module):
        raise SupervisionError(
            f"Expected the package {cloud.module.partition('.')[0]} for {cloud.title}, found none;"
            f" pip install 'islandgp[{service}]'."
        )
    try:
        sdk_client(service, None, base_url, None)
    except Exception as error:  # the SDK raises various types for missing settings
        reason = " ".join(str(error).split()).rstrip(".")
        raise SupervisionError(
            f"Expected settings of {cloud.title} in the environment ({cloud.credentials}), found:"
            f" {reason}."
        ) from None


def _installed(module: str) -> bool:
    try:
        return find_spec(module) is not None
    except ModuleNotFoundError:  # its package is missing
        return False


def cloud_secrets(service: Service) -> tuple[str, ...]:
    """The values of a cloud's secret variables that are set."""
    names = CLOUDS[service].secrets if service in CLOUDS else ()
    return tuple(value for name in names if (value := os.environ.get(name)))


def sdk_client(
    service: Service,
    key: str | None,
    base_url: str | None,
    transport: httpx2.AsyncBaseTransport | None,
) -> anthropic.AsyncAnthropic:
    """A client of the SDK, without a connection.

    Args:
        service: the class of the client.
        key: of the Anthropic API; None: of a local server without one. No cloud gets it.
        base_url: of the server; None: the service's own.
        transport: replaces the network in tests.
    """
    import anthropic

    options: dict[str, Any] = {
        "base_url": base_url,
        "http_client": _http(transport),
        "max_retries": 0,
        "timeout": None,
    }
    if service == "anthropic":
        return anthropic.AsyncAnthropic(api_key=key or "none", **options)
    if service == "vertex":
        project = os.environ.get("ANTHROPIC_VERTEX_PROJECT_ID")
        options["project_id"] = project or anthropic.NOT_GIVEN
    client = getattr(anthropic, CLOUDS[service].client)(**options)
    return cast("anthropic.AsyncAnthropic", client)  # the used methods are the same


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
            response.extensions[ENCODING] = encoding
        if isinstance(response.stream, httpx2.AsyncByteStream):
            response.stream = Bounded(response.stream)

    async def watch(request: httpx2.Request) -> None:
        events = REQUEST_EVENTS.get()

        async def note(event: str, info: dict[str, Any]) -> None:
            # CONNECT is the request to a proxy, before the actual request.
            if (
                event.endswith("send_request_headers.started")
                and info["request"].method != b"CONNECT"
            ):
                events.append(event)

        request.extensions["trace"] = note

    return httpx2.AsyncClient(
        transport=transport,
        timeout=None,
        follow_redirects=False,  # a redirect could send the key elsewhere; the API has none
        event_hooks={"request": [watch], "response": [bound]},
    )
