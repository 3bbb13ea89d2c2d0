"""A small editor: it speaks the Language Server Protocol with `islandgp language-server`."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path
from types import TracebackType
from typing import Any, Self

CODE = "from islandgp.cli import main; main()"


class Editor:
    """A client over standard input and output; files are those of a folder."""

    def __init__(self, folder: Path, *options: str) -> None:
        """Starts the server there, with these options."""
        self.folder = folder
        self.notifications: list[dict[str, Any]] = []  # notifications
        self._id = 0
        self._server = subprocess.Popen(
            [sys.executable, "-c", CODE, "language-server", *options],
            cwd=folder,
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
        )

    def __enter__(self) -> Self:
        """The handshake."""
        self.capabilities = self.ask("initialize", processId=None, rootUri=None, capabilities={})
        self.tell("initialized")
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        """The farewell; the server ends by itself."""
        if kind is None:
            self.ask("shutdown")
            self.tell("exit")
            assert self._server.wait(20) == 0
        self._server.kill()
        for pipe in (self._server.stdin, self._server.stdout):
            assert pipe is not None
            pipe.close()

    def uri(self, name: str) -> str:
        """Of a file in the folder."""
        return (self.folder / name).as_uri()

    def tell(self, method: str, **params: Any) -> None:
        """Sends a notification."""
        self._send({"method": method, "params": params})

    def ask(self, method: str, **params: Any) -> Any:
        """Sends a request, and gives its result, or its error as text."""
        self._id += 1
        self._send({"id": self._id, "method": method, **({"params": params} if params else {})})
        while (message := self._receive()).get("id") != self._id:
            self.notifications.append(message)
        return message["error"]["message"] if "error" in message else message["result"]

    def diagnostics_of(self, name: str) -> list[dict[str, Any]]:
        """The next diagnostics of a file."""
        while True:
            for message in self.notifications:
                if message["params"].get("uri") == self.uri(name):
                    self.notifications.remove(message)
                    diagnostics: list[dict[str, Any]] = message["params"]["diagnostics"]
                    return diagnostics
            self.notifications.append(self._receive())

    def open(self, name: str, text: str) -> list[dict[str, Any]]:
        """Opens a text as a file, and gives its diagnostics."""
        document = {"uri": self.uri(name), "languageId": "islandgp", "version": 1, "text": text}
        self.tell("textDocument/didOpen", textDocument=document)
        return self.diagnostics_of(name)

    def at(self, request: str, name: str, line: int, character: int, **parameters: Any) -> Any:
        """Asks about a place, from 0."""
        return self.ask(
            f"textDocument/{request}",
            textDocument={"uri": self.uri(name)},
            position={"line": line, "character": character},
            **parameters,
        )

    def _send(self, message: dict[str, Any]) -> None:
        data = json.dumps({"jsonrpc": "2.0", **message}).encode()
        assert self._server.stdin is not None
        self._server.stdin.write(b"Content-Length: %d\r\n\r\n%b" % (len(data), data))
        self._server.stdin.flush()

    def _receive(self) -> dict[str, Any]:
        stream = self._server.stdout
        assert stream is not None
        length = 0
        while line := stream.readline().strip():
            key, _, value = line.partition(b":")
            length = int(value) if key.lower() == b"content-length" else length
        message: dict[str, Any] = json.loads(stream.read(length))
        return message
