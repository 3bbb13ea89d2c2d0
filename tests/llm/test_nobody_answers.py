"""A missing server stops a run; one that answers badly is reported at the run's end."""

from __future__ import annotations

import json
import socket
from collections.abc import Mapping
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from threading import Thread
from typing import Any

import pytest

from islandgp.running.app import main
from tests.llm.faults import Fault
from tests.llm.mock_model import MockModel
from tests.llm.server import MessagesServer
from tests.profiles import sweep

SMALL = (
    "gp.population=6",
    "gp.generations=4",
    "world.episode.length=5",
    "evaluator=serial",
    "tracking=off",
    "supervisor=llm",
    "supervisor.policy.retry.first_wait=0",
)


@pytest.fixture
def cwd(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """An empty working folder."""
    monkeypatch.chdir(tmp_path)
    return tmp_path


@pytest.fixture
def refused() -> str:
    """An address of this machine at which nobody listens."""
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        return f"http://127.0.0.1:{free.getsockname()[1]}"


def run_json(folder: Path, name: str) -> dict[str, Any]:
    """The JSON file of the only run."""
    (file,) = folder.rglob(name)
    value: dict[str, Any] = json.loads(file.read_text(encoding="utf-8"))
    return value


@sweep("source", ["configuration", "environment"], quick=1)
def test_an_address_where_nobody_listens_stops_the_run(
    cwd: Path,
    refused: str,
    source: str,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    """Exit code 2 and one line, before generation 0: no expert plays the model."""
    overrides = [f"supervisor.policy.base_url={refused}"] if source == "configuration" else []
    if source == "environment":
        monkeypatch.setenv("ANTHROPIC_BASE_URL", refused)
    assert main([*SMALL, *overrides]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert f"from {refused}, found unreachable (" in line
    assert "start the server, or set supervisor.policy.base_url" in line
    assert not list(cwd.rglob("generations.jsonl"))
    assert not list(cwd.rglob("summary.json"))


class OnlyOpenAI(BaseHTTPRequestHandler):
    """A server that knows only /v1/chat/completions, with FastAPI's error."""

    def log_message(self, format: str, *args: object) -> None:
        """Prints nothing."""

    def do_POST(self) -> None:
        """Every other address is not found."""
        self.rfile.read(int(self.headers["content-length"]))
        data = b'{"detail": "Not Found"}'
        self.send_response(404)
        self.send_header("content-length", str(len(data)))
        self.end_headers()
        self.wfile.write(data)


def test_a_server_that_speaks_another_language_stops_the_run(
    cwd: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Exit code 2 and one line with the remedy, also for the address of its endpoint."""
    with ThreadingHTTPServer(("127.0.0.1", 0), OnlyOpenAI) as server:
        Thread(target=server.serve_forever, args=(0.02,), daemon=True).start()
        url = f"http://127.0.0.1:{server.server_port}"
        assert main([*SMALL, f"supervisor.policy.base_url={url}"]) == 2
        assert (
            main([*SMALL, f"supervisor.policy.base_url={url}/v1/chat/completions", "resume=never"])
            == 2
        )
        server.shutdown()
    lines = capsys.readouterr().err.splitlines()
    assert len(lines) == 2
    for line in lines:
        assert "OpenAI's API only needs supervisor.policy.interface=chat" in line
        assert "found not_found (status 404" in line
    assert not list(cwd.rglob("generations.jsonl"))


def test_the_same_command_works_once_the_server_is_there(
    cwd: Path,
    refused: str,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    """The failed probe is not taken for an answer. Share of the answers and costs are printed."""
    monkeypatch.setenv("ANTHROPIC_BASE_URL", refused)
    assert main([*SMALL, "search=paper"]) == 2
    with MessagesServer() as server:
        monkeypatch.setenv("ANTHROPIC_BASE_URL", server.url)
        assert main([*SMALL, "search=paper"]) == 0
    summary, captured = run_json(cwd, "summary.json"), capsys.readouterr()
    assert summary["answers"] == {"total": 3, "fallback": 0, "in_part": 0}
    assert summary["mostly_fallback"] is False
    assert "Language model: 100% of the answers, 7 requests, " in captured.out
    assert " out, $0.0" in captured.out


def test_a_run_of_fallbacks_is_reported(cwd: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """A server that is always overloaded stops nothing; the exit code shows the fallback."""
    with MessagesServer(lambda n: Fault.OVERLOADED) as server:  # noqa: ARG005
        assert main([*SMALL, f"supervisor.policy.base_url={server.url}"]) == 3
        assert main([*SMALL, f"supervisor.policy.base_url={server.url}"]) == 3  # complete already
    captured = capsys.readouterr()
    assert "Answers of the fallback: 3 of 3\n" in captured.out
    assert (
        "Language model: 0% of the answers, 12 requests, 0 tokens in, 0 out, $0.0000\n"
        in captured.out
    )
    assert "found that the fallback gave more" in captured.err
    assert run_json(cwd, "summary.json")["answers"] == {"total": 3, "fallback": 3, "in_part": 0}


@pytest.mark.slow
def test_answers_that_are_the_fallbacks_in_part(
    cwd: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """A model that gives rates and no trees; a sweep's table shows it, too."""

    def rates_only(request: Mapping[str, Any]) -> Any:
        answer = MockModel()(request)
        return "no tree today" if "tree" in answer else answer

    with MessagesServer(answer=rates_only) as server:
        address = f"supervisor.policy.base_url={server.url}"
        overrides = [*SMALL, "search=paper", address, "seed=1", "-m"]
        assert main(overrides) == 0
        assert main([*overrides[:-2], "seed=2"]) == 0
        assert main([*overrides, "supervisor.policy.most_fallback=0.4"]) == 3
    captured = capsys.readouterr()
    assert "3 of 3, 3 of them in part" in captured.out
    assert "Answers of the fallback: 3 of 3, 3 of them in part\n" in captured.out
    assert "Language model: 50% of the answers" in captured.out
    assert "in 1 of 1 jobs expected guidance by the language model" in captured.err
    for file in cwd.rglob("summary.json"):
        summary = json.loads(file.read_text(encoding="utf-8"))
        assert summary["answers"] == {"total": 3, "fallback": 3, "in_part": 3}


def test_a_run_without_fallbacks_prints_nothing(
    cwd: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """The expert answers for itself."""
    assert main([*SMALL[:-2], "supervisor=expert"]) == 0
    assert "Supervision:" not in capsys.readouterr().out
    assert run_json(cwd, "summary.json")["answers"]["fallback"] == 0
