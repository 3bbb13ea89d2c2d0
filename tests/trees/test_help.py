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
    example = f"islandgp {name} {COMMANDS[name].example}".rstrip()
    assert result.out.rstrip().splitlines()[-1].strip() == example
    monkeypatch.chdir(tmp_path)
    for file in ("tree.bt", "other.bt", "tree.xml", "robot.yaml"):
        Path(file).touch()
    Path("runs/default/expert-seed0").mkdir(parents=True)
    command = cli.islandgp.get_command(click.Context(cli.islandgp), name)
    assert command is not None
    command.make_context(name, shlex.split(COMMANDS[name].example))  # raises what is wrong


@pytest.mark.parametrize(
    ("arguments", "line"),
    [
        (["chek", "a.bt"], "islandgp: expected a command, found 'chek'; did you mean check?"),
        (["evolve"], "islandgp: expected a command, found 'evolve'; did you mean run?"),
        (
            ["--seed", "3"],
            "islandgp: expected another option, found --seed; settings are written as KEY=VALUE:"
            " islandgp run seed=...",
        ),
        (["zzz"], "islandgp: expected a command, found 'zzz'; `islandgp -h` shows what it takes"),
        (
            ["play"],
            "islandgp: play: expected FILES..., found none; `islandgp play -h` shows what it takes",
        ),
        (
            ["play", "--sedes", "3"],
            "islandgp: play: expected another option, found --sedes; did you mean --seeds?",
        ),
        (
            ["play", "-", "--seeds", "x"],
            "islandgp: play: '--seeds': expected a valid integer, found 'x'; `islandgp play -h`",
        ),
        (
            ["play", "-", "--seeds", "0"],
            "islandgp: play: '--seeds': expected a number from 1 to 100,000, found 0; `islandgp",
        ),
        (
            ["play", "-", "--timeout", "nan"],
            "islandgp: play: '--timeout': expected a number that is at least 0, found nan; `islan",
        ),
        (
            ["show", "t.bt"],
            "islandgp: show: 'FILE': there is no file t.bt; `islandgp show -h` shows",
        ),
        (
            ["show", "-", "-o"],
            "islandgp: expected a value after -o, found none; `islandgp -h`",
        ),
        (["show", "-", "x"], "islandgp: show: expected no more words, found x; `islandgp show -h`"),
        (["export"], "islandgp: export: expected FILE, found none; `islandgp export -h` shows"),
        (["best"], "islandgp: best: expected RUN, found none; `islandgp best -h` shows what"),
        (["best", "nowhere"], "islandgp: Expected a finished run in nowhere, found none; give"),
    ],
)
def test_an_error_of_use_is_one_line(islandgp: Cli, arguments: list[str], line: str) -> None:
    """Exit code 2 for errors of Click and of this package."""
    result = islandgp(*arguments)
    assert (result.code, result.out) == (2, "")
    assert result.err.startswith(line)
    assert result.err.count("\n") == 1
