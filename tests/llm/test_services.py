"""Clouds: their clients send to the right path with their credentials, and none of ours."""

from __future__ import annotations

import json

import httpx2
import pytest

from islandgp.errors import SupervisionError
from islandgp.supervision.llm.client import HIDDEN, AnthropicClient
from islandgp.supervision.llm.message import Failure, FailureKind, Reply, Request
from islandgp.supervision.llm.services import CLOUDS, Service, check_cloud, cloud_secrets
from islandgp.supervision.llm.settings import LLMSettings
from islandgp.supervision.llm.supervisor import LLM
from tests.llm.server import MessagesServer
from tests.llm.test_supervisor import context, settings

ASK = Request("some-model", "Be brief.", ("Hello?",), 100)
TOKEN = "token-0123456789abcdef"
ENVIRONMENT: dict[Service, dict[str, str]] = {
    "bedrock": {"AWS_REGION": "eu-west-1", "AWS_BEARER_TOKEN_BEDROCK": TOKEN},
    "vertex": {"CLOUD_ML_REGION": "europe-west1", "ANTHROPIC_VERTEX_PROJECT_ID": "island"},
    "foundry": {"ANTHROPIC_FOUNDRY_RESOURCE": "island", "ANTHROPIC_FOUNDRY_API_KEY": TOKEN},
}
URLS = {
    "bedrock": "https://bedrock-runtime.eu-west-1.amazonaws.com/model/some-model/invoke",
    "vertex": "https://europe-west1-aiplatform.googleapis.com/v1/projects/island/locations/"
    "europe-west1/publishers/anthropic/models/some-model:rawPredict",
    "foundry": "https://island.services.ai.azure.com/anthropic/v1/messages",
}


class Credentials:
    """Those of Google, without a request for a token."""

    token, expired = TOKEN, False

    def refresh(self, request: object) -> None:
        """Keeps the token."""


@pytest.fixture
def requests() -> list[httpx2.Request]:
    return []


def answer(
    service: Service,
    requests: list[httpx2.Request],
    monkeypatch: pytest.MonkeyPatch,
    text: str = "Hello.",
) -> Reply | Failure:
    """The answer to ASK of a cloud behind a transport that records the requests."""
    for name, value in ENVIRONMENT[service].items():
        monkeypatch.setenv(name, value)
    monkeypatch.setattr("google.auth.default", lambda **_: (Credentials(), "another"))
    monkeypatch.setenv("ANTHROPIC_API_KEY", "sk-of-the-anthropic-api")
    monkeypatch.setenv("ANTHROPIC_AUTH_TOKEN", "token-of-the-anthropic-api")

    def reply(request: httpx2.Request) -> httpx2.Response:
        requests.append(request)
        body = {"content": [{"type": "text", "text": text}], "stop_reason": "end_turn"}
        return httpx2.Response(200, content=json.dumps(body).encode())

    client = AnthropicClient(
        key=None,
        base_url=None,
        service=service,
        secrets=cloud_secrets(service),
        transport=httpx2.MockTransport(reply),
    )
    try:
        return client.send(ASK, seconds=20)
    finally:
        client.close()


@pytest.mark.parametrize("service", CLOUDS)
def test_a_cloud_gets_its_credentials(
    service: Service, requests: list[httpx2.Request], monkeypatch: pytest.MonkeyPatch
) -> None:
    """The URL has the region or resource; no header has a key of the Anthropic API."""
    reply = answer(service, requests, monkeypatch)
    assert isinstance(reply, Reply), reply
    assert reply.text == "Hello."
    (request,) = requests
    headers = " ".join(request.headers.values())
    assert str(request.url) == URLS[service]
    assert TOKEN in headers
    assert "of-the-anthropic-api" not in headers + request.content.decode()


@pytest.mark.parametrize("service", ["bedrock", "foundry"])
def test_a_quoted_token_is_hidden(
    service: Service, requests: list[httpx2.Request], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Transcripts have no credentials, even if an answer quotes them."""
    reply = answer(service, requests, monkeypatch, text=f"You sent {TOKEN}.")
    assert isinstance(reply, Reply)
    assert reply.text == f"You sent {HIDDEN}."


def test_signed_requests(requests: list[httpx2.Request], monkeypatch: pytest.MonkeyPatch) -> None:
    """With an access key, requests to Bedrock are signed, and the key itself is not sent."""
    monkeypatch.setitem(
        ENVIRONMENT,
        "bedrock",
        {"AWS_REGION": "eu-west-1", "AWS_ACCESS_KEY_ID": "AKIA7", "AWS_SECRET_ACCESS_KEY": TOKEN},
    )
    assert isinstance(answer("bedrock", requests, monkeypatch), Reply)
    signature = requests[0].headers["authorization"]
    assert signature.startswith("AWS4-HMAC-SHA256 Credential=AKIA7/")
    assert TOKEN not in " ".join(requests[0].headers.values())


@pytest.mark.parametrize(
    ("service", "missing", "message"),
    [
        ("bedrock", "AWS_REGION", "Amazon Bedrock .*found: No AWS region"),
        ("vertex", "CLOUD_ML_REGION", "Google Vertex AI .*found: No region"),
        ("foundry", "ANTHROPIC_FOUNDRY_API_KEY", "Microsoft Foundry .*found: Missing credentials"),
        ("foundry", "ANTHROPIC_FOUNDRY_RESOURCE", "Microsoft Foundry .*found: Must provide"),
    ],
)
def test_a_missing_setting(
    service: Service, missing: str, message: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """One message names the cloud and its variables, before anything is sent."""
    for name, value in ENVIRONMENT[service].items():
        if name != missing:
            monkeypatch.setenv(name, value)
    monkeypatch.setenv("AWS_CONFIG_FILE", "/nowhere")
    with pytest.raises(SupervisionError, match=message) as excinfo:
        LLM.check(settings(f"service={service}"), context())
    assert missing in str(excinfo.value)
    assert "\n" not in str(excinfo.value)


def test_a_missing_package(monkeypatch: pytest.MonkeyPatch) -> None:
    """The message has the extra to install."""
    monkeypatch.setattr("islandgp.supervision.llm.services._installed", lambda _: False)
    with pytest.raises(SupervisionError, match=r"pip install 'islandgp\[bedrock\]'"):
        check_cloud("bedrock", None)


def test_missing_credentials(monkeypatch: pytest.MonkeyPatch) -> None:
    """They are no connection error, so a run stops at its start."""
    from google.auth.exceptions import DefaultCredentialsError

    def absent(**_: object) -> None:
        raise DefaultCredentialsError("none")  # type: ignore[no-untyped-call]

    monkeypatch.setattr("google.auth.default", absent)
    for name, value in ENVIRONMENT["vertex"].items():
        monkeypatch.setenv(name, value)
    with MessagesServer() as server:
        client = AnthropicClient(key=None, base_url=server.url, service="vertex")
        failure = client.send(ASK, seconds=20)
        client.close()
    assert isinstance(failure, Failure)
    assert failure.kind is FailureKind.UNAUTHORISED
    assert server.requests == []


def test_a_gateway_before_a_cloud(monkeypatch: pytest.MonkeyPatch) -> None:
    """`base_url` holds for a cloud; ANTHROPIC_BASE_URL does not."""
    monkeypatch.setenv("ANTHROPIC_BASE_URL", "http://there:2")
    llm_settings: LLMSettings = settings("service=bedrock")
    assert (llm_settings.address, llm_settings.place) == (None, "Amazon Bedrock")
    assert settings("service=bedrock", "base_url=http://here:1").place == "http://here:1"
