"""`client_factory`: another client of the SDK, such as those of the clouds."""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import Any

import anthropic
import httpx2
import pytest

from islandgp.errors import IslandError, SupervisionError
from islandgp.supervision.llm.client import HIDDEN, ServerClient
from islandgp.supervision.llm.message import Failure, FailureKind, Reply, Request
from islandgp.supervision.llm.supervisor import LLM
from tests.composed import composed
from tests.llm.samples import context, settings
from tests.llm.server import MessagesServer

ASK = Request("some-model", "Be brief.", ("Hello?",), 100)
TOKEN = "token-0123456789abcdef"
FOUNDRY = "anthropic:AsyncAnthropicFoundry"  # needs no package besides the SDK
URL = "https://island.services.ai.azure.com/anthropic/v1/messages"


def credentials(monkeypatch: pytest.MonkeyPatch) -> None:
    """Those of a cloud and, beside them, those of the Anthropic API."""
    monkeypatch.setenv("ANTHROPIC_FOUNDRY_RESOURCE", "island")
    monkeypatch.setenv("ANTHROPIC_FOUNDRY_API_KEY", TOKEN)
    monkeypatch.setenv("ANTHROPIC_API_KEY", "sk-of-the-anthropic-api")
    monkeypatch.setenv("ANTHROPIC_BASE_URL", "http://elsewhere:2")


def test_a_cloud_gets_its_credentials(monkeypatch: pytest.MonkeyPatch) -> None:
    """The SDK's client makes address and headers, without a key of the Anthropic API.

    An answer that quotes the token is stored without it.
    """
    credentials(monkeypatch)
    requests: list[httpx2.Request] = []

    def reply(request: httpx2.Request) -> httpx2.Response:
        requests.append(request)
        body = {"content": [{"type": "text", "text": f"You sent {TOKEN}."}]}
        return httpx2.Response(200, content=json.dumps(body).encode())

    transport = httpx2.MockTransport(reply)
    client = ServerClient(None, None, factory=FOUNDRY, transport=transport)
    answer = client.send(ASK, seconds=20)
    client.close()
    assert isinstance(answer, Reply), answer
    assert answer.text == f"You sent {HIDDEN}."
    (request,) = requests
    headers = " ".join(request.headers.values())
    assert str(request.url) == URL
    assert TOKEN in headers
    assert "of-the-anthropic-api" not in headers + request.content.decode()


def test_a_function_of_the_user(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """It gets the HTTP client and options of the SDK as keyword arguments: docs/llm.md."""
    page = Path(__file__).parents[2] / "docs" / "llm.md"
    example = page.read_text(encoding="utf-8").partition("```python\n")[2].partition("```")[0]
    (tmp_path / "clouds.py").write_text(example, encoding="utf-8")
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.setitem(sys.modules, "boto3", None)
    made: list[dict[str, Any]] = []

    class Bedrock(anthropic.AsyncAnthropic):
        def __init__(self, *, aws_region: str, **options: Any) -> None:
            made.append({"aws_region": aws_region, **options})
            super().__init__(api_key=TOKEN, **options)

    monkeypatch.setattr("anthropic.AsyncAnthropicBedrock", Bedrock)
    with MessagesServer(answer=lambda _: "Hello.") as server:
        client = ServerClient(None, server.url, factory="clouds:bedrock")
        assert isinstance(client.send(ASK, seconds=20), Reply)
        client.close()
    (options,) = made
    assert set(options) == {"aws_region", "http_client", "max_retries", "timeout", "base_url"}
    assert server.keys[0].endswith(TOKEN)


@pytest.mark.parametrize(
    ("factory", "message"),
    [
        (FOUNDRY, "Missing credentials"),
        ("anthropic:Nobody", "Nobody"),
        ("no_such_module:make", "no_such_module"),
        ("builtins:dict", "'dict' object has no attribute"),
    ],
)
def test_a_client_that_cannot_be_made(factory: str, message: str) -> None:
    """One line with the key, before anything is sent."""
    with pytest.raises(SupervisionError, match="client_factory: expected") as excinfo:
        LLM.check(settings(f"client_factory={factory}"), context())
    assert message in str(excinfo.value)
    assert "\n" not in str(excinfo.value)


@pytest.mark.parametrize("factory", ["anthropic", "a b:c", ":x"])
def test_what_is_no_path(factory: str) -> None:
    """It is an error of the configuration."""
    with pytest.raises(IslandError, match="client_factory"):
        composed("supervisor=llm", f"supervisor.policy.client_factory='{factory}'")


def test_missing_credentials_stop_a_run() -> None:
    """They are no connection error, so no fallback hides them."""

    def make(**options: Any) -> anthropic.AsyncAnthropic:
        sdk = anthropic.AsyncAnthropic(api_key="none", **options)

        def sign(*_: object, **__: object) -> None:
            raise LookupError("could not find default credentials")

        sdk._prepare_options = sign  # type: ignore[method-assign, assignment]
        return sdk

    with MessagesServer() as server, pytest.MonkeyPatch.context() as patch:
        patch.setattr("anthropic.make_for_test", make, raising=False)
        client = ServerClient(None, server.url, factory="anthropic:make_for_test")
        failure = client.send(ASK, seconds=20)
        client.close()
    assert isinstance(failure, Failure)
    assert failure.kind is FailureKind.UNAUTHORISED
    assert server.requests == []


def test_a_gateway_before_a_cloud(monkeypatch: pytest.MonkeyPatch) -> None:
    """`base_url` holds for a cloud; ANTHROPIC_BASE_URL does not."""
    credentials(monkeypatch)
    assert (settings(f"client_factory={FOUNDRY}").address) is None
    assert settings(f"client_factory={FOUNDRY}").place == FOUNDRY
    assert settings(f"client_factory={FOUNDRY}", "base_url=http://here:1").place == "http://here:1"
