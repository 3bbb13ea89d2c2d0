"""docs/supervisors.md: its tables are whole, and its commands run."""

from __future__ import annotations

import re
import shlex
from pathlib import Path

import pytest

from islandgp.gp.edits import EDITS
from islandgp.resources import resource
from islandgp.running.app import main
from tests.running.commands import ROOT

TEXT = (ROOT / "docs/supervisors.md").read_text(encoding="utf-8")
SMALL = ("gp.population=7", "gp.generations=3", "world.episode.length=20", "progress=off")
COMMANDS = [
    shlex.split(line)
    for block in re.findall(r"^```sh\n(.*?)^```", TEXT, re.MULTILINE | re.DOTALL)
    for line in block.splitlines()
]


def rows(heading: str) -> list[str]:
    """The names in the first column of the table below a heading."""
    part = TEXT.split(heading, 1)[1].split("\n## ")[0]
    cells = re.findall(r"^\| ((?:`\w+`(?:, )?)+)(?: \(default\))? \|", part, re.MULTILINE)
    return [name for cell in cells for name in re.findall(r"`(\w+)`", cell)]


def test_every_supervisor_has_its_row() -> None:
    """The table has what conf/supervisor has."""
    names = sorted(path.stem for path in (resource("conf") / "supervisor").glob("*.yaml"))
    assert sorted(rows("# Supervisors")) == names


def test_every_kind_of_edit_has_its_row() -> None:
    """With what it needs."""
    assert rows("## Edits") == list(EDITS)
    for name, kind in EDITS.items():
        assert f"| `{name}` | `{kind.needs}` |" in TEXT


@pytest.mark.slow
def test_commands(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Each of them, one after the other."""
    monkeypatch.chdir(tmp_path)
    assert COMMANDS
    for arguments in COMMANDS:
        assert arguments[:3] == ["python", "-m", "islandgp"]
        assert main([*arguments[3:], *SMALL, "evaluator=serial"]) == 0, arguments
