"""Servers of others in the middle: LiteLLM's proxy, and llmock, which breaks answers on purpose.

`make gateways` installs them; ISLANDGP_GATEWAYS names another environment that has them.
"""

from __future__ import annotations

import json
import os
import re
import shlex
import socket
import subprocess
import threading
import urllib.request
from collections.abc import Iterator
from contextlib import contextmanager
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from time import monotonic, sleep
from typing import Any

import pytest

from islandgp.running.app import main
from tests.architecture.sources import ROOT
from tests.llm.mock_model import MockModel

HOME = Path(os.environ.get("ISLANDGP_GATEWAYS", ROOT / "build" / "gateways"))
TEXT = (ROOT / "docs" / "llm.md").read_text(encoding="utf-8")
SHORT = (
    "experiment=smoke", "world.episode.length=20", "gp.generations=5", "gp.population=6",
    "evaluator=serial", "tracking=off", "progress=off", "supervisor.policy.retry.first_wait=0.1",
)  # fmt: skip
PATIENCE = 240  # s until a server is up

pytestmark = [
    pytest.mark.timeout(600),
    pytest.mark.slow,
    pytest.mark.skipif(not (HOME / "bin" / "litellm").exists(), reason="run make gateways first"),
]


class OpenAI(BaseHTTPRequestHandler):
    """The mock model behind OpenAI's /v1/chat/completions; `server.bodies` keeps the requests."""

    server: Any

    def log_message(self, format: str, *args: object) -> None:
        """Prints nothing."""

    def do_POST(self) -> None:
        body = json.loads(self.rfile.read(int(self.headers["content-length"])))
        self.server.bodies.append((self.path, body))
        system, *turns = body["messages"]
        answer = json.dumps(MockModel()({"system": system["content"], "messages": turns}))
        usage = {"prompt_tokens": 1000, "completion_tokens": 100, "total_tokens": 1100}
        choice = {
            "index": 0,
            "finish_reason": "stop",
            "message": {"role": "assistant", "content": answer},
        }
        kind = {"id": "x", "object": "chat.completion", "created": 1, "model": body["model"]}
        data = json.dumps({**kind, "choices": [choice], "usage": usage}).encode()
        self.send_response(200)
        self.send_header("content-type", "application/json")
        self.send_header("content-length", str(len(data)))
        self.end_headers()
        self.wfile.write(data)


@contextmanager
def openai() -> Iterator[ThreadingHTTPServer]:
    server = ThreadingHTTPServer(("127.0.0.1", 0), OpenAI)
    server.bodies = []  # type: ignore[attr-defined] # for the test
    threading.Thread(target=server.serve_forever, args=(0.02,), daemon=True).start()
    try:
        yield server
    finally:
        server.shutdown()
        server.server_close()


def free_port() -> int:
    with socket.socket() as s:
        s.bind(("127.0.0.1", 0))
        return int(s.getsockname()[1])


@contextmanager
def started(command_line: list[str], url: str, folder: Path, **variables: str) -> Iterator[None]:
    """A server of the environment, until it answers at `url`, to the end."""
    command = [str(HOME / "bin" / command_line[0]), *command_line[1:]]
    with (folder / "server.txt").open("w") as log:
        process = subprocess.Popen(
            command, cwd=folder, env={**os.environ, **variables}, stdout=log, stderr=log
        )
        try:
            due = monotonic() + PATIENCE
            while not _answers(url):
                assert process.poll() is None, (folder / "server.txt").read_text()
                assert monotonic() < due, f"{command_line[0]} did not start"
                sleep(0.2)
            yield
        finally:
            process.terminate()
            process.wait(30)


def _answers(url: str) -> bool:
    try:
        with urllib.request.urlopen(url, timeout=5) as response:
            return bool(response.status == 200)
    except OSError:
        return False


def block(kind: str, word: str) -> str:
    """The document's block of a kind with a word in it."""
    blocks = re.findall(rf"^```{kind}\n(.*?)^```", TEXT, re.MULTILINE | re.DOTALL)
    return next(text for text in blocks if word in text)


@pytest.fixture(scope="module")
def proxy(tmp_path_factory: pytest.TempPathFactory) -> Iterator[tuple[str, ThreadingHTTPServer]]:
    """The address of LiteLLM's proxy as the document starts it, and the server behind `mine`."""
    folder, port = tmp_path_factory.mktemp("proxy"), free_port()
    line = next(li for li in block("sh", "litellm --config").splitlines() if "--config" in li)
    arguments = shlex.split(line.replace("4000", str(port)))
    with openai() as behind:
        config = block("yaml", "model_list").replace(":8000/v1", f":{behind.server_port}/v1")
        (folder / "proxy.yaml").write_text(config, encoding="utf-8")
        url = f"http://127.0.0.1:{port}"
        with started(
            arguments, f"{url}/health/liveliness", folder, LITELLM_MASTER_KEY="sk-of-mine-01"
        ):
            yield url, behind


def run(folder: Path, url: str, *overrides: str) -> tuple[int, list[dict[str, Any]], Path]:
    """Exit code, transcript and folder of a small run."""
    places = [f"runs='{folder}'", f"supervisor.policy.base_url={url}"]
    code = main([*SHORT, "supervisor=llm", *places, *overrides])
    file = next(folder.rglob("transcript.jsonl"))
    return code, [json.loads(line) for line in file.read_text().splitlines()], file.parent


@pytest.mark.parametrize("prompts", ["paper", "informed"])
def test_a_model_behind_openai_s_language_supervises(
    proxy: tuple[str, ThreadingHTTPServer],
    prompts: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Every answer is the model's; schemas arrive translated, and the key is nowhere on disk."""
    monkeypatch.setenv("ANTHROPIC_API_KEY", "sk-of-mine-01")
    url, behind = proxy
    overrides = ("supervisor.policy.model=mine", f"supervisor.policy.prompts={prompts}")
    code, transcript, folder = run(tmp_path / "live", url, *overrides)
    assert code == 0
    parts = [line["source"] for line in transcript if line["line"] == "part"]
    assert parts == ["llm"] * 8
    path, body = behind.bodies[-1]  # type: ignore[attr-defined] # see `openai`
    assert path == "/v1/chat/completions"
    assert body["model"] == "qwen3"
    assert body["response_format"]["json_schema"]["schema"]["required"]
    assert not any(b"sk-of-mine-01" in f.read_bytes() for f in folder.rglob("*") if f.is_file())
    replay = ["supervisor=replay", f"supervisor.policy.transcript='{folder}'"]
    assert main([*SHORT[:-1], *replay, f"runs='{tmp_path / 'again'}'"]) == 0
    replayed = next((tmp_path / "again").rglob("generations.jsonl"))
    assert replayed.read_bytes() == (folder / "generations.jsonl").read_bytes()


def test_a_mocked_model_is_of_no_use_and_reported(
    proxy: tuple[str, ThreadingHTTPServer], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """It answers everything with one greeting: the fallback supervises, with exit code 3."""
    monkeypatch.setenv("ANTHROPIC_API_KEY", "sk-of-mine-01")
    code, transcript, _ = run(tmp_path, proxy[0], "supervisor.policy.model=mocked")
    assert code == 3
    parts = [line for line in transcript if line["line"] == "part"]
    assert {line["source"] for line in parts} == {"fallback"}
    assert all(line["rejected"] for line in parts)


def test_a_wrong_key_stops_before_the_run(
    proxy: tuple[str, ThreadingHTTPServer],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    """The proxy's own error becomes one line, the same for any other key without a database."""
    monkeypatch.setenv("ANTHROPIC_API_KEY", "sk-of-others")
    url = f"supervisor.policy.base_url={proxy[0]}"
    overrides = [*SHORT, "supervisor=llm", url, "supervisor.policy.model=mine"]
    assert main([*overrides, f"runs='{tmp_path}'"]) == 2
    assert "status 400: No connected db." in capsys.readouterr().err


def test_llmock_finds_no_fault_with_the_client(tmp_path: Path) -> None:
    """A third of all requests fail in three ways; each is met as llmock wants it."""
    port = free_port()
    rates = [f"--error-rate={status}=0.1" for status in (429, 503, 529)]
    command = ["llmock", "serve", "--host=127.0.0.1", f"--port={port}", *rates]
    url = f"http://127.0.0.1:{port}"
    with started(command, f"{url}/openapi.json", tmp_path):
        code, transcript, _ = run(
            tmp_path / "runs", f"{url}/anthropic", "supervisor.policy.retry.attempts=1"
        )
        report = [str(HOME / "bin" / "llmock"), "report", "--url", url, "--json"]
        process = subprocess.run(report, capture_output=True, text=True, check=False)
    assert code == 3  # it greets, and no greeting is a rate or a tree
    assert process.returncode == 0, process.stdout
    failed = [line["answer"] for line in transcript if "kind" in line.get("answer", {})]
    assert {f["kind"] for f in failed} <= {"rate_limited", "server", "overloaded"}
    assert failed
