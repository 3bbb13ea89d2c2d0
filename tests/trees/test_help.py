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
    said = islandgp(name, "--help")
    example = f"islandgp {name} {COMMANDS[name].example}".rstrip()
    assert said.out.rstrip().splitlines()[-1].strip() == example
    monkeypatch.chdir(tmp_path)
    for file in ("tree.bt", "other.bt", "tree.xml", "robot.yaml"):
        Path(file).touch()
    Path("runs/default/expert-seed0").mkdir(parents=True)
    command = cli.islandgp.get_command(click.Context(cli.islandgp), name)
    assert command is not None
    command.make_context(name, shlex.split(COMMANDS[name].example))  # raises what is wrong


@pytest.mark.parametrize(
    ("words", "line"),
    [
        (["chek", "a.bt"], "islandgp: expected a command, found 'chek'; did you mean check?"),
        (["zzz"], "islandgp: expected a command, found 'zzz'; `islandgp -h` shows what it takes"),
        (
            ["play"],
            "islandgp: play: missing argument 'FILES...'; `islandgp play -h` shows what it takes",
        ),
        (
            ["play", "--sedes", "3"],
            "islandgp: play: no such option: --sedes; did you mean --seeds?",
        ),
        (["play", "t.bt", "--seeds", "x"], "islandgp: play: invalid value for '--seeds': 'x' is"),
        (["best"], "islandgp: best: missing argument 'RUN'; `islandgp best -h` shows what it"),
        (["best", "nowhere"], "islandgp: Expected a finished run in nowhere, found none; give"),
    ],
)
def test_an_error_of_use_is_one_line(islandgp: Cli, words: list[str], line: str) -> None:
    """Exit code 2, whoever finds the error: Click or this package."""
    said = islandgp(*words)
    assert (said.code, said.out) == (2, "")
    assert said.err.startswith(line)
    assert said.err.count("\n") == 1
