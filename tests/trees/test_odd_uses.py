"""Odd files and options: one clear message with exit code 2, and nothing written."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest

from tests.trees.shell import Cli, shell

COMMANDS: dict[str, tuple[str, ...]] = {
    "fmt": ("fmt", "@"),
    "check": ("check", "@"),
    "diff": ("diff", "@", "ok.bt"),
    "export": ("export", "@", "-o", "out.xml"),
    "simplify": ("simplify", "@", "-o", "out.bt"),
}
"""Each with @ in place of a file."""
OK = "selector { when batteryLevel < 20 { SeekCharger } PatrolWaypoint }\n"
UNREADABLE: dict[str, tuple[Callable[[Path], object], str]] = {
    "missing": (lambda _: None, "'odd.bt' does not exist"),
    "folder": (Path.mkdir, "'odd.bt' is a folder without best.bt"),
    "dangling link": (lambda file: file.symlink_to("nowhere"), "'odd.bt' does not exist"),
    "binary": (lambda file: file.write_bytes(bytes(range(256))), "found the byte 0x80"),
    "utf-16": (lambda file: file.write_bytes(OK.encode("utf-16")), "found the byte 0xff"),
    "twenty megabytes": (lambda file: file.write_bytes(b"# c\n" * 5_000_000), "16,777,216 bytes"),
}
WRONG: dict[str, tuple[bytes, str]] = {
    "empty": (b"", "the text is empty"),
    "ten megabytes": (b"# c\n" * 2_500_000, "the text has 10000000 characters"),
    "deep": (b"inverter { " * 5000 + b"SeekCharger" + b" }" * 5000, "too deep"),
    "NUL": (b"selector { \0 }", "unexpected '\\x00'"),
    "infinite": (b"when batteryLevel < 1e400 { SeekCharger }", "not a plain number"),
    "Unicode name": ("Patrouill\u00e9".encode(), "unexpected '\u00e9'"),
}
PLAIN = {
    "BOM": b"\xef\xbb\xbf" + OK.encode(),
    "CRLF": OK.replace(" ", "\r\n").encode(),
    "CR": b"# a\r" + OK.encode(),
    "comments": "# \N{ROBOT FACE} \u2028 \u202e\n".encode() + OK.encode(),
}


@pytest.fixture
def islandgp(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> Cli:
    """Runs `islandgp ARGUMENTS...`; see `shell`."""
    return shell(monkeypatch, capsys)


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The folder where the test runs, with a tree."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "ok.bt").write_text(OK)
    return tmp_path


def use(islandgp: Cli, command: str, file: str) -> tuple[int, str]:
    """The exit code of a command with a file, and all that it prints."""
    result = islandgp(*(file if word == "@" else word for word in COMMANDS[command]))
    return result.code, result.out + result.err


@pytest.mark.parametrize("command", COMMANDS)
@pytest.mark.parametrize("kind", UNREADABLE)
def test_unreadable_files(islandgp: Cli, folder: Path, command: str, kind: str) -> None:
    """The message names what was found in place of the file."""
    make, message = UNREADABLE[kind]
    make(folder / "odd.bt")
    files = {*folder.iterdir()}
    code, output = use(islandgp, command, "odd.bt")
    assert (code, message in output) == (2, True), output
    assert len(output) < 400
    assert {*folder.iterdir()} == files


@pytest.mark.parametrize("command", COMMANDS)
@pytest.mark.parametrize("kind", WRONG)
def test_wrong_texts(islandgp: Cli, folder: Path, command: str, kind: str) -> None:
    """`check` reports them with exit code 1, as any error of a tree; the others reject them."""
    data, message = WRONG[kind]
    file = folder / "odd.bt"
    file.write_bytes(data)
    files = {*folder.iterdir()}
    code, output = use(islandgp, command, "odd.bt")
    assert (code, message in output) == (1 if command == "check" else 2, True), output
    assert len(output) < 800
    assert {*folder.iterdir()} == files
    assert file.read_bytes() == data


@pytest.mark.parametrize("command", ["fmt", "check", "diff", "export", "simplify"])
@pytest.mark.parametrize("kind", PLAIN)
def test_line_ends_of_all_systems_are_accepted(
    islandgp: Cli, folder: Path, command: str, kind: str
) -> None:
    """Marks, line ends of all systems and any characters in comments are accepted."""
    name = "\N{ROBOT FACE} b\u00e4r.bt"
    (folder / name).write_bytes(PLAIN[kind])
    assert use(islandgp, command, name)[0] == 0


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["diff", "-", "-"], "<stdin>:1:1: "),
        (["fmt", "x" * 4000], "invalid value"),
        (["check", "--vocabulary", "ok.bt", "ok.bt"], "expected JSON of `islandgp domain NAME"),
        (["check", "--vocabulary", ".", "ok.bt"], "File '.' is a directory"),
        (["check", "--config-dir", "ok.bt", "ok.bt"], "Directory 'ok.bt' is a file"),
        (["check", "robot's.bt"], "robot's.bt\" does not exist"),
        (["check", ""], "'FILES...': File '' does not exist"),
        (["show", "ok.bt", "-o", ""], "'-o' / '--output': File '' does not exist"),
        (["domain", "island", "no.bt"], "got unexpected extra argument (no.bt)"),
        (["check", "--config-dir", "robot's", "ok.bt"], "robot's\" does not exist"),
        (["diff", "ok.bt"], "missing argument 'NEW'"),
        (["export", "ok.bt", "-o", "no/x.xml"], "found: no folder no"),
        (["export", "ok.bt", "-o", "."], "File '.' is a directory"),
        (["export", "ok.bt", "--to", "pdf"], "'pdf' is not one of 'json', 'btcpp', 'pytrees'"),
        (["export", "ok.bt", "-o", "x.pdf"], "ends in one of .json, .xml, .py, found x.pdf"),
        (["export", "ok.bt"], "expected --to with one of json, btcpp, pytrees, or a name after -o"),
        (["export", "ok.bt", "--to", "btcpp", "-o", "ok.bt"], "found ok.bt itself"),
        (["simplify", "ok.bt", "-o", "./ok.bt"], "found ./ok.bt itself"),
        (["replay", "ok.bt", "-o", "./ok.bt"], "found ./ok.bt itself"),
        (["export", "ok.bt", "--header"], "expected --header alone"),
        (["simplify", "ok.bt", "-o", "no/x.bt"], "found: no folder no"),
        (["simplify", "ok.bt", "ok.bt"], "got unexpected extra argument (ok.bt)"),
    ],
    ids=lambda each: " ".join(each)[:40] if isinstance(each, list) else "",
)
def test_odd_options(islandgp: Cli, folder: Path, arguments: list[str], message: str) -> None:
    """One line with what is expected, and no file is written."""
    result = islandgp(*arguments, stdin=OK)
    assert (result.code, message in result.err) == (2, True), result.err
    assert len(result.err) < 700
    assert [*folder.iterdir()] == [folder / "ok.bt"]
    assert (folder / "ok.bt").read_text() == OK


def test_a_file_without_permission(
    islandgp: Cli, folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """It is not reported as missing."""
    monkeypatch.setattr("os.access", lambda *_: False)  # root can read every file
    result = islandgp("fmt", folder / "ok.bt")
    assert result.code == 2
    assert "is not readable" in result.err


@pytest.mark.usefixtures("folder")
def test_a_full_disk(islandgp: Cli) -> None:
    """A device that takes nothing is reported as such."""
    if not Path("/dev/full").exists():
        pytest.skip("needs /dev/full")
    for arguments in (["export", "ok.bt", "--to", "btcpp"], ["simplify", "ok.bt"]):
        result = islandgp(*arguments, "-o", "/dev/full")
        assert result.code == 2
        assert "Expected a place to write /dev/full, found: No space left" in result.err
