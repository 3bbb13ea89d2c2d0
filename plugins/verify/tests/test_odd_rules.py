"""Odd files and rules: one clear message with exit code 2."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.trees.shell import Cli
from tests.trees.test_odd_uses import OK, UNREADABLE, WRONG

RULE = "never SeekCharger while lap > 3"


@pytest.fixture(autouse=True)
def _here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The folder where the test runs, with a tree."""
    monkeypatch.chdir(tmp_path)
    Path("ok.bt").write_text(OK)


@pytest.mark.parametrize("kind", UNREADABLE)
def test_unreadable_files(islandgp: Cli, kind: str) -> None:
    """The message names what was found in place of the file."""
    make, message = UNREADABLE[kind]
    make(Path("odd.bt"))
    result = islandgp("verify-tree", "odd.bt", RULE)
    assert (result.code, message in result.err) == (2, True), result.err


@pytest.mark.parametrize("kind", WRONG)
def test_wrong_texts(islandgp: Cli, kind: str) -> None:
    """What is no tree is rejected."""
    data, message = WRONG[kind]
    Path("odd.bt").write_bytes(data)
    result = islandgp("verify-tree", "odd.bt", RULE)
    assert (result.code, message in result.err) == (2, True), result.err


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["verify-tree", "ok.bt"], "missing argument 'RULES...'"),
        (["verify-tree", "ok.bt", "never"], "rule 'never': expected never ACTION while CONDITION"),
        (["verify-tree", "ok.bt", "never SeekCharger while lap > nan"], "'nan' does not fit lap"),
        (
            ["verify-tree", "ok.bt", f"never SeekCharger while {'(' * 3000}lap{')' * 3000}"],
            "too long",
        ),
        (
            ["verify-tree", "ok.bt", RULE, "--steps", "0"],
            "0 is not in the range 1<=x<=2000000",
        ),
    ],
    ids=lambda each: " ".join(each)[:40] if isinstance(each, list) else "",
)
def test_odd_rules(islandgp: Cli, arguments: list[str], message: str) -> None:
    """One line with what is expected."""
    result = islandgp(*arguments)
    assert (result.code, message in result.err) == (2, True), result.err
    assert len(result.err) < 700
