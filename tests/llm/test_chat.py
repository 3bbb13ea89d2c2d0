"""The chat-completions interface: what each kind of server is sent, and what its answers become."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from pydantic import BaseModel

from islandgp.bt.export.grammar import answer_grammar, tree_grammar
from islandgp.running.app import main
from islandgp.supervision.llm import client
from islandgp.supervision.llm.answers import (
    Accepted,
    Check,
    DecisionAnswer,
    check_decision,
    check_proposal,
    proposal_model,
    schema,
)
from islandgp.supervision.llm.message import Reply
from tests.llm.chat_server import ChatServer
from tests.llm.samples import context, outcome, settings, state
from tests.trees.test_grammar import masked_walks

SMALL = (
    "gp.population=6",
    "gp.generations=4",
    "world.episode.length=5",
    "evaluator=serial",
    "search=paper",
    "tracking=off",
    "supervisor=llm",
    "supervisor.policy.interface=chat",
    "supervisor.policy.model=mine",
    "supervisor.policy.retry.first_wait=0",
)


@pytest.fixture(autouse=True)
def cwd(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    return tmp_path


@pytest.mark.parametrize(
    ("kind", "probes", "sent", "said"),
    [
        ("llama", 1, "grammar", "decoding by a grammar"),
        ("schema", 1, "response_format", "structured output"),
        ("openai", 2, "response_format", "structured output"),
        ("text", 1, "response_format", "structured output"),
    ],
)
def test_each_kind_of_server_is_asked_as_it_wants(
    cwd: Path,
    kind: str,
    probes: int,
    sent: str,
    said: str,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    """Found by the probe, recorded, and repeated by a replay without the server."""
    monkeypatch.setenv("OPENAI_API_KEY", "sk-secret-of-this-test")
    with ChatServer(kind) as server:
        assert main([*SMALL, f"supervisor.policy.base_url={server.url}"]) == 0
    assert said in capsys.readouterr().err
    assert len(server.bodies) == probes + 3 * 2
    for body in server.bodies[probes:]:
        assert {"grammar", "response_format"}.intersection(body) == {sent}
    assert set(server.keys) == {"Bearer sk-secret-of-this-test"}
    (file,) = cwd.rglob("transcript.jsonl")
    assert "sk-secret" not in file.read_text(encoding="utf-8")
    replay = [*SMALL[:6], "supervisor=replay", f"supervisor.policy.transcript='{file.parent}'"]
    assert main([*replay, "runs=again"]) == 0
    (again,) = (cwd / "again").rglob("generations.jsonl")
    assert again.read_bytes() == (file.parent / "generations.jsonl").read_bytes()


@pytest.mark.parametrize(
    ("status", "words", "kind"),
    [
        (401, "Incorrect API key provided", "unauthorised"),
        (429, "You exceeded your current quota: insufficient_quota", "no_credit"),
        (400, "This model's maximum context length is 8192 tokens", "too_long"),
        (404, "The model `mine` does not exist", "not_found"),
    ],
)
def test_a_failure_that_cannot_heal_has_the_servers_words(
    status: int, words: str, kind: str, capsys: pytest.CaptureFixture[str]
) -> None:
    """At the start of a run: one request, exit code 2, one line."""
    with ChatServer("llama", (status, words)) as server:
        assert main([*SMALL, f"supervisor.policy.base_url={server.url}"]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert f"found {kind} (status {status}: {words}" in line
    assert len(server.bodies) == 1


def test_a_revoked_key_ends_the_questions(caplog: pytest.LogCaptureFixture) -> None:
    """In the run: the questions of one generation, a warning, then the fallback to the end."""
    with ChatServer("llama", (401, "This key was revoked"), good=3) as server:
        assert main([*SMALL, f"supervisor.policy.base_url={server.url}"]) == 3
    assert len(server.bodies) <= 3 + 2
    assert "with the fallback from generation 1: status 401: This key was revoked" in caplog.text


def test_a_server_without_grammar_is_one_line(capsys: pytest.CaptureFixture[str]) -> None:
    """With output=grammar nothing else will do."""
    with ChatServer("schema") as server:
        address = f"supervisor.policy.base_url={server.url}"
        assert main([*SMALL, address, "supervisor.policy.output=grammar"]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert "output=grammar: expected a server that decodes by a grammar" in line


def test_a_run_without_the_extra_ends_with_one_line(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """The package and how to install it."""
    monkeypatch.setattr(client, "find_spec", lambda name: None)  # noqa: ARG005
    assert main([*SMALL, "supervisor.policy.base_url=http://127.0.0.1:9"]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert "Expected the package openai for supervisor.policy.interface=chat, found none" in line


def test_every_answer_of_the_grammar_is_accepted() -> None:
    """Random walks by a decoder's masks: valid JSON, fields, ranges and trees within limits."""
    run = context()
    vocabulary, rates = run.schema.vocabulary, settings().rates
    targets = state().targets
    tree = tree_grammar(vocabulary, 4, children=4, in_json=True)
    limits = rates
    checks: dict[type[BaseModel], Check] = {
        DecisionAnswer: lambda reply: check_decision(reply, rates),
        proposal_model(targets): lambda reply: check_proposal(
            reply, run.limits, vocabulary, targets
        ),
    }
    for model, check in checks.items():
        fields = schema(model)
        lark = answer_grammar(fields, tree, limits).text("lark")
        for walked in masked_walks(lark, 30, np.random.default_rng(0)):
            checked = outcome(check, Reply(walked, "end_turn", None))
            too_large = not isinstance(checked, Accepted) and checked.stage == "limits"
            assert isinstance(checked, Accepted) or too_large, (walked, checked)
