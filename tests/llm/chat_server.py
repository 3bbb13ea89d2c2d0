"""A loopback server of the chat-completions interface, as four kinds of servers behave."""

from __future__ import annotations

import json
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from threading import Thread
from typing import Any, Self

from tests.llm.mock_model import MockModel


class ChatServer:
    """The server, a context manager; `bodies` and `keys` are those received.

    `kind`: llama (decodes by a grammar), schema (ignores the grammar), openai (rejects unknown
    fields), text (ignores both), or a pair of a status and a message after `good` requests.
    """

    def __init__(self, kind: str, error: tuple[int, str] | None = None, good: int = 0) -> None:
        self.kind, self.error, self.good = kind, error, good
        self.bodies: list[dict[str, Any]] = []
        self.keys: list[str] = []
        owner = self

        class Handler(BaseHTTPRequestHandler):
            def log_message(self, format: str, *args: object) -> None:
                """Prints nothing."""

            def do_POST(self) -> None:
                body = json.loads(self.rfile.read(int(self.headers["content-length"])))
                owner.bodies.append(body)
                owner.keys.append(self.headers.get("authorization") or "")
                status, answer = 404, {"error": {"message": f"unknown path {self.path}"}}
                if self.path == "/v1/chat/completions":
                    status, answer = owner.answer(body)
                data = json.dumps(answer).encode()
                self.send_response(status)
                self.send_header("content-length", str(len(data)))
                self.end_headers()
                self.wfile.write(data)

        self._http = ThreadingHTTPServer(("127.0.0.1", 0), Handler)

    @property
    def url(self) -> str:
        return f"http://127.0.0.1:{self._http.server_port}"

    def __enter__(self) -> Self:
        Thread(target=self._http.serve_forever, args=(0.02,), daemon=True).start()
        return self

    def __exit__(self, *error: object) -> None:
        self._http.shutdown()
        self._http.server_close()

    def answer(self, body: dict[str, Any]) -> tuple[int, dict[str, Any]]:
        """Status and body."""
        if self.error is not None and len(self.bodies) > self.good:
            return self.error[0], {"error": {"message": self.error[1]}}
        if self.kind == "openai" and "grammar" in body:
            text = "Unrecognized request argument supplied: grammar"
            return 400, {"error": {"message": text, "type": "invalid_request_error"}}
        system, *turns = body["messages"]
        value = MockModel()({"system": system["content"], "messages": turns})
        text = json.dumps(value)
        if "greeting" in value:
            has_schema = "response_format" in body and self.kind != "text"
            text = json.dumps(value) if has_schema else "Hello."
            if self.kind == "llama" and "grammar" in body:
                text = '{"greeting": "by a grammar"}'
        message = {"role": "assistant", "content": text}
        usage = {"prompt_tokens": 100, "completion_tokens": 20, "total_tokens": 120}
        return 200, {"choices": [{"message": message, "finish_reason": "stop"}], "usage": usage}
