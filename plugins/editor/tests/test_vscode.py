"""The extension for VS Code: its package, and its client with the real language server."""

from __future__ import annotations

import json
import runpy
import shutil
import subprocess
import sys
from pathlib import Path
from socket import socket
from typing import Any
from xml.etree import ElementTree
from zipfile import ZipFile

import pytest
from language_client import CODE

from tests.running.commands import ROOT

FOLDER = ROOT / "plugins" / "editor" / "vscode"
HARNESS = Path(__file__).with_name("vscode.js")
needs_node = pytest.mark.skipif(shutil.which("node") is None, reason="Node.js is not installed")


def test_the_package_holds_all_files(tmp_path: Path) -> None:
    """`make vscode` packs the same bytes again; each file that package.json names is inside."""
    pack = runpy.run_path(str(ROOT / "plugins" / "editor" / "pack.py"))["pack"]
    packed = [tmp_path / name for name in ("a.vsix", "b.vsix")]
    for file in packed:
        pack(file)
    assert packed[0].read_bytes() == packed[1].read_bytes()
    with ZipFile(packed[0]) as archive:
        about = json.loads(archive.read("extension/package.json"))
        contributions = about["contributes"]
        inside = (
            about["main"],
            contributions["languages"][0]["configuration"],
            contributions["grammars"][0]["path"],
            "./connection.js",
        )
        assert {f"extension/{file.removeprefix('./')}" for file in inside} <= {*archive.namelist()}
        manifest = ElementTree.fromstring(archive.read("extension.vsixmanifest"))
        ElementTree.fromstring(archive.read("[Content_Types].xml"))
    identity = next(each for each in manifest.iter() if each.tag.endswith("}Identity"))
    assert identity.attrib["Version"] == about["version"]


def test_a_folder_cannot_choose_the_command() -> None:
    """The command is a setting of the machine, and untrusted folders start no server."""
    about = json.loads((FOLDER / "package.json").read_text(encoding="utf-8"))
    assert about["contributes"]["configuration"]["properties"]["islandgp.command"]["scope"] == (
        "machine"
    )
    assert about["capabilities"]["untrustedWorkspaces"]["supported"] is False


def client(folder: Path, *command: str) -> dict[str, list[Any]]:
    """What the extension gives VS Code, by request."""
    process = subprocess.run(
        ["node", str(HARNESS), str(FOLDER), *command],
        cwd=folder,
        capture_output=True,
        check=True,
        encoding="utf-8",
        timeout=100,
    )
    answers: dict[str, list[Any]] = {}
    for line in process.stdout.splitlines():
        request, value = json.loads(line)
        answers.setdefault(request, []).append(value)
    return answers


@pytest.mark.slow
@needs_node
@pytest.mark.process
def test_the_client_asks_the_server(tmp_path: Path) -> None:
    """Each provider gives VS Code what the server answers."""
    answers = client(tmp_path, sys.executable, "-c", CODE, "language-server")
    before, after = answers["diagnostics"]
    assert "Did you mean PatrolWaypoint?" in before[0]
    assert after == []
    assert answers["actions"] == [["Replace by PatrolWaypoint"]]
    assert answers["definition"] == [{"line": 0, "character": 8}]
    assert answers["references"] == [2]
    assert answers["symbols"] == [[["go", 11]]]  # VS Code's number of a function
    assert answers["hover"][0].startswith("**SeekCharger**")
    assert answers["completion"] == [["go"]]
    assert answers["prepare"] == [{"line": 1, "character": 15}]
    assert answers["rename"] == [2]
    assert "not a keyword of the language" in answers["refused"][0]
    assert answers["format"][0].startswith("subtree go = SeekCharger\n\nsequence")
    assert answers["errors"] == [[]]


@needs_node
@pytest.mark.process
def test_a_server_that_cannot_start_is_named(tmp_path: Path) -> None:
    """The message has the command."""
    (message,) = client(tmp_path, str(tmp_path / "islandgp"), "language-server")["error"]
    assert "islandgp language-server ended: spawn" in message[0]


CODE_SERVER = ROOT / "build" / "code-server"
ENTRY = CODE_SERVER / "node_modules" / "code-server" / "out" / "node" / "entry.js"


@pytest.mark.slow
@needs_node
@pytest.mark.process
@pytest.mark.skipif(not ENTRY.exists(), reason="code-server is not installed, see README.md")
@pytest.mark.skipif(shutil.which("chromium") is None, reason="Chromium is not installed")
def test_in_vs_code(tmp_path: Path) -> None:
    """The packed extension marks an error at its word, replaces it, formats and completes."""
    pack = runpy.run_path(str(ROOT / "plugins" / "editor" / "pack.py"))["pack"]
    pack(tmp_path / "islandgp-bt.vsix")
    file = tmp_path / "tree.bt"
    file.write_text("sequence {SeekCharger   PatrolWaypont}\n", encoding="utf-8")
    settings = {
        "islandgp.command": [sys.executable, "-c", CODE, "language-server"],
        "security.workspace.trust.enabled": False,
    }
    (tmp_path / "data" / "User").mkdir(parents=True)
    (tmp_path / "data" / "User" / "settings.json").write_text(json.dumps(settings))
    with socket() as free:
        free.bind(("127.0.0.1", 0))
        address = f"127.0.0.1:{free.getsockname()[1]}"
    config = tmp_path / "config.yaml"
    config.write_text("auth: none\n")
    code = ["node", str(ENTRY), "--config", str(config), "--user-data-dir", str(tmp_path / "data")]
    code += ["--extensions-dir", str(tmp_path / "extensions")]
    subprocess.run([*code, "--install-extension", "islandgp-bt.vsix"], cwd=tmp_path, check=True)
    options = ["--bind-addr", address, "--disable-telemetry", "--disable-update-check"]
    with subprocess.Popen([*code, *options], cwd=tmp_path) as server:
        try:
            driver = Path(__file__).with_name("code_server.mjs")
            arguments = [CODE_SERVER, f"http://{address}", file, shutil.which("chromium")]
            process = subprocess.run(
                ["node", str(driver), *map(str, arguments)],
                cwd=tmp_path,
                stdout=subprocess.PIPE,
                check=True,
                encoding="utf-8",
                timeout=200,
            )
        finally:
            server.terminate()
    answers = dict(json.loads(line) for line in process.stdout.splitlines())
    assert "Replace by PatrolWaypoint" in answers["fix"]
    assert "sequence {SeekCharger   PatrolWaypoint}" in answers["fixed"]
    assert "sequence { SeekCharger PatrolWaypoint }" in answers["formatted"]
    assert "SeekCharger" in answers["completion"]
