"""The real SDKs: an attempt ends in time with any server, and each answer has its meaning."""

from __future__ import annotations

import json
import re
import resource
import socket
import sys
import threading
import time
import zlib
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import anthropic
import httpx2
import pytest
from pydantic import SecretStr

from islandgp.errors import IslandError, SupervisionError
from islandgp.supervision.llm.client import GRACE, HIDDEN, MAX_BODY, ServerClient
from islandgp.supervision.llm.message import (
    MAX_ANSWER,
    Failure,
    FailureKind,
    Reply,
    Request,
    Usage,
    chat_body,
    read_body,
)
from islandgp.supervision.llm.supervisor import LLM
from tests.composed import composed
from tests.llm.faults import Fault
from tests.llm.samples import context, settings
from tests.llm.server import MessagesServer

KEY = "sk-test-0123456789abcdef"
ASK = Request("m", "Be brief.", ("Hello?",), 100)
DEADLINE = 0.3  # s
FOUNDRY = "anthropic:AnthropicFoundry"  # needs no package besides the SDK


def server_client(url: str | None, transport: Any = None, **update: Any) -> ServerClient:
    """The client of a server, with changed settings."""
    policy = settings().model_copy(update={"base_url": url, **update})
    return ServerClient(policy, transport)


@contextmanager
def client_of(url: str | None, **options: Any) -> Iterator[ServerClient]:
    client = server_client(url, api_key=SecretStr(KEY), **options)
    yield client


def mocked(body: bytes | httpx2.SyncByteStream, status: int = 200, **headers: str) -> Any:
    """The answer to a body that comes over a mocked network."""
    content = {"content": body} if isinstance(body, bytes) else {"stream": body}
    transport = httpx2.MockTransport(
        lambda _: httpx2.Response(status, headers=headers, **content)  # type: ignore[arg-type]
    )
    with client_of("http://mock", transport=transport) as client:
        return client.send(ASK, seconds=10)


def message(**fields: Any) -> bytes:
    return json.dumps({"content": [{"type": "text", "text": "yes"}], **fields}).encode()


def test_a_good_answer() -> None:
    """Text, stop reason and tokens; the key is sent as it should be."""
    with MessagesServer(answer=lambda _: "Hello.") as server, client_of(server.url) as client:
        answer = client.send(ASK, seconds=5)
    assert answer == Reply("Hello.", "end_turn", Usage(input=3, output=1))
    assert server.keys == [f"Bearer {KEY}"]
    (request,) = server.requests
    assert request == {
        "model": "m",
        "max_tokens": 100,
        "system": "Be brief.",
        "messages": [{"role": "user", "content": "Hello?"}],
    }


@pytest.mark.parametrize("fault", [Fault.SILENCE, Fault.DRIP, Fault.DRIP_HEADERS])
def test_a_deadline_is_kept_in_every_phase(fault: Fault) -> None:
    """Also against a server that sends a byte now and then; the client works on."""
    script = lambda n: None if n else fault  # noqa: E731
    with MessagesServer(script) as server, client_of(server.url) as client:
        began = time.monotonic()
        answer = client.send(ASK, seconds=DEADLINE)
        assert time.monotonic() - began < DEADLINE + GRACE + 0.5
        assert isinstance(client.send(ASK, seconds=5), Reply)
    assert isinstance(answer, Failure)
    assert answer.kind is FailureKind.TIMEOUT


@pytest.mark.parametrize(
    ("fault", "kind", "text"),
    [
        (Fault.RETRY_SOON, FailureKind.RATE_LIMITED, "status 429: slow down"),
        (Fault.SERVER_ERROR, FailureKind.SERVER, "status 500: internal error"),
        (Fault.OVERLOADED, FailureKind.SERVER, "status 529: overloaded"),
        (Fault.BAD_REQUEST, FailureKind.REJECTED, "status 400: max_tokens: not today"),
        (Fault.UNAUTHORISED, FailureKind.UNAUTHORISED, f"status 401: invalid key Bearer {HIDDEN}"),
        (Fault.CUT, FailureKind.CUT, "RemoteProtocolError"),
        (Fault.HTML, FailureKind.MALFORMED, "log in to the network"),
        (Fault.TRUNCATED, FailureKind.MALFORMED, "JSONDecodeError"),
        (Fault.WRONG_BODY, FailureKind.MALFORMED, "TypeError"),
    ],
)
def test_each_fault_is_a_failure_of_its_kind(fault: Fault, kind: FailureKind, text: str) -> None:
    """In one line, without the key."""
    with MessagesServer(lambda _: fault) as server, client_of(server.url) as client:
        answer = client.send(ASK, seconds=5)
    assert isinstance(answer, Failure)
    assert answer.kind is kind
    assert text in answer.message
    assert "\n" not in answer.message
    assert KEY not in answer.message


@pytest.mark.parametrize(
    ("status", "body", "kind", "text"),
    [
        (200, b'{"object": "chat.completion", "choices": []}', "malformed", "choices"),
        (200, b'{"error": {"message": "busy", "code": 502}}', "malformed", "an error: busy"),
        (200, b"[" * 100_000, "malformed", "RecursionError"),
        (200, b"\xff\xfe", "malformed", "JSONDecodeError"),
        (404, b'{"detail": "Not Found"}', "not_found", "status 404"),
        (405, b"{}", "not_found", "status 405"),
        (504, b"<html>Gateway Time-out</html>", "timeout", "status 504"),
        (502, b"<html>Bad Gateway</html>", "server", "status 502"),
        (302, b"", "rejected", "leads to http://elsewhere.example/"),
        (402, b"{}", "no_credit", "status 402"),
        (400, b'{"error": {"message": "prompt is too long"}}', "too_long", "prompt is too long"),
        (400, b'{"error": {"message": "Your credit balance is 0"}}', "no_credit", "balance"),
    ],
)
def test_answers_of_other_servers(status: int, body: bytes, kind: str, text: str) -> None:
    """Another API, gateways, redirects (which are not followed), and what cannot heal."""
    answer = mocked(body, status, location="http://elsewhere.example/" if status == 302 else "")
    assert answer.kind == kind
    assert text in answer.message


@pytest.mark.parametrize(
    ("value", "seconds"), [("25", 25), ("0.5", 0.5), ("-3", 0), ("soon", None), ("", None)]
)
def test_the_wish_to_wait_is_read(value: str, seconds: float | None) -> None:
    """In seconds; anything else is no wish."""
    assert mocked(b"{}", 429, **{"retry-after": value}).retry_after == seconds


def test_no_connection() -> None:
    """A closed port, an unknown host; a connection that breaks later is cut."""
    for url in ("http://127.0.0.1:1", "http://host.invalid:1"):
        with client_of(url) as client:
            answer = client.send(ASK, seconds=5)
        assert isinstance(answer, Failure)
        assert answer.kind is FailureKind.UNREACHABLE
    with socket.create_server(("127.0.0.1", 0)) as server:

        def hang_up() -> None:
            connection, _ = server.accept()
            connection.recv(1)
            connection.close()

        thread = threading.Thread(target=hang_up)
        thread.start()
        with client_of(f"http://127.0.0.1:{server.getsockname()[1]}") as client:
            answer = client.send(ASK, seconds=5)
        thread.join()
    assert isinstance(answer, Failure)
    assert answer.kind is FailureKind.CUT


class Bytes(httpx2.SyncByteStream):
    """A body that comes from the network in pieces."""

    def __init__(self, *pieces: bytes) -> None:
        self.pieces = pieces

    def __iter__(self) -> Iterator[bytes]:
        yield from self.pieces


def test_a_huge_body_is_not_read_to_its_end() -> None:
    """Nor unpacked: a small one could unpack to a huge one."""
    packer = zlib.compressobj(level=1, wbits=31)
    bomb = b"".join([*(packer.compress(b"x" * 1_000_000) for _ in range(150)), packer.flush()])
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    packed = mocked(Bytes(bomb), **{"content-encoding": "gzip"})
    endless = mocked(Bytes(*[b" " * 1_000_000] * 500))
    assert (resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before) < 100_000  # KiB
    assert packed.kind is endless.kind is FailureKind.MALFORMED
    assert "found the encoding gzip; turn compression off" in packed.message
    assert f"at most {MAX_BODY} bytes" in endless.message


def test_a_quoted_key_is_hidden() -> None:
    """In an answer and in its thinking."""
    blocks = [
        {"type": "thinking", "thinking": f"It is {KEY}."},
        {"type": "text", "text": f'{{"reasoning": "{KEY}"}}'},
    ]
    answer = mocked(message(content=blocks))
    assert answer == Reply(f'{{"reasoning": "{HIDDEN}"}}', "", None, f"It is {HIDDEN}.")


def test_long_answers_are_cut() -> None:
    """A reader's work has a bound."""
    answer = mocked(message(content=[{"type": "text", "text": "x" * 1_000_000}]))
    assert len(answer.text) == MAX_ANSWER + 1


@pytest.mark.parametrize(
    ("usage", "known"),
    [
        ({"input_tokens": 3, "output_tokens": 4}, True),
        ({"input_tokens": 0, "output_tokens": 4, "cache_read_input_tokens": 3}, True),
        ({"output_tokens": 4}, False),
        ({"input_tokens": 3}, False),
        (None, False),
    ],
)
def test_missing_counts_of_tokens_are_unknown(usage: object, known: bool) -> None:
    """Some count no tokens, or none of one sort: what they took is unknown, not nothing."""
    assert (mocked(message(usage=usage)).usage is not None) == known


def test_turns_and_a_schema() -> None:
    """The Messages API has the schema in `output_config`."""
    ask = Request("m", "s", ("u", "a", "v"), 9, 0.5, {"type": "object"})
    with MessagesServer() as server, client_of(server.url) as client:
        client.send(ask, seconds=5)
    (body,) = server.requests
    assert [turn["role"] for turn in body["messages"]] == ["user", "assistant", "user"]
    assert body["temperature"] == 0.5
    assert body["output_config"]["format"]["schema"] == {"type": "object"}


def test_a_late_attempt_leaves_no_thread() -> None:
    """It ends with its server."""
    with MessagesServer(lambda _: Fault.DRIP) as server, client_of(server.url) as client:
        client.send(ASK, seconds=0.1)
    for thread in threading.enumerate():
        if thread.name == "supervisor":
            thread.join(2)
            assert not thread.is_alive()


# Chat completions.


def test_the_body_of_a_chat_completion() -> None:
    """Only what is set is sent; a grammar is sent instead of the schema."""
    assert chat_body(Request("m", "s", ("u",), 100, schema={}, grammar='root ::= "a"')) == {
        "model": "m",
        "messages": [{"role": "system", "content": "s"}, {"role": "user", "content": "u"}],
        "max_tokens": 100,
        "grammar": 'root ::= "a"',
        "structured_outputs": {"grammar": 'root ::= "a"'},
    }


def test_chat_completions_are_read() -> None:
    """Texts, reasons and counts; anything else is malformed."""

    def read(answer: Any) -> Any:
        return read_body("chat", json.dumps(answer))

    counts = {"prompt_tokens": 9, "completion_tokens": 2}
    usage = {**counts, "prompt_tokens_details": {"cached_tokens": 4}}
    choice = {"message": {"role": "assistant", "content": "yes"}, "finish_reason": "length"}
    assert read({"choices": [choice], "usage": usage}) == Reply("yes", "max_tokens", Usage(5, 2, 4))
    refused = {"message": {"content": None, "refusal": "no"}, "finish_reason": "stop"}
    assert read({"choices": [refused]}) == Reply("", "refusal", None)
    for damaged in ([], 7, {}, {"choices": []}, {"choices": [7]}, {"choices": [{}]}):
        assert read(damaged).kind is FailureKind.MALFORMED


# Other clients of the SDK.


def credentials(monkeypatch: pytest.MonkeyPatch) -> None:
    """Those of a cloud and, beside them, those of the Anthropic API."""
    monkeypatch.setenv("ANTHROPIC_FOUNDRY_RESOURCE", "island")
    monkeypatch.setenv("ANTHROPIC_FOUNDRY_API_KEY", "token-0123456789abcdef")
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
        token = {"type": "text", "text": "You sent token-0123456789abcdef."}
        return httpx2.Response(200, content=message(content=[token]))

    client = server_client(None, httpx2.MockTransport(reply), client_factory=FOUNDRY)
    answer = client.send(ASK, seconds=20)
    assert isinstance(answer, Reply), answer
    assert answer.text == f"You sent {HIDDEN}."
    (request,) = requests
    headers = " ".join(request.headers.values())
    assert str(request.url) == "https://island.services.ai.azure.com/anthropic/v1/messages"
    assert "token-0123456789abcdef" in headers
    assert "of-the-anthropic-api" not in headers + request.content.decode()
    assert settings(f"client_factory={FOUNDRY}").place == FOUNDRY
    assert settings(f"client_factory={FOUNDRY}", "base_url=http://here:1").place == "http://here:1"


def test_a_function_of_the_user(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """It gets the HTTP client and options of the SDK as keyword arguments: docs/llm.md."""
    page = Path(__file__).parents[2] / "docs" / "llm.md"
    example, adding = re.findall("```python\n(.*?)```", page.read_text(encoding="utf-8"), re.DOTALL)
    (tmp_path / "clouds.py").write_text(example + adding, encoding="utf-8")
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.setitem(sys.modules, "boto3", None)
    made: list[dict[str, Any]] = []

    class Bedrock(anthropic.Anthropic):
        def __init__(self, *, aws_region: str, **options: Any) -> None:
            made.append({"aws_region": aws_region, **options})
            super().__init__(api_key=KEY, **options)

    monkeypatch.setattr("anthropic.AnthropicBedrock", Bedrock)
    with MessagesServer(answer=lambda _: "Hello.") as server:
        client = server_client(server.url, client_factory="clouds:bedrock")
        assert isinstance(client.send(ASK, seconds=20), Reply)
        monkeypatch.setenv("ANTHROPIC_API_KEY", KEY)
        client = server_client(server.url, client_factory="clouds:thinking")
        assert isinstance(client.send(ASK, seconds=20), Reply)
    assert server.requests[1] == server.requests[0] | {"thinking": {"type": "adaptive"}}
    (options,) = made
    assert set(options) == {"aws_region", "http_client", "max_retries", "base_url"}
    assert server.keys[0].endswith(KEY)


@pytest.mark.parametrize(
    ("factory", "found"),
    [
        (FOUNDRY, "Missing credentials"),
        ("anthropic:Nobody", "Nobody"),
        ("no_such_module:make", "no_such_module"),
        ("builtins:dict", "'dict' object has no attribute"),
    ],
)
def test_a_client_that_cannot_be_made(factory: str, found: str) -> None:
    """One line with the key, before anything is sent."""
    with pytest.raises(SupervisionError, match="client_factory: expected") as excinfo:
        LLM.check(settings(f"client_factory={factory}"), context())
    assert found in str(excinfo.value)
    assert "\n" not in str(excinfo.value)


@pytest.mark.parametrize("factory", ["anthropic", "a b:c", ":x"])
def test_a_wrong_path_of_a_class_is_refused(factory: str) -> None:
    """It is an error of the configuration."""
    with pytest.raises(IslandError, match="client_factory"):
        composed("supervisor=llm", f"supervisor.policy.client_factory='{factory}'")


def test_missing_credentials_stop_a_run() -> None:
    """They are no connection error, so no fallback hides them."""

    def make(**options: Any) -> anthropic.Anthropic:
        sdk = anthropic.Anthropic(api_key="none", **options)

        def sign(*_: object, **__: object) -> None:
            raise LookupError("could not find default credentials")

        sdk._prepare_options = sign  # type: ignore[method-assign, assignment]
        return sdk

    with MessagesServer() as server, pytest.MonkeyPatch.context() as patch:
        patch.setattr("anthropic.make_for_test", make, raising=False)
        client = server_client(server.url, client_factory="anthropic:make_for_test")
        failure = client.send(ASK, seconds=20)
    assert isinstance(failure, Failure)
    assert failure.kind is FailureKind.UNAUTHORISED
    assert server.requests == []
