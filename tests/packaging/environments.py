"""Wheels, and fresh environments that have no more than is installed into them."""

from __future__ import annotations

import os
import subprocess
import sys
import venv
from collections.abc import Mapping
from itertools import chain
from pathlib import Path

PIP = ("--no-deps", "--no-index", "--disable-pip-version-check", "--quiet")


def run(
    *arguments: str | Path, cwd: Path, env: Mapping[str, str] | None = None
) -> subprocess.CompletedProcess[str]:
    """A command that has ended, without this checkout on its path."""
    if env is None:
        env = {name: value for name, value in os.environ.items() if name != "PYTHONPATH"}
    command = [str(argument) for argument in arguments]
    return subprocess.run(command, cwd=cwd, env=env, capture_output=True, text=True, check=False)


def call(
    *arguments: str | Path, cwd: Path, env: Mapping[str, str] | None = None, errors: bool = False
) -> str:
    """The output of a command that must succeed; `errors`: with that on the standard error."""
    process = run(*arguments, cwd=cwd, env=env)
    assert process.returncode == 0, process.stdout + process.stderr
    return process.stdout + process.stderr * errors


def fails(*arguments: str | Path, cwd: Path) -> str:
    """What a command that must end with exit code 2 prints on the standard error."""
    process = run(*arguments, cwd=cwd)
    assert process.returncode == 2, process.stdout + process.stderr
    return process.stderr


def wheel_of(project: Path, folder: Path | None = None) -> Path:
    """The wheel of a project, built in a folder, by default its `dist`."""
    folder = folder or project / "dist"
    call(sys.executable, "-m", "hatchling", "build", "-t", "wheel", "-d", folder, cwd=project)
    (file,) = folder.glob("*.whl")
    return file


def new_environment(folder: Path) -> Path:
    """The Python of a new environment with the dependencies of this one, without islandgp's own."""
    venv.create(folder, with_pip=False, symlinks=True)
    libraries = folder / "libraries"
    libraries.mkdir()
    places = [Path(place) for place in sys.path if place.endswith("site-packages")]
    for path in chain(*(place.iterdir() for place in places)):
        if not path.name.startswith(("islandgp", "__editable__", "_editable_impl_")):
            (libraries / path.name).symlink_to(path)
    (packages,) = folder.glob("lib/python*/site-packages")
    (packages / "libraries.pth").write_text(f"{libraries}\n", encoding="utf-8")
    return folder / "bin" / "python"


def install(python: Path, *wheels: Path) -> None:
    """Installs wheels into the environment of a Python."""
    command = (sys.executable, "-m", "pip", "--python", python, "install", *PIP, *wheels)
    call(*command, cwd=python.parent)
