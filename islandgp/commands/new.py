"""`islandgp new`: a folder with a robot of one's own that runs at once."""

from __future__ import annotations

import re
import runpy
import sys
from collections.abc import Mapping
from importlib.metadata import packages_distributions
from keyword import iskeyword
from pathlib import Path
from shutil import copytree, ignore_patterns
from tempfile import TemporaryDirectory
from typing import Final

import click

from islandgp.errors import ConfigError, IslandError
from islandgp.resources import resource

TEMPLATES: Final = resource("examples/templates")
"""A folder for each kind; one without a configuration extends the simulator. A kind may have a
script `fill.py` with a function `words(environment)`: words of its files and their replacements."""

LEFT_OUT: Final = ignore_patterns("__pycache__", "*.pyc", "fill.py")


@click.command()
@click.argument("name")
@click.option(
    "--kind",
    type=click.Choice(sorted(path.name for path in TEMPLATES.iterdir() if path.is_dir())),
    default="simulator",
    show_default=True,
    help="A simulator in Python, a Gymnasium environment, or a simulator with a map for a robot.",
)
@click.option(
    "--environment", metavar="ID", help="Gymnasium environment; default: CartPole-v1.", default=None
)
def new_command(name: str, kind: str, environment: str | None) -> None:
    """Write a folder NAME with a robot that runs at once: module, configuration, tree and test.

    `make run` there evolves a tree for it, `make test` checks its contract.
    """
    if environment is not None and kind != "gymnasium":
        raise click.UsageError(f"expected --kind gymnasium with --environment, found {kind}")
    folder = Path(name)
    _must_be_new(folder)
    words = {"MyRobot": "".join(part.title() for part in name.split("_")), "my_robot": name}
    if kind == "gymnasium":
        fill = runpy.run_path(str(TEMPLATES / kind / "fill.py"))
        words |= fill["words"](environment or "CartPole-v1")
    try:
        with TemporaryDirectory(prefix=f".{name}-", dir=folder.absolute().parent) as scratch:
            _fill(Path(scratch) / name, kind, words).rename(folder)
    except OSError as error:
        raise IslandError(
            f"{folder}: expected a folder that can be written, found: {error.strerror}"
        ) from None
    click.echo(f"Made {folder}/. Next: cd {folder}, make test, make run.")


def _fill(made: Path, kind: str, words: Mapping[str, str]) -> Path:
    """Copy the templates of a kind to a new folder, with the words replaced; returns the folder."""
    if not (TEMPLATES / kind / "conf").exists():
        copytree(TEMPLATES / "simulator", made, ignore=LEFT_OUT)
    copytree(TEMPLATES / kind, made, dirs_exist_ok=True, ignore=LEFT_OUT)
    any_word = re.compile("|".join(map(re.escape, words)))
    for path in [p for p in sorted(made.rglob("*")) if p.is_file()]:
        text = path.read_text(encoding="utf-8")
        path.write_text(any_word.sub(lambda word: words[word[0]], text), encoding="utf-8")
        path.rename(path.with_name(path.name.replace("my_robot", made.name)))
    return made


def _must_be_new(folder: Path) -> None:
    """Raises ConfigError unless the name is a new module's, domain's and folder's."""
    name = folder.name
    domains = (path.stem for path in resource("conf").glob("domain/*.yaml"))
    taken = {*sys.stdlib_module_names, *packages_distributions(), *domains}
    if not re.fullmatch(r"[a-z][a-z0-9_]{0,39}", str(folder)) or iskeyword(name):
        found = f"{str(folder)!r}; use lower-case letters, digits and _, such as my_robot"
    elif name in taken or folder.exists():
        found = f"{name}, the name of a module, a domain or a file here"
    else:
        return
    raise ConfigError(f"Expected a new name for the robot, found {found}.")
