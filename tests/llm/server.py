"""A loopback server that speaks the Messages API, with a mock's answers and scripted faults."""

from __future__ import annotations

import json
import threading
from collections.abc import Callable, Mapping
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from typing import Any, Final, Self

from tests.llm.faults import ANSWER_FAULTS, Fault, Script, no_faults, spoiled
from tests.llm.mock_model import MockModel

WAIT: Final = 60.0  # longest duration of a silent or dripping answer, s


_ERRORS: Final[dict[Fault, tuple[int, str, str, dict[str, str]]]] = {
    Fault.RETRY_SOON: (429, "rate_limit_error", "slow down", {"retry-after": "0"}),
    Fault.RETRY_LATER: (429, "rate_limit_error", "come tomorrow", {"retry-after": "86400"}),
    Fault.SERVER_ERROR: (500, "api_error", "internal error", {}),
    Fault.OVERLOADED: (529, "overloaded_error", "overloaded", {}),
    Fault.BAD_REQUEST: (400, "invalid_request_error", "max_tokens: not today", {}),
    Fault.UNAUTHORISED: (401, "authentication_error", "invalid key {key}", {}),
    Fault.NO_CREDIT: (402, "billing_error", "the credit balance is too low", {}),
    Fault.TOO_LONG: (400, "invalid_request_error", "prompt is too long: 9999 tokens", {}),
    Fault.UNKNOWN_MODEL: (404, "not_found_error", "model: no-such-model", {}),
}
"""Status, kind, message and headers of faults that are an error of the API."""

_BODIES: Final[dict[Fault, dict[str, Any]]] = {
    Fault.REFUSAL: {"content": [], "stop_reason": "refusal"},
    Fault.THOUGHT: {
        "content": [{"type": "thinking", "thinking": "Let me think.", "signature": "s"}],
        "stop_reason": "max_tokens",
    },
    Fault.WRONG_BODY: {"content": 7, "usage": "many", "stop_reason": ["end_turn"]},
}
"""Fields of the message that these faults change."""


class MessagesServer:
    """The server, a context manager; `requests` and `keys` are those received."""

    def __init__(
        self,
        script: Script = no_faults,
        answer: Callable[[Mapping[str, Any]], Any] = MockModel(),  # noqa: B008 -- it is frozen
        *,
        structured: bool = True,
        temperature: bool = True,
        usage: bool = True,
        delay: float = 0.0,
        port: int = 0,
    ) -> None:
        """Starts a server on this machine.

        Args:
            script: the fault of each request.
            answer: makes the text of an answer from a request.
            structured: True if it supports JSON schemas.
            temperature: True if it accepts a temperature.
            usage: True if it counts tokens.
            delay: seconds before each answer.
            port: to listen at; 0: any free port.
        """
        self.script, self.answer, self.delay = script, answer, delay
        self.structured, self.temperature, self.usage = structured, temperature, usage
        self.requests: list[dict[str, Any]] = []
        self.keys: list[str] = []  # credentials as they were sent
        self.over = threading.Event()
        self._lock = threading.Lock()
        self._http = _Http(self, port)

    @property
    def url(self) -> str:
        """The value for `supervisor.policy.base_url`."""
        return f"http://127.0.0.1:{self._http.server_port}"

    def __enter__(self) -> Self:
        threading.Thread(target=self._http.serve_forever, args=(0.02,), daemon=True).start()
        return self

    def __exit__(self, *error: object) -> None:
        self.over.set()
        self._http.shutdown()
        self._http.server_close()

    def take(self, request: dict[str, Any], key: str) -> Fault | None:
        """Records a request and returns its fault, or None."""
        with self._lock:
            self.requests.append(request)
            self.keys.append(key)
            return self.script(len(self.requests) - 1)


class _Http(ThreadingHTTPServer):
    daemon_threads = True
    block_on_close = False

    def __init__(self, owner: MessagesServer, port: int) -> None:
        super().__init__(("127.0.0.1", port), _Handler)
        self.owner = owner

    def handle_error(self, request: object, client_address: object) -> None:
        """Ignores closed connections, which these tests cause on purpose."""


class _Handler(BaseHTTPRequestHandler):
    protocol_version = "HTTP/1.1"
    disable_nagle_algorithm = True  # saves 40 ms per answer
    server: _Http

    def log_message(self, format: str, *args: object) -> None:
        """Prints nothing."""

    def do_POST(self) -> None:
        owner = self.server.owner
        request = json.loads(self.rfile.read(int(self.headers["content-length"])))
        key = self.headers.get("x-api-key") or self.headers.get("authorization") or ""
        fault = owner.take(request, key)
        if owner.delay:
            owner.over.wait(owner.delay)
        if fault is not None and fault not in ANSWER_FAULTS:
            self._fail(fault, request, key)
            return
        if "temperature" in request and not owner.temperature:
            error = _error("invalid_request_error", "temperature: Extra inputs are not permitted")
            self._send(400, error)
            return
        message = _message(request, *self._text(request, fault))
        if not owner.usage:
            del message["usage"]
        self._send(200, message)

    def _text(self, request: Mapping[str, Any], fault: Fault | None) -> tuple[str, str]:
        """The answer's text and its stop reason."""
        owner = self.server.owner
        answer = owner.answer(request)
        if isinstance(answer, str):
            return answer, "end_turn"
        if fault is not None:
            return spoiled(answer, fault)
        if owner.structured and "output_config" in request:
            return json.dumps(answer), "end_turn"
        if "greeting" in answer:
            return str(answer["greeting"]), "end_turn"
        return f"Here is my answer.\n\n```json\n{json.dumps(answer)}\n```\n", "end_turn"

    def _fail(self, fault: Fault, request: Mapping[str, Any], key: str) -> None:
        body = json.dumps(_message(request, json.dumps(self.server.owner.answer(request)))).encode()
        if fault in _ERRORS:
            status, kind, text, headers = _ERRORS[fault]
            self._send(status, _error(kind, text.format(key=key)), headers)
            return
        if fault in _BODIES:
            self._send(200, {**_message(request, ""), **_BODIES[fault]})
            return
        match fault:
            case Fault.SILENCE:
                self.server.owner.over.wait(WAIT)
                self.close_connection = True
            case Fault.DRIP:
                self._start(200, len(body) + 10_000)
                self._drip()
            case Fault.DRIP_HEADERS:
                self._drip(b"HTTP/1.1 200 OK\r\nX-Slow: ")
            case Fault.CUT:
                self._start(200, len(body))
                self.wfile.write(body[: len(body) // 2])
                self.close_connection = True
            case Fault.HTML:
                page = b"<html><body>Please log in to the network.</body></html>"
                self._start(200, len(page), "text/html")
                self.wfile.write(page)
            case Fault.TRUNCATED:
                self._start(200, len(body) // 2)
                self.wfile.write(body[: len(body) // 2])

    def _drip(self, first: bytes = b"") -> None:
        """Sends single bytes until the client or the server closes the connection."""
        self.close_connection = True
        owner = self.server.owner
        self.wfile.write(first)
        for _ in range(int(WAIT / 0.02)):
            if owner.over.wait(0.02):
                return
            self.wfile.write(b" ")
            self.wfile.flush()

    def _send(
        self, status: int, value: Mapping[str, Any], headers: Mapping[str, str] | None = None
    ) -> None:
        body = json.dumps(value).encode()
        self._start(status, len(body), headers=headers)
        self.wfile.write(body)

    def _start(
        self,
        status: int,
        length: int,
        kind: str = "application/json",
        headers: Mapping[str, str] | None = None,
    ) -> None:
        self.send_response(status)
        standard_headers = {"content-type": kind, "content-length": str(length)}
        for name, value in {**standard_headers, **(headers or {})}.items():
            self.send_header(name, value)
        self.end_headers()


def _error(kind: str, message: str) -> dict[str, Any]:
    """An error as the API sends it."""
    return {"type": "error", "error": {"type": kind, "message": message}}


def _message(
    request: Mapping[str, Any], text: str, stop_reason: str = "end_turn"
) -> dict[str, Any]:
    """A message as the API sends it; tokens are counted as a quarter of the characters."""
    size = len(str(request.get("system", ""))) + sum(
        len(str(m["content"])) for m in request["messages"]
    )
    return {
        "id": "msg_mock",
        "type": "message",
        "role": "assistant",
        "model": request.get("model"),
        "content": [{"type": "text", "text": text}],
        "stop_reason": stop_reason,
        "stop_sequence": None,
        "usage": {
            "input_tokens": size // 4,
            "output_tokens": min(len(text) // 4, request["max_tokens"]),
            "cache_read_input_tokens": 0,
            "cache_creation_input_tokens": 0,
        },
    }
