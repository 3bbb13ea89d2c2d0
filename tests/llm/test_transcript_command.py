"""`islandgp transcript`: a run's transcript as text, and the errors for other files."""

from __future__ import annotations

import json
import re
import shlex
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import pytest

from islandgp.resources import resource
from islandgp.supervision.llm.message import Failure, FailureKind, Reply, Request, Usage
from islandgp.supervision.llm.transcript import NAME, Attempt, Call, Conclusion, Sent, Transcript
from tests.llm.mock_model import MockModel
from tests.llm.server import MessagesServer
from tests.llm.test_whole_run import live
from tests.trees.shell import Cli, shell

ESCAPE = "\x1b[2J\x9b31m\u202e\r"  # clears a terminal, colours it and reverses text


@pytest.fixture
def islandgp(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> Cli:
    """Runs `islandgp ARGUMENTS...`; see `shell`."""
    return shell(monkeypatch, capsys)


def answers(request: Mapping[str, Any]) -> Any:
    """The mock's answers; rates after generation 1 are 7, and trees need a repair."""
    answer = dict(MockModel()(request))
    question = request["messages"][-1]["content"]
    if "mutation_rate" in answer and "generation 0" not in request["messages"][0]["content"]:
        answer["mutation_rate"] = 7
    if "tree" in answer and "cannot be used" not in question:
        answer["tree"] = "sequence { FlyHome }"
    return answer


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder of a run of three generations against the mock server."""
    folder = tmp_path_factory.mktemp("run")
    patient = "supervisor.policy.retry.deadline=5"
    with MessagesServer(answer=answers) as server:
        live(server, folder, "gp.generations=3", "supervisor.edits=1", patient)
    return folder


def test_a_transcript_in_words(islandgp: Cli, run: Path) -> None:
    """Each attempt with its answer, each result with its reason, and the sum."""
    result = islandgp("transcript", run)
    assert (result.code, result.err) == (0, "")
    lines = result.out.splitlines()
    assert lines[0].startswith("probe after generation -1, attempt 1: ")
    assert re.search(r", [\d,]+ tokens in, \d+ out, 0\.\d{4} dollars, \d\.\d s$", lines[0])
    assert '  {"greeting": "Hello."}' in lines
    assert "  tree: llm, repaired" in lines
    assert any(line.startswith("  rate: fallback: range: ") for line in lines)
    assert any(line.startswith("tree after generation 0, repair 1, attempt 1") for line in lines)
    assert re.search(r"^10 attempts, 0\.\d+ dollars$", lines[-1])


def test_one_generation_has_its_whole_prompts(islandgp: Cli, run: Path) -> None:
    """The system prompt, each turn, and the replies as they came."""
    output = islandgp("transcript", run / NAME, "--generation", 0).out
    lines = {line.strip() for line in output.splitlines()}
    for attempt in (a for a in Transcript(run / NAME).attempts if a.call.generation == 0):
        for text in (attempt.request.system, *attempt.request.turns):
            assert {line.strip() for line in text.splitlines()} <= lines
        assert isinstance(attempt.answer, Reply)
        assert attempt.answer.text in lines
    assert "after generation 1" not in output


REQUEST = Request("m", f"s{ESCAPE}", (), 100)
DEEP = "[" * 900 + "]" * 900
REPLIES: list[Reply | Failure] = [
    Reply(json.dumps({"tree": ESCAPE, "target": ["\ud800"], "rationale": 7}), "end_turn", None),
    Reply(f'{{"edits": [{DEEP}, {{"kind": {DEEP}, "reason": {DEEP}}}, 1]}}', "", Usage(1, 2)),
    Reply("{" * 100_000 + ESCAPE, f"max{ESCAPE}", Usage(1, 2), ESCAPE),
    Failure(FailureKind.TIMEOUT, ESCAPE),
]


@pytest.mark.parametrize("answer", REPLIES)
@pytest.mark.parametrize("options", [(), ("--generation", 3)])
def test_a_strangers_transcript_cannot_control_the_terminal(
    islandgp: Cli, tmp_path: Path, answer: Reply | Failure, options: tuple[object, ...]
) -> None:
    """Control characters are left out, and no value of an answer is an error."""
    transcript = Transcript(tmp_path / NAME)
    call = Call(3, f"edits {ESCAPE}", 0)
    transcript.add(Attempt(call, 1, REQUEST, answer, None, 0.5, 1.0, "at"))
    transcript.add(Conclusion(3, call.part, f"llm, {ESCAPE}", ESCAPE, (ESCAPE,)))
    transcript.add(Sent(Call(3, "rate", 0), 1, Usage(), 1.0))
    result = islandgp("transcript", tmp_path, *options)
    assert (result.code, result.err) == (0, "")
    assert all(c.isprintable() or c == "\n" for c in result.out)
    assert "rate after generation 3: sent, no answer is recorded" in result.out
    assert "unknown dollars, 0.5 s" in result.out


@pytest.mark.parametrize(
    ("content", "options", "message"),
    [
        (None, (), "Expected a run's folder with a transcript.jsonl"),
        (b"", (), "Expected questions to a model in "),
        (b'{"line": "start"', (), "Expected questions to a model in "),
        (f"{ESCAPE}\n".encode(), (), "line 1 damaged"),
        (b"\xff\x00\n[1]\n", (), "line 1 damaged"),
        (b"", ("--generation", "first"), "--generation"),
    ],
)
def test_a_file_that_is_no_transcript_is_one_line(
    islandgp: Cli, tmp_path: Path, content: bytes | None, options: tuple[str, ...], message: str
) -> None:
    """Exit code 2, with the file and a remedy."""
    if content is not None:
        (tmp_path / NAME).write_bytes(content)
    result = islandgp("transcript", tmp_path, *options)
    assert (result.code, result.out) == (2, "")
    assert result.err.count("\n") == 1
    assert result.err[:-1].isprintable()
    assert message in result.err
    assert islandgp("transcript", tmp_path / "nothing").code == 2


def test_options_that_fit_no_question(islandgp: Cli, run: Path) -> None:
    """One line with a command that works."""
    result = islandgp("transcript", run, "--generation", 9)
    assert (result.code, result.out) == (2, "")
    assert "that fit the options, found none;" in result.err
    (printed,) = re.findall(r"`islandgp (.+)` shows all", result.err)
    assert " attempts, " in islandgp(*shlex.split(printed)).out


LINES = re.findall(
    r"^    islandgp (transcript .+)$",
    (resource("conf").parent / "docs/llm/replay.md").read_text(encoding="utf-8"),
    re.MULTILINE,
)


@pytest.mark.parametrize("line", LINES)
def test_the_commands_of_the_page_run(islandgp: Cli, run: Path, line: str) -> None:
    """With the folder of this run."""
    arguments = line.replace("runs/default/llm-seed0", str(run)).split()
    result = islandgp(*arguments)
    assert (result.code, result.err) == (0, "")
    assert " attempts, " in result.out
