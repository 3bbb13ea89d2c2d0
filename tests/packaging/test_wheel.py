"""The wheel: installed alone, it runs from any folder."""

from __future__ import annotations

import os
import subprocess
import sys
import sysconfig
import venv
import zipfile
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
FOLDERS = ("conf", "grammar", "prompts")

pytestmark = pytest.mark.slow


def call(*words: str | Path, cwd: Path) -> str:
    """Runs a command that must succeed, without this checkout on its path; returns its output."""
    env = {name: value for name, value in os.environ.items() if name != "PYTHONPATH"}
    found = subprocess.run(
        [str(word) for word in words], cwd=cwd, env=env, capture_output=True, text=True, check=False
    )
    assert found.returncode == 0, found.stdout + found.stderr
    return found.stdout


@pytest.fixture(scope="module")
def wheel(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The wheel, built from this checkout."""
    folder = tmp_path_factory.mktemp("wheel")
    call(sys.executable, "-m", "hatchling", "build", "-t", "wheel", "-d", folder, cwd=ROOT)
    (found,) = folder.glob("*.whl")
    return found


@pytest.fixture(scope="module")
def python(wheel: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The Python of a new environment that has the wheel, and the dependencies of this one."""
    folder = tmp_path_factory.mktemp("environment")
    venv.create(folder, with_pip=False, symlinks=True)
    (library,) = folder.glob("lib/python*/site-packages")
    (library / "dependencies.pth").write_text(sysconfig.get_path("purelib") + "\n")
    found = folder / "bin" / "python"
    options = ("--no-deps", "--no-index", "--disable-pip-version-check", "--quiet")
    call(sys.executable, "-m", "pip", "--python", found, "install", *options, wheel, cwd=folder)
    return found


def test_everything_travels(wheel: Path) -> None:
    """Each file of conf, grammar and prompts is in the wheel, and the licence."""
    names = set(zipfile.ZipFile(wheel).namelist())
    files = {
        f"islandgp/{path.relative_to(ROOT).as_posix()}"
        for folder in FOLDERS
        for path in (ROOT / folder).rglob("*")
        if path.is_file()
    }
    assert len(files) > 20
    assert files - names == set()
    assert any(name.endswith("licenses/LICENSE") for name in names)


def test_nothing_else_travels(wheel: Path) -> None:
    """Tests, documentation and caches stay at home."""
    names = zipfile.ZipFile(wheel).namelist()
    tops = {name.partition("/")[0] for name in names}
    assert {top for top in tops if not top.endswith(".dist-info")} == {"islandgp"}
    assert [name for name in names if "__pycache__" in name or "/tests/" in name] == []


def test_a_run_from_another_folder(python: Path, tmp_path: Path) -> None:
    """`python -m islandgp` runs in an empty folder, from the wheel's own configuration."""
    words = ("experiment=smoke", "tracking=off", "progress=off", "evaluator.policy.workers=1")
    found = call(python, "-m", "islandgp", *words, cwd=tmp_path)
    assert "Best robot" in found
    assert [path.name for path in tmp_path.iterdir()] == ["runs"]
    code = "import islandgp.resources as r; print(r.resource('prompts'), r.resource('grammar'))"
    places = call(python, "-c", code, cwd=tmp_path)
    assert str(ROOT) not in places
    assert str(python.parents[1]) in places


def test_the_command(python: Path, tmp_path: Path) -> None:
    """The `islandgp` command is there, and tells its version."""
    assert "0.1.0" in call(python.with_name("islandgp"), "--version", cwd=tmp_path)


def test_same_records_as_the_checkout(python: Path, tmp_path: Path) -> None:
    """The installed program writes the same records as the checkout."""
    words = ("experiment=smoke", "tracking=off", "progress=off", "gp.generations=3")
    call(python, "-m", "islandgp", *words, "runs=installed", cwd=tmp_path)
    env = {**os.environ, "PYTHONPATH": str(ROOT)}
    command = [sys.executable, "-m", "islandgp", *words, "runs=checkout"]
    subprocess.run(command, cwd=tmp_path, env=env, check=True, capture_output=True)
    one, two = (tmp_path / name for name in ("installed", "checkout"))
    (first,), (second,) = (list(p.rglob("generations.jsonl")) for p in (one, two))
    assert first.read_bytes() == second.read_bytes()
