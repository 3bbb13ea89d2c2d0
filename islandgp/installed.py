"""Commands, folders of configuration and domains that are installed, by entry points.

Looking them up runs no code of a distribution: a command is imported when it is used, and a folder
is found by the name of its package.
"""

from __future__ import annotations

import sys
from functools import cache
from importlib import import_module
from importlib.metadata import EntryPoint, entry_points
from importlib.util import find_spec
from pathlib import Path
from typing import Any, Final

from islandgp.errors import IslandError
from islandgp.resources import resource

COMMANDS: Final = "islandgp.commands"
"""The group of commands: `NAME = "MODULE:COMMAND"`, a command of Click."""

CONF: Final = "islandgp.conf"  # the group of folders of configuration: `NAME = "PACKAGE.FOLDER"`


@cache
def added(group: str) -> tuple[EntryPoint, ...]:
    """The entry points of a group, in the order of their names."""
    return tuple(sorted(entry_points(group=group), key=lambda e: (e.name, owner(e))))


def owner(entry: EntryPoint) -> str:
    """The name and version of the distribution of an entry point."""
    return f"{entry.dist.name} {entry.dist.version}" if entry.dist else entry.value


def summary(entry: EntryPoint) -> str:
    """The description of the distribution of an entry point, in one line."""
    return str(entry.dist.metadata["Summary"] or owner(entry)) if entry.dist else owner(entry)


def load_command(name: str) -> Any:
    """The object of the entry point of a command; None if there is no such command.

    Raises:
        IslandError: it cannot be imported, or two distributions have it.
    """
    entries = [entry for entry in added(COMMANDS) if entry.name == name]
    if len(entries) > 1:
        raise IslandError(
            f"{name}: expected one distribution with this command, found"
            f" {' and '.join(map(owner, entries))}; {_uninstall(entries[-1])}"
        )
    try:
        return entries[0].load() if entries else None
    except (Exception, SystemExit) as error:
        found = " ".join(f"{type(error).__name__}: {error}".split())
        raise IslandError(
            f"{name}: expected {entries[0].value} of {owner(entries[0])}, found {found}; `python -c"
            f" 'import {entries[0].module}'` shows where, {_uninstall(entries[0])}"
        ) from None


@cache
def conf_folders() -> tuple[Path, ...]:
    """The folders of configuration that distributions add.

    One that cannot be used is left out, with a line on the standard error: its package is missing,
    or one of its files has the name of a file in another folder.
    """
    folders: list[Path] = []
    for entry in added(CONF):
        folder = _folder(entry.value)
        found = "none" if folder is None else hidden(folder, (resource("conf"), *folders))
        if folder is not None and not found:
            folders.append(folder)
            continue
        print(
            f"islandgp: {owner(entry)} is left out: expected a folder {entry.value} of"
            f" configuration, with names of its own, found {found}; {_uninstall(entry)}",
            file=sys.stderr,
        )
    return tuple(folders)


def hidden(folder: Path, folders: tuple[Path, ...]) -> str:
    """The first file of a folder with the name of one in other folders, with both; or ""."""
    for path in sorted(folder.rglob("*.yaml")):
        for other in folders:
            file = other / path.relative_to(folder)
            if file.exists() and not file.samefile(path):
                return f"{path}, which {file} hides"
    return ""


def _folder(package: str) -> Path | None:
    """The folder of a package, without importing it; None if there is none."""
    top, *inner = package.split(".")
    try:
        spec = find_spec(top)
    except (ImportError, ValueError):
        return None
    places = spec.submodule_search_locations if spec is not None else None
    folders = [Path(place, *inner) for place in places or ()]
    return next((folder for folder in folders if folder.is_dir()), None)


def _uninstall(entry: EntryPoint) -> str:
    return f"`pip uninstall {owner(entry).split()[0]}` removes it"


def domain_files(config_dir: str | Path | None = None) -> dict[str, Path]:
    """The configuration files of domains, by name.

    `config_dir` is the user's folder of configuration; of two files with the same name, the result
    has the one that Hydra uses.
    """
    folders = [*([Path(config_dir)] if config_dir else []), *conf_folders(), resource("conf")]
    return {file.stem: file for folder in folders for file in folder.glob("domain/*.yaml")}


def domain_class(domain: str, config_dir: str | Path | None = None) -> Any:
    """The class of a domain, without composing a configuration. Raises KeyError for no domain."""
    import yaml

    config = yaml.safe_load(domain_files(config_dir)[domain].read_text(encoding="utf-8"))
    module, _, attribute = str(config.get("domain", config)["factory"]).partition(":")
    return getattr(import_module(module), attribute)
