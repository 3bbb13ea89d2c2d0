"""Commands that messages print can be given as they are."""

from __future__ import annotations

import ast
import re
import shlex
import tomllib
from html import unescape
from pathlib import Path
from typing import Final

import pytest
from click.testing import CliRunner

from islandgp.cli import islandgp as group
from islandgp.running.app import main
from islandgp.tracking.mlflow import sync_command
from tests.running.commands import ROOT, TINY, fake
from tests.tracking.folders import place

COMMAND: Final = re.compile(
    r"`((?:islandgp|python -m islandgp)[^`]*)`"
    r"|(?:^| )(islandgp [a-z]+ [A-Z-]\S*(?: [^.;,]*)?|python -m islandgp(?= to))"
)
"""In a message: in backticks, or a subcommand with its words."""

INSTALLED: Final = re.compile(r"pip install [^\n']*'(islandgp[\w-]*)\[(\w+)\]'")

EXECUTED: Final = {
    "islandgp check {}": "check tree.bt",
    "islandgp domain {} --json": "domain island --json",
    "islandgp domain --json": "domain --json",
    "islandgp domain NAME --json": "domain island --json",
    "islandgp export TREE --to json": "export tree.bt --to json",
    "islandgp fmt": "fmt tree.bt",
    "islandgp examples NAME prints one": "examples all_rounder",
    "islandgp export --header -o {}": "export --header -o nodes.hpp",
    "islandgp transcript {}": "",  # needs a language model: tests/llm/test_transcript_command.py
    "python -m islandgp": "run experiment=smoke gp.generations=1",
    "python -m islandgp --help": "run --help",
}
"""The texts of messages, with words that are executed."""

NOT_COMMANDS: Final = {"islandgp in WSL."}


def printed() -> set[str]:
    """The commands in the strings of the package, without docstrings and comments."""
    found = set()
    for path in sorted((ROOT / "islandgp").rglob("*.py")):
        tree = ast.parse(path.read_text(encoding="utf-8"))
        docs = {id(node.value) for node in ast.walk(tree) if isinstance(node, ast.Expr)}
        for node in ast.walk(tree):
            parts = node.values if isinstance(node, ast.JoinedStr) else [node]
            texts = [part.value if isinstance(part, ast.Constant) else "{}" for part in parts]
            if isinstance(node, ast.JoinedStr | ast.Constant) and id(node) not in docs:
                text = "".join(each for each in texts if isinstance(each, str))
                found |= {first or second for first, second in COMMAND.findall(text)}
    return found - NOT_COMMANDS


def test_every_printed_command_is_in_the_table() -> None:
    """A new message with a command needs a row."""
    assert printed() == EXECUTED.keys()


@pytest.mark.parametrize("words", sorted(filter(None, {*EXECUTED.values()})))
def test_the_commands_of_messages_run(
    words: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """With names in the place of capitals."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "tree.bt").write_text("domain cartpole\nPushLeft")
    more = [*fake("Instant"), "tracking=off"] if words.startswith("run exp") else []
    result = CliRunner().invoke(group, [*words.split(), *more])
    assert result.exit_code == 0, result.output
    assert result.output or words.startswith(("export", "fmt"))


def test_the_extras_of_messages_and_docs_exist() -> None:
    """`pip install 'islandgp[ui]'` and those of plug-ins; pip only warns of others."""
    files = [ROOT / "pyproject.toml", *ROOT.glob("plugins/*/pyproject.toml")]
    projects = [tomllib.loads(file.read_text())["project"] for file in files]
    extras = {p["name"]: p.get("optional-dependencies", ()) for p in projects}
    sources = (f for part in ("islandgp", "plugins", "docs") for f in (ROOT / part).rglob("*.*"))
    texts = [f.read_text(encoding="utf-8") for f in sources if f.suffix in (".py", ".md")]
    named = {each for text in texts for each in INSTALLED.findall(text)}
    assert ("islandgp", "ui") in named
    assert [each for each in named if each[1] not in extras[each[0]]] == []


@pytest.mark.slow
def test_the_commands_of_a_sweep_with_a_failure(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """In a folder with a space: the job again, what the page gives as the replay, and `sync`."""
    home = tmp_path / "my runs"
    home.mkdir()
    monkeypatch.chdir(home)
    breaks = fake("Breaks", after=1, how="error", unless="repaired")
    assert main([*TINY, *breaks, "seed=0,1", "keep_going=false", "-m"]) == 1
    commands = re.findall(r"again: +(.*)", capsys.readouterr().err)
    Path("repaired").touch()
    assert len(commands) == 2
    for command in commands:
        assert main(shlex.split(command)[3:]) == 0
    (page, _) = sorted(home.glob("runs/default/*/run.html"))
    replay = re.search(r"<code>([^<]* replay [^<]*)</code>", page.read_text(encoding="utf-8"))
    assert replay is not None
    sync = sync_command([page.parent], [place(home)])
    for line in (f"{unescape(replay[1])} --timeout 0", sync):
        assert CliRunner().invoke(group, shlex.split(line)[1:]).exit_code == 0, line
