"""The real SDK over a real socket: an attempt ends in time with any server."""

from __future__ import annotations

import json
import resource
import socket
import ssl
import subprocess
import threading
import time
import zlib
from collections.abc import AsyncIterator, Iterator
from contextlib import contextmanager, suppress
from dataclasses import replace
from functools import cache
from pathlib import Path

import httpx2
import pytest

from islandgp.supervision.llm.client import MAX_BODY, ServerClient
from islandgp.supervision.llm.message import MAX_ANSWER, Failure, FailureKind, Reply, Request, Usage
from tests.llm.faults import Fault
from tests.llm.server import MessagesServer

KEY = "sk-test-0123456789abcdef"
ASK = Request("m", "Be brief.", ("Hello?",), 100)
DEADLINE = 0.4  # s


@contextmanager
def client_of(url: str) -> Iterator[ServerClient]:
    client = ServerClient(KEY, url)
    client.open()
    try:
        yield client
    finally:
        client.close()


def failure(fault: Fault, seconds: float = DEADLINE) -> Failure:
    with MessagesServer(lambda _: fault) as server, client_of(server.url) as client:
        answer = client.send(ASK, seconds=seconds)
    assert isinstance(answer, Failure), answer
    return answer


def mocked(body: bytes, status: int = 200, **headers: str) -> Reply | Failure:
    """What becomes of a response, with a mock transport in the network's place."""
    transport = httpx2.MockTransport(
        lambda _: httpx2.Response(status, content=body, headers=headers)
    )
    client = ServerClient(KEY, "http://mock", transport=transport)
    try:
        return client.send(ASK, seconds=5)
    finally:
        client.close()


def test_an_answer_comes_back_with_its_usage() -> None:
    """Text, stop reason and tokens of a good answer arrive as they were sent."""
    with (
        MessagesServer(answer=lambda _: "Hello, island.") as server,
        client_of(server.url) as client,
    ):
        answer = client.send(ASK, seconds=5)
    assert answer == Reply("Hello, island.", "end_turn", Usage(input=15 // 4, output=14 // 4))


def test_what_is_sent() -> None:
    """Schema and temperature are sent where the request has them, turns alternate.

    The cache mark is on the system prompt, the only part that is the same each time.
    """
    schema = {"type": "object"}
    full = Request("m", "s", ("a", "b", "c"), 9, temperature=0.7, schema=schema, cache=True)
    with MessagesServer() as server, client_of(server.url) as client:
        client.send(full, seconds=5)
        client.send(ASK, seconds=5)
    body, plain = server.requests
    assert body == {
        "model": "m",
        "system": [{"type": "text", "text": "s", "cache_control": {"type": "ephemeral"}}],
        "max_tokens": 9,
        "messages": [
            {"role": "user", "content": "a"},
            {"role": "assistant", "content": "b"},
            {"role": "user", "content": "c"},
        ],
        "temperature": 0.7,
        "output_config": {"format": {"type": "json_schema", "schema": schema}},
    }
    assert plain["system"] == ASK.system
    assert set(plain) == {"model", "system", "max_tokens", "messages"}


@pytest.mark.parametrize("fault", [Fault.SILENCE, Fault.DRIP, Fault.DRIP_HEADERS])
def test_the_deadline_is_hard(fault: Fault) -> None:
    """A server that sends nothing, or a byte now and then, is left at the deadline."""
    began = time.monotonic()
    error = failure(fault)
    assert error.kind is FailureKind.TIMEOUT
    assert time.monotonic() - began < DEADLINE + 1


def test_a_server_that_never_accepts_is_left_at_the_deadline() -> None:
    """The deadline holds before there is a connection, too; nothing was sent then."""
    with socket.create_server(("127.0.0.1", 0), backlog=0) as server:
        address = server.getsockname()
        blockers = [socket.socket() for _ in range(4)]
        for s in blockers:
            s.setblocking(False)
            s.connect_ex(address)
        with client_of(f"http://127.0.0.1:{address[1]}") as client:
            answer = client.send(ASK, seconds=DEADLINE)
        for s in blockers:
            s.close()
    assert answer == Failure(FailureKind.UNREACHABLE, f"no connection within {DEADLINE:g} s")


@pytest.mark.parametrize(
    ("fault", "kind", "message"),
    [
        (Fault.RETRY_SOON, FailureKind.RATE_LIMITED, "status 429: slow down"),
        (Fault.RETRY_LATER, FailureKind.RATE_LIMITED, "status 429: come tomorrow"),
        (Fault.SERVER_ERROR, FailureKind.SERVER, "status 500: internal error"),
        (Fault.OVERLOADED, FailureKind.OVERLOADED, "status 529: overloaded"),
        (Fault.BAD_REQUEST, FailureKind.REJECTED, "status 400: max_tokens: not today"),
        (Fault.HTML, FailureKind.MALFORMED, "begins with '<html>"),
        (Fault.TRUNCATED, FailureKind.MALFORMED, "JSONDecodeError"),
        (Fault.WRONG_BODY, FailureKind.MALFORMED, "TypeError"),
        (Fault.CUT, FailureKind.CUT, "peer closed connection"),
    ],
)
def test_a_fault_becomes_a_failure_of_its_kind(
    fault: Fault, kind: FailureKind, message: str
) -> None:
    """Each fault of the transport has its kind, and a message for people."""
    error = failure(fault, seconds=5)
    assert error.kind is kind
    assert message in error.message


def test_each_request_is_sent_once() -> None:
    """The SDK retries nothing: attempts are counted and charged one by one here."""
    with (
        MessagesServer(lambda _: Fault.SERVER_ERROR) as server,
        client_of(server.url) as client,
    ):
        client.send(ASK, seconds=5)
        assert len(server.requests) == 1


def test_a_client_works_on_after_a_failure() -> None:
    """A timed-out attempt leaves nothing behind that hinders the next."""
    faults = [Fault.DRIP, Fault.CUT, Fault.SILENCE, None]
    with MessagesServer(lambda n: faults[n]) as server, client_of(server.url) as client:
        answers = [client.send(ASK, seconds=DEADLINE) for _ in faults]
    assert [isinstance(f, Reply) for f in answers] == [False, False, False, True]


def test_nobody_listens() -> None:
    """A refused connection differs from a broken one: nothing was sent, nothing charged."""
    with socket.create_server(("127.0.0.1", 0)) as server:
        port = server.getsockname()[1]
    with client_of(f"http://127.0.0.1:{port}") as client:
        answer = client.send(ASK, seconds=5)
    assert isinstance(answer, Failure)
    assert answer.kind is FailureKind.UNREACHABLE


def test_an_error_never_repeats_the_key() -> None:
    """A server that quotes the key in its error does not get it into our messages."""
    error = failure(Fault.UNAUTHORISED, seconds=5)
    assert error.kind is FailureKind.UNAUTHORISED
    assert KEY not in error.message
    assert "[key]" in error.message


def test_an_answer_never_repeats_the_key() -> None:
    """Nor does an answer that quotes it, or a broken body of which the start is shown."""
    with (
        MessagesServer(answer=lambda _: f"Your key is {KEY}!") as server,
        client_of(server.url) as client,
    ):
        answer = client.send(ASK, seconds=5)
    assert isinstance(answer, Reply)
    assert answer.text == "Your key is [key]!"
    broken = mocked(b"x" * 70 + KEY.encode())
    assert isinstance(broken, Failure)
    assert KEY[:8] not in broken.message


def test_odd_text_is_made_storable() -> None:
    """Lone surrogates and control characters do not get past the seam."""
    body = rb'{"content": [{"type": "text", "text": "a\ud800b\u001b[31m\nc"}], "usage": {}}'
    answer = mocked(body)
    assert isinstance(answer, Reply)
    assert answer.text == "a?b [31m\nc"


def test_thinking_and_effort_are_sent() -> None:
    """As the API takes them, beside the schema; more fields of the body as they are."""
    request = replace(
        ASK,
        schema={"type": "object"},
        extra={"thinking": {"type": "adaptive"}, "output_config": {"effort": "low"}, "top_k": 3},
        temperature=0.7,
    )
    with MessagesServer() as server, client_of(server.url) as client:
        client.send(request, seconds=5)
    (body,) = server.requests
    assert body["thinking"] == {"type": "adaptive"}
    assert body["output_config"]["effort"] == "low"
    assert body["output_config"]["format"]["schema"] == {"type": "object"}
    assert (body["top_k"], body["temperature"]) == (3, 0.7)


def test_only_text_blocks_are_read() -> None:
    """What a model thinks is no part of its answer, and is kept beside it."""
    body = (
        b'{"content": [{"type": "thinking", "thinking": "hm"}, {"type": "text", "text": "yes"}],'
        b' "stop_reason": "end_turn", "usage": {"input_tokens": 3, "output_tokens": 4,'
        b' "cache_read_input_tokens": 5, "cache_creation_input_tokens": 6}}'
    )
    assert mocked(body) == Reply("yes", "end_turn", Usage(3, 4, 5, 6), "hm")


@pytest.mark.parametrize(
    "body",
    [
        b"",
        b"null",
        b"[]",
        b'"text"',
        b"\xff\xfe",
        b"[" * 200_000,
        b'{"content": [{}]}',
        b'{"content": null}',
        b'{"content": [], "usage": {"input_tokens": -5}}',
        b'{"content": [], "usage": {"output_tokens": true}}',
        b'{"content": [], "usage": {"output_tokens": 1' + b"0" * 400 + b"}}",
        b'{"content": [{"type": "text", "text": 5}]}',
    ],
)
def test_a_body_that_is_no_message_is_malformed(body: bytes) -> None:
    """Nothing of it is believed, and nothing of it raises."""
    answer = mocked(body)
    assert isinstance(answer, Failure)
    assert answer.kind is FailureKind.MALFORMED


def test_an_endless_body_is_left() -> None:
    """A body that is too large ends the attempt before it fills the memory."""

    def flood(server: socket.socket, sent: list[int]) -> None:
        connection, _ = server.accept()
        with connection:
            connection.recv(65536)
            connection.sendall(b"HTTP/1.1 200 OK\r\ntransfer-encoding: chunked\r\n\r\n")
            chunk = b"100000\r\n" + b" " * 0x100000 + b"\r\n"
            try:
                for _ in range(1000):
                    connection.sendall(chunk)
                    sent.append(len(chunk))
            except OSError:
                return

    chunks: list[int] = []
    with socket.create_server(("127.0.0.1", 0)) as server:
        thread = threading.Thread(target=flood, args=(server, chunks))
        thread.start()
        with client_of(f"http://127.0.0.1:{server.getsockname()[1]}") as client:
            answer = client.send(ASK, seconds=10)
        thread.join()
    assert isinstance(answer, Failure)
    assert str(MAX_BODY) in answer.message
    assert sum(chunks) < 4 * MAX_BODY


def test_a_huge_answer_is_cut() -> None:
    """No more of an answer is kept than can be of use."""
    answer = mocked(
        b'{"content": [{"type": "text", "text": "' + b"x" * (2 * MAX_ANSWER) + b'"}], "usage": {}}'
    )
    assert isinstance(answer, Reply)
    assert len(answer.text) == MAX_ANSWER + 1


@pytest.mark.parametrize(
    ("header", "seconds"),
    [("7", 7.0), ("0.5", 0.5), ("-3", 0.0), ("inf", None), ("nan", None), ("soon", None)],
)
def test_retry_after_is_read(header: str, seconds: float | None) -> None:
    """Seconds are taken as they are, nonsense is ignored."""
    answer = mocked(b"{}", 429, **{"retry-after": header})
    assert isinstance(answer, Failure)
    assert answer.retry_after == seconds


@pytest.mark.parametrize(
    ("header", "seconds"),
    [("1500", 1.5), ("0", 0.0), ("-7", 0.0), ("nan", 9.0), ("inf", 9.0), ("soon", 9.0), ("", 9.0)],
)
def test_retry_after_in_milliseconds_is_read(header: str, seconds: float) -> None:
    """It is more precise than the seconds beside it, which are taken where it is nonsense."""
    answer = mocked(b"{}", 429, **{"retry-after-ms": header, "retry-after": "9"})
    assert isinstance(answer, Failure)
    assert answer.retry_after == seconds
    without_seconds = mocked(b"{}", 429, **{"retry-after-ms": "250"})
    assert isinstance(without_seconds, Failure)
    assert without_seconds.retry_after == 0.25


def test_retry_after_may_be_a_date() -> None:
    """A date in the past asks for no wait, one far ahead for a long one."""
    past = mocked(b"{}", 429, **{"retry-after": "Wed, 21 Oct 2015 07:28:00 GMT"})
    ahead = mocked(b"{}", 429, **{"retry-after": "Wed, 21 Oct 2065 07:28:00 GMT"})
    assert isinstance(past, Failure)
    assert isinstance(ahead, Failure)
    assert past.retry_after == 0
    assert ahead.retry_after is not None
    assert ahead.retry_after > 1e8


def test_redirects_are_not_followed() -> None:
    """The key goes nowhere but to the address that was given."""
    answer = mocked(b"", 302, location="http://elsewhere.example/")
    assert isinstance(answer, Failure)
    assert answer.kind is FailureKind.REJECTED
    assert answer.message == "status 302, which leads to http://elsewhere.example/"


@pytest.mark.parametrize(
    ("status", "body", "kind", "message"),
    [
        (200, b'{"object": "chat.completion", "choices": []}', "foreign", "OpenAI's format"),
        (200, b'{"error": "Unexpected endpoint (POST /v1/messages)"}', "not_found", "Unexpected"),
        (200, b'{"error": {"message": "busy", "code": 502}}', "malformed", "with an error: busy"),
        (200, b'{"error": null}', "malformed", "with an error: None"),
        (404, b'{"detail": "Not Found"}', "not_found", "status 404"),
        (405, b'{"detail": "Method Not Allowed"}', "not_found", "status 405"),
        (501, b"<html>Unsupported method</html>", "not_found", "status 501"),
        (408, b"{}", "late", "status 408"),
        (504, b"<html>Gateway Time-out</html>", "late", "status 504"),
        (524, b"error code: 524", "late", "status 524"),
        (502, b"<html>Bad Gateway</html>", "server", "status 502"),
    ],
)
def test_errors_of_other_servers_have_different_kinds(
    status: int, body: bytes, kind: str, message: str
) -> None:
    """An answer in OpenAI's format, an unknown address, a gateway that gave up waiting."""
    answer = mocked(body, status)
    assert isinstance(answer, Failure)
    assert answer.kind == kind
    assert message in answer.message


def test_closing_is_prompt_and_final() -> None:
    """A client can be closed unused, and no thread of it stays."""
    before = threading.active_count()
    ServerClient(None, "http://127.0.0.1:1").close()
    with MessagesServer(lambda _: Fault.DRIP) as server:
        client = ServerClient(None, server.url)
        client.send(ASK, seconds=0.1)
        client.close()
    assert not [t for t in threading.enumerate() if t.name == "llm"]
    assert threading.active_count() <= before + 2


@pytest.mark.parametrize(
    "spelt",
    [
        KEY,
        "".join(f"\\u{ord(c):04x}" for c in KEY),
        "".join(f"\\u{ord(c):04X}" for c in KEY),
        "\\u0073" + KEY[1:],
        KEY.replace("-", "\\\\u002d"),
        KEY.replace("/", "\\/"),
    ],
)
def test_no_spelling_of_the_key_gets_past_the_client(spelt: str) -> None:
    """An answer is JSON inside JSON: what it spells with escapes is plain once it is decoded."""
    text = f'{{"reasoning": "the key is {spelt}, \\n\\"indeed\\""}}'
    answer = mocked(json.dumps({"content": [{"type": "text", "text": text}], "usage": {}}).encode())
    assert isinstance(answer, Reply)
    assert json.loads(answer.text) == {"reasoning": 'the key is [key], \n"indeed"'}


@cache
def bomb() -> bytes:
    """What unpacks to 150 million bytes."""
    packer = zlib.compressobj(level=1, wbits=31)
    return b"".join([*(packer.compress(b"x" * 1_000_000) for _ in range(150)), packer.flush()])


@pytest.mark.parametrize("status", [200, 429])
def test_a_compressed_body_is_not_unpacked(status: int) -> None:
    """A small body could unpack to a huge one; compression was not requested and is reported."""
    transport = httpx2.MockTransport(
        lambda _: httpx2.Response(
            status, stream=Bytes(bomb()), headers={"content-encoding": "gzip", "retry-after": "3"}
        )
    )
    client = ServerClient(KEY, "http://mock", transport=transport)
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    answer = client.send(ASK, seconds=10)
    client.close()
    assert isinstance(answer, Failure)
    assert (resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before) < 100_000  # KiB
    if status == 200:
        assert answer.kind is FailureKind.MALFORMED
        assert "found the encoding gzip; turn compression off" in answer.message
    else:
        assert (answer.kind, answer.retry_after) == (FailureKind.RATE_LIMITED, 3)


class Bytes(httpx2.AsyncByteStream):
    """A body that comes from the network: nothing has unpacked it yet."""

    def __init__(self, data: bytes) -> None:
        self.data = data

    async def __aiter__(self) -> AsyncIterator[bytes]:
        yield self.data


@pytest.mark.parametrize(("header", "expected"), [("false", False), ("true", True), ("", None)])
def test_the_header_on_another_attempt_is_read(header: str, expected: bool | None) -> None:
    """The header that the SDK would obey is read here, as the retries are ours."""
    answer = mocked(b"{}", 529, **{"x-should-retry": header})
    assert isinstance(answer, Failure)
    assert answer.should_retry is expected


def test_a_certificate_that_nobody_signed(tmp_path: Path) -> None:
    """It differs from a server that is not there."""
    with tls_server(tmp_path) as url, client_of(url) as client:
        answer = client.send(ASK, seconds=5)
    assert isinstance(answer, Failure)
    assert answer.kind is FailureKind.UNTRUSTED
    assert "CERTIFICATE_VERIFY_FAILED" in answer.message


@contextmanager
def tls_server(folder: Path) -> Iterator[str]:
    """A server with a self-signed certificate."""
    pair = folder / "pair.pem"
    options = "req -x509 -newkey rsa:2048 -nodes -days 2 -subj /CN=localhost -keyout"
    process = subprocess.run(
        ["openssl", *options.split(), pair, "-out", folder / "cert.pem"],
        check=False,
        capture_output=True,
    )
    if process.returncode:
        pytest.skip("no openssl to make a certificate with")
    context = ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER)
    context.load_cert_chain(folder / "cert.pem", pair)
    with socket.create_server(("127.0.0.1", 0)) as server:

        def greet() -> None:
            with suppress(OSError):
                connection, _ = server.accept()
                with connection, context.wrap_socket(connection, server_side=True):
                    pass

        thread = threading.Thread(target=greet)
        thread.start()
        yield f"https://127.0.0.1:{server.getsockname()[1]}"
        thread.join()


@pytest.mark.parametrize(
    ("usage", "known"),
    [
        ({"input_tokens": 3, "output_tokens": 4}, True),
        ({"input_tokens": 0, "output_tokens": 4, "cache_read_input_tokens": 3}, True),
        ({"output_tokens": 4}, False),
        ({"input_tokens": 3}, False),
        ({"input_tokens": 0, "output_tokens": 0}, False),
        ({}, False),
        (None, False),
    ],
)
def test_missing_counts_of_tokens_are_unknown(usage: object, known: bool) -> None:
    """Some count no tokens, or none of one sort: what they took is unknown, not nothing."""
    message = {"content": [{"type": "text", "text": "yes"}], "usage": usage}
    answer = mocked(json.dumps(message).encode())
    assert isinstance(answer, Reply)
    assert (answer.usage is not None) == known


@pytest.mark.parametrize(
    ("content", "known"), [([], True), ([{"type": "thinking", "thinking": "hm"}], False)]
)
def test_thoughts_without_an_answer_take_tokens(content: list[object], known: bool) -> None:
    """A refusal has none; a server that counts none of the thoughts does not count."""
    usage = {"input_tokens": 3, "output_tokens": 0}
    answer = mocked(json.dumps({"content": content, "usage": usage}).encode())
    assert isinstance(answer, Reply)
    assert (answer.usage is not None) == known


def test_a_request_that_was_begun_counts() -> None:
    """A connection that fails before it is made differs from one that breaks later."""

    def hang_up(server: socket.socket) -> None:
        connection, _ = server.accept()
        connection.recv(1)
        connection.close()

    with socket.create_server(("127.0.0.1", 0)) as server:
        thread = threading.Thread(target=hang_up, args=(server,))
        thread.start()
        with client_of(f"http://127.0.0.1:{server.getsockname()[1]}") as client:
            cut = client.send(ASK, seconds=5)
        thread.join()
    with client_of("http://host.invalid:1") as client:
        unknown = client.send(ASK, seconds=5)
    assert isinstance(cut, Failure)
    assert isinstance(unknown, Failure)
    assert (cut.kind, unknown.kind) == (FailureKind.CUT, FailureKind.UNREACHABLE)


def test_a_proxy_that_never_connects_was_sent_nothing() -> None:
    """What it is asked for is a connection; the request with its prompt comes after that."""
    with socket.create_server(("127.0.0.1", 0)) as server:
        proxy = f"http://127.0.0.1:{server.getsockname()[1]}"
        with pytest.MonkeyPatch.context() as patch:
            patch.setenv("HTTPS_PROXY", proxy)
            with client_of("https://model.invalid") as client:
                answer = client.send(ASK, seconds=DEADLINE)
    assert answer == Failure(FailureKind.UNREACHABLE, f"no connection within {DEADLINE:g} s")
