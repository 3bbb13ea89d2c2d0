"""TAB: commands and overrides, as the shells ask for them."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path

import pytest
from click.testing import CliRunner

from islandgp.cli import islandgp
from islandgp.commands.completion_command import LINES, overrides

pytestmark = pytest.mark.process

BASH = """
eval "$(_ISLANDGP_COMPLETE=bash_source islandgp)"
complete() {
  COMP_WORDS=("$@"); COMP_CWORD=$(($# - 1)); COMPREPLY=()
  _islandgp_completion islandgp
  echo "${COMPREPLY[*]}"
}
complete islandgp compl
complete islandgp run supervisor = ex
"""


def completions(before: Sequence[str], incomplete: str) -> list[str]:
    """What TAB offers."""
    return [item.value for item in overrides(before, incomplete)]


@pytest.mark.parametrize(
    ("before", "incomplete", "expected"),
    [
        ((), "gp.tourn", ["gp.tournament_size="]),
        ((), "supervisor=ex", ["supervisor=expert"]),  # zsh, fish
        (("supervisor", "="), "ex", ["expert"]),  # bash
        (("gp.tournament_size",), "", ["3"]),  # bash, behind the =
        (("-m", "experiment", "=", "smoke"), "gp.tourn", ["gp.tournament_size="]),
        (("no", "=", "such"), "gp.", []),
    ],
)
def test_overrides_are_completed(before: list[str], incomplete: str, expected: list[str]) -> None:
    """Keys, groups and values; what is not yet right completes to nothing, without an error."""
    assert completions(before, incomplete) == expected


def test_a_user_s_configuration_is_completed(tmp_path: Path) -> None:
    """With --config-dir."""
    (tmp_path / "experiment").mkdir()
    (tmp_path / "experiment/mine.yaml").write_text("# @package _global_\nname: mine\n")
    assert completions(("--config-dir", str(tmp_path)), "experiment=mine") == ["experiment=mine"]


def test_the_line_is_printed() -> None:
    """For the shell that is named, or for $SHELL; another one is refused in a line."""
    for shell, (file, line) in LINES.items():
        for arguments, env in (([shell], {}), ([], {"SHELL": f"/usr/bin/{shell}"})):
            result = CliRunner().invoke(islandgp, ["completion", *arguments], env=env)
            assert result.stdout == f"{line}\n"
            assert file in result.stderr
    result = CliRunner().invoke(islandgp, ["completion"], env={"SHELL": "/bin/csh"})
    assert result.exit_code == 2
    assert "expected a shell of bash, zsh, fish, found csh" in result.stderr


@pytest.mark.slow
@pytest.mark.skipif(shutil.which("bash") is None, reason="bash is not installed")
def test_bash_completes() -> None:
    """In bash itself, with the line that `islandgp completion` prints."""
    path = f"{Path(sys.executable).parent}:{os.environ['PATH']}"
    process = subprocess.run(
        ["bash", "-c", BASH], capture_output=True, text=True, env={**os.environ, "PATH": path}
    )
    assert process.stdout.split("\n")[:2] == ["completion", "expert"]


@pytest.mark.slow
@pytest.mark.parametrize("shell", ["zsh", "fish"])
def test_zsh_and_fish_read_the_line(shell: str) -> None:
    """The line is sound, and what they ask is answered."""
    if shutil.which(shell) is None:
        pytest.skip(f"{shell} is not installed")
    path = f"{Path(sys.executable).parent}:{os.environ['PATH']}"
    env = {**os.environ, "PATH": path}
    process = subprocess.run(
        [shell, "-c", LINES[shell][1]], capture_output=True, text=True, env=env
    )
    assert process.stderr == ""


@pytest.mark.slow
@pytest.mark.parametrize("shell", ["zsh", "fish"])
def test_requests_of_zsh_and_fish_are_answered(shell: str) -> None:
    """By the variables that click's lines for these shells set."""
    variables = {
        "_ISLANDGP_COMPLETE": f"{shell}_complete",
        "COMP_WORDS": "islandgp run supervisor=ex",
        "COMP_CWORD": "2" if shell == "zsh" else "supervisor=ex",
    }
    program = str(Path(sys.executable).parent / "islandgp")
    env = {**os.environ, **variables}
    process = subprocess.run([program], capture_output=True, text=True, env=env)
    assert "supervisor=expert" in process.stdout
    assert process.stderr == ""
