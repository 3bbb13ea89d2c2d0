"""The extension for VS Code colours trees: its grammar is generated, and it can be packed."""

from __future__ import annotations

import json
import os
import re
import runpy
import shutil
import subprocess
from collections.abc import Iterator
from pathlib import Path
from typing import Any
from zipfile import ZipFile

import pytest

from islandgp.bt.core.language import parser_of
from islandgp.resources import resource
from tests.running.commands import ROOT

FOLDER = ROOT / "plugins" / "editor" / "vscode"
EXAMPLES = sorted((resource("grammar") / "examples").glob("*.bt"))
GENERATOR = runpy.run_path(str(ROOT / "plugins" / "editor" / "highlighting.py"))
TEXTMATE: Path = GENERATOR["TEXTMATE"]


def textmate() -> str:
    """The grammar that the declarations give."""
    return str(GENERATOR["textmate"]())


def test_editor_grammar_is_up_to_date() -> None:
    """The TextMate grammar is the one that the declarations give (highlighting.py)."""
    assert textmate() == TEXTMATE.read_text(encoding="utf-8")


def scopes(line: str, rules: list[dict[str, Any]]) -> Iterator[tuple[str, str]]:
    """The words of a line with their scopes, as an editor finds them: leftmost, first rule."""
    at = 0
    while at < len(line):
        candidates = [
            (m, rule) for rule in rules if (m := re.compile(rule["match"]).search(line, at))
        ]
        if not candidates:
            return
        match, rule = min(candidates, key=lambda pair: pair[0].start())
        if "captures" in rule:
            for number, captured in rule["captures"].items():
                yield match[int(number)], captured["name"]
        else:
            yield match[0], rule["name"]
        at = match.end()


@pytest.mark.parametrize("file", EXAMPLES, ids=lambda file: file.stem)
def test_highlighting(file: Path) -> None:
    """In every example each word has a colour."""
    rules = json.loads(textmate())["patterns"]
    text = file.read_text(encoding="utf-8")
    pairs = [pair for line in text.splitlines() for pair in scopes(line, rules)]
    coloured = {word for word, _ in pairs}
    assert {
        str(word) for word in parser_of().parse_interactive(text, start="library").iter_parse()
    } - {"{", "}"} <= coloured


def test_highlighting_of_arguments() -> None:
    """Arguments of a subtree have the colours of their places."""
    rules = json.loads(textmate())["patterns"]
    scope_of = dict(scopes("use go(use far(near), Go(to: dock), 3) use it(a, b)", rules))
    assert (scope_of["go"], scope_of["far"]) == ("entity.name.function", "entity.name.function")
    assert (scope_of["Go"], scope_of["to"]) == ("support.function", "variable.parameter")
    assert scope_of["3"] == "constant.numeric"


def test_highlighting_goes_by_place() -> None:
    """Words of any domain have the colour of an action, a key or an argument."""
    rules = json.loads(textmate())["patterns"]
    line = "when not (far or near and low < k) { Go(to: dock, by: 2) } # Go"
    scope_of = dict(scopes(line, rules))
    assert {scope_of[key] for key in ("far", "near", "low")} == {"variable.language"}
    assert scope_of["Go"] == "support.function"
    assert (scope_of["to"], scope_of["by"]) == ("variable.parameter", "variable.parameter")
    assert (scope_of["dock"], scope_of["k"]) == ("constant.language", "variable.other")
    assert scope_of["# Go"] == "comment.line.number-sign"
    assert "invalid.illegal" not in textmate()


def test_editor_extension_is_whole() -> None:
    """Every file that the extension names is there, for the ending that trees have."""
    contributions = json.loads((FOLDER / "package.json").read_text())["contributes"]
    assert contributions["languages"][0]["extensions"] == [".bt"]
    for part in (
        contributions["languages"][0]["configuration"],
        contributions["grammars"][0]["path"],
    ):
        json.loads((FOLDER / part).read_text())


VSCODE = ROOT / "build" / "vscode" / "node_modules"
SAMPLE = """constant low = 20 # percent
include "lib.bt"
subtree go(n) = when not (batteryLevl < low or foundGarbage) abort lower { repeater n { Seek } }
selector { use go(3) PatrolWaypoint }
"""


@pytest.mark.slow
@pytest.mark.skipif(not VSCODE.exists(), reason="run make vscode-tools first")
def test_highlighting_in_the_engine_of_vs_code(tmp_path: Path) -> None:
    """VS Code's own engine finds the scopes that are found here, in the examples and elsewhere."""
    file = tmp_path / "my tree.bt"
    file.write_text(SAMPLE)
    script = Path(__file__).with_name("textmate.js")
    process = subprocess.run(
        ["node", script, TEXTMATE, *EXAMPLES, file],
        env={**os.environ, "NODE_PATH": str(VSCODE)},
        capture_output=True,
        check=True,
        text=True,
        encoding="utf-8",
        timeout=100,
    )
    theirs = [tuple(json.loads(line)) for line in process.stdout.splitlines()]
    rules = json.loads(textmate())["patterns"]
    lines = [line for f in (*EXAMPLES, file) for line in f.read_text("utf-8").splitlines()]
    expected = [pair for line in lines for pair in scopes(line, rules)]
    assert [pair for pair in theirs if pair[1] != "source.islandgp-bt"] == expected


@pytest.mark.slow
@pytest.mark.skipif(not VSCODE.exists(), reason="run make vscode-tools first")
def test_the_extension_can_be_packed(tmp_path: Path) -> None:
    """VS Code's packer takes the folder, which checks its package.json."""
    folder = shutil.copytree(FOLDER, tmp_path / "vscode")
    packed = tmp_path / "islandgp-bt.vsix"
    command = [VSCODE / ".bin" / "vsce", "package", "--no-dependencies", "-o", packed]
    options = ["--allow-missing-repository", "--skip-license"]
    subprocess.run([*command, *options], cwd=folder, capture_output=True, check=True, timeout=100)
    with ZipFile(packed) as archive:
        assert "extension/syntaxes/islandgp-bt.tmLanguage.json" in archive.namelist()
