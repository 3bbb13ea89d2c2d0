"""Secrets among the extra fields of requests: the server gets them, and no file holds them."""

from __future__ import annotations

from pathlib import Path

import pytest

from islandgp.records.parameters import is_secret, redacted
from islandgp.redaction import names_secret, secrets_in, without_secrets
from islandgp.running.app import main
from islandgp.supervision.llm.message import Request
from tests.llm.server import MessagesServer
from tests.llm.test_key import SMALL

SECRET = "s3cret-0123456789"
FILE = f"""# @package _global_
supervisor:
  policy:
    extra_body:
      top_k: 3
      gateway: {{x-api-key: {SECRET}, list: [{{Authorization: Bearer {SECRET}}}]}}
"""


@pytest.mark.parametrize(
    "sweep", [(), pytest.param(("-m", "seed=0,1"), marks=pytest.mark.slow)], ids=["run", "sweep"]
)
def test_no_file_holds_a_secret_of_the_extra_fields(
    sweep: tuple[str, ...],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capfd: pytest.CaptureFixture[str],
) -> None:
    """Configuration, transcript, names of folders and the screen; other fields are kept."""
    home, conf = tmp_path / "home", tmp_path / "conf/experiment"
    home.mkdir()
    conf.mkdir(parents=True)
    (conf / "mine.yaml").write_text(FILE, encoding="utf-8")
    monkeypatch.chdir(home)
    monkeypatch.setenv("ANTHROPIC_API_KEY", "x")
    overrides = (*SMALL, "experiment=mine", "tracking=off", "--config-dir", str(tmp_path / "conf"))
    with MessagesServer() as server:
        assert main([*overrides, *sweep, f"supervisor.policy.base_url={server.url}"]) == 0
        assert any(SECRET in str(body) for body in server.requests)
    captured = capfd.readouterr()
    assert SECRET not in captured.out + captured.err + " ".join(map(str, home.rglob("*")))
    files = [f for f in home.rglob("*") if f.is_file()]
    assert [f for f in files if SECRET.encode() in f.read_bytes()] == []
    transcripts = [f.read_text().replace(" ", "") for f in files if f.name == "transcript.jsonl"]
    assert transcripts
    assert all('"top_k":3' in text and '"x-api-key":"***"' in text for text in transcripts)


@pytest.mark.parametrize(
    "override",
    [
        f"+supervisor.policy.extra_body.api_key={SECRET}",
        f"supervisor.policy.extra_body={{Authorization: {SECRET}}}",
        f"supervisor.policy={{extra_body: {{gateway: {{key: {SECRET}}}}}}}",
        f"++supervisor.policy.extra_body.auth_token.value={SECRET}",
    ],
)
def test_a_secret_field_on_the_command_line_is_refused(
    override: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capfd: pytest.CaptureFixture[str],
) -> None:
    """One line with the remedy; nothing is written."""
    monkeypatch.chdir(tmp_path)
    assert main([*SMALL, override]) == 2
    captured = capfd.readouterr()
    assert SECRET not in captured.out + captured.err
    assert captured.err.count("\n") == 1
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    ("key", "secret"),
    [
        ("key", True),
        ("x-api-key", True),
        ("apiKey", True),
        ("Authorization", True),
        ("accessToken", True),
        ("client_secret", True),
        ("max_tokens", False),
        ("top_k", False),
        ("keyboard", False),
        ("", False),
    ],
)
def test_which_fields_are_secret(key: str, secret: bool) -> None:
    """By the words of their names, with any separator."""
    assert names_secret(key) is secret
    assert is_secret(f"supervisor.policy.extra_body.{key}") is secret
    config = {"supervisor": {"policy": {"extra_body": {"a": [{key: "b"}]}}}}
    hidden = redacted(config)["supervisor"]["policy"]["extra_body"]["a"][0][key]
    assert hidden == ("***" if secret else "b")
    assert list(secrets_in({"a": [{key: "b"}]})) == (["b"] if secret else [])


def test_a_digest_is_the_same_with_and_without_the_secret() -> None:
    """So a transcript, which lacks it, can be replayed and resumed."""
    extra = {"token": "abc", "n": 1}
    one, other = (Request("m", "s", ("t",), 9, extra=e) for e in (extra, without_secrets(extra)))
    assert one.digest == other.digest
    assert one.extra == extra
