"""Help and errors of use have one form in all commands."""

from __future__ import annotations

import shlex
from pathlib import Path

import click
import pytest

from islandgp import cli
from islandgp.cli import COMMANDS
from tests.trees.shell import Cli


@pytest.mark.parametrize("name", [name for name in COMMANDS if name != "run"])  # Hydra's help
def test_each_help_ends_with_an_example_that_the_command_takes(
    islandgp: Cli, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, name: str
) -> None:
    """Its options exist, and its words are as many as it expects."""
    result = islandgp(name, "--help")
    example = f"islandgp {name} {COMMANDS[name][2]}".rstrip()
    assert result.out.rstrip().splitlines()[-1].strip() == example
    monkeypatch.chdir(tmp_path)
    for file in ("tree.bt", "other.bt", "tree.xml", "robot.yaml"):
        Path(file).touch()
    Path("runs/default/a-run").mkdir(parents=True)
    command = cli.islandgp.get_command(click.Context(cli.islandgp), name)
    assert command is not None
    command.make_context(name, shlex.split(COMMANDS[name][2]))  # raises what is wrong


def test_no_words_show_the_help(islandgp: Cli) -> None:
    """As --help does, with exit code 0."""
    assert islandgp() == islandgp("--help")
    assert islandgp().out.startswith("Usage: islandgp")


@pytest.mark.parametrize(
    ("arguments", "line"),
    [
        (["chek", "a.bt"], "islandgp: expected a command, found 'chek'; did you mean check?"),
        (
            ["--seed", "3"],
            "islandgp: no such option '--seed'; settings are written as islandgp run seed=VALUE;",
        ),
        (["zzz"], "islandgp: expected a command, found 'zzz'; `islandgp -h` shows what it takes"),
        (["play"], "islandgp: play: missing argument 'FILES...'; `islandgp play -h` shows what it"),
        (["play", "--sedes", "3"], "islandgp: play: no such option '--sedes'"),
        (
            ["play", "-", "--seeds", "x"],
            "islandgp: play: invalid value for '--seeds' / '--worlds':",
        ),
        (
            ["play", "-", "--seeds", "0"],
            "islandgp: play: invalid value for '--seeds' / '--worlds':",
        ),
        (["play", "-", "--timeout", "nan"], "islandgp: play: invalid value for '--timeout': 'nan'"),
        (["ui", "--port", "70000"], "islandgp: ui: invalid value for '--port': 70000 is not in"),
        (["show", "t.bt"], "islandgp: show: invalid value for 'FILE': File 't.bt' does not exist"),
        (["show", "-", "x"], "islandgp: show: got unexpected extra argument (x); `islandgp show"),
        (
            ["best", "nowhere"],
            "islandgp: Expected runs in nowhere, found no such folder; run `python",
        ),
    ],
)
def test_an_error_of_use_is_one_line(islandgp: Cli, arguments: list[str], line: str) -> None:
    """Exit code 2 for errors of Click and of this package."""
    result = islandgp(*arguments)
    assert (result.code, result.out) == (2, "")
    assert result.err.startswith(line)
    assert result.err.count("\n") == 1
