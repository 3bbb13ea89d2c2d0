"""Where the folders beside the package are found."""

from __future__ import annotations

from pathlib import Path

import pytest

from islandgp import resources
from islandgp.errors import IslandError
from islandgp.resources import resource


def make(root: Path, *, checkout: bool, inside: bool, beside: bool) -> Path:
    package = root / "islandgp"
    package.mkdir()
    if checkout:
        (root / "pyproject.toml").touch()
    if inside:
        (package / "grammar").mkdir()
    if beside:
        (root / "grammar").mkdir()
    return package


def test_this_checkout() -> None:
    """The grammar of a checkout is the one beside the package."""
    assert (resource("grammar") / "bt.lark").is_file()


def test_installed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """An installed package has its folders inside."""
    package = make(tmp_path, checkout=False, inside=True, beside=True)
    monkeypatch.setattr(resources, "_PACKAGE", package)
    assert resource("grammar") == package / "grammar"


def test_stale_copy_in_a_checkout(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A checkout never reads a copy inside the package, however it came there."""
    package = make(tmp_path, checkout=True, inside=True, beside=True)
    monkeypatch.setattr(resources, "_PACKAGE", package)
    assert resource("grammar") == tmp_path / "grammar"


@pytest.mark.parametrize("checkout", [True, False])
def test_missing(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, checkout: bool) -> None:
    """A missing folder is reported as a broken installation."""
    package = make(tmp_path, checkout=checkout, inside=False, beside=False)
    monkeypatch.setattr(resources, "_PACKAGE", package)
    with pytest.raises(IslandError, match="install islandgp again"):
        resource("grammar")
