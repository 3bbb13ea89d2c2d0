"""Trust in run folders: which code, servers and files of a run's folder this process may use.

A folder may be from an unknown source. Its files must not be links. The classes and
servers that its configuration names are used only if the user's own configuration or command names
them as well.
"""

from __future__ import annotations

import os
import re
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager, suppress
from functools import cache
from itertools import chain
from pathlib import Path
from typing import Any, Final

from islandgp.errors import UntrustedError
from islandgp.installed import conf_folders
from islandgp.resources import resource

EVERYTHING: Final = "*"
"""The name that trusts every name: `--trust`."""

PLAIN: Final = frozenset({"tags", "name", "runs", "start", "resume", "progress"})
"""Top-level keys of a configuration whose values name neither code nor servers."""

CODE: Final = re.compile(r"[A-Za-z_][\w.]*:[A-Za-z_][\w.-]*")
"""A class, a function or an environment as "module:name"."""

_trusted: Final[set[str]] = set()


def trust(names: Iterable[str]) -> None:
    """Allows run folders to use these classes, functions and servers in this process."""
    _trusted.update(names)


@contextmanager
def trusting() -> Iterator[None]:
    """A context; what was trusted inside it is no longer trusted at its end."""
    before = frozenset(_trusted)
    try:
        yield
    finally:
        _trusted.intersection_update(before)


def is_trusted(name: str) -> bool:
    """True for code of this package, and for names that were passed to `trust` or are installed."""
    own = name.startswith("islandgp.") or bool({name, EVERYTHING} & _trusted)
    return own or name in _installed()


def code_in(config: Any, key: str = "") -> Iterator[str]:
    """The code that a configuration names: each `factory`, and all "module:name"."""
    if isinstance(config, Mapping):
        for inner, value in config.items():
            yield from code_in(value, str(inner))
    elif isinstance(config, list | tuple):
        for value in config:
            yield from code_in(value, key)
    elif isinstance(config, str) and (key == "factory" or CODE.fullmatch(config)):
        yield config


def must_trust_code(config: Any) -> None:
    """Raises UntrustedError if a run's configuration names code that is not trusted."""
    if isinstance(config, Mapping):
        config = {key: value for key, value in config.items() if key not in PLAIN}
    for name in code_in(config):
        if not is_trusted(name):
            raise UntrustedError(
                f"Expected code that your own configuration names, found {name!r}, which only the"
                " run names; give --config-dir FOLDER with a file that names it, or --trust."
            )


def must_trust_server(uri: str) -> None:
    """Raises UntrustedError for a server that only a run's folder names.

    It would get the user's name and password, and could choose where files are written.
    The server in MLFLOW_TRACKING_URI is the user's.
    """
    name, configured = server_name(uri), server_name(os.environ.get("MLFLOW_TRACKING_URI", ""))
    if "://" not in name or name.startswith("sqlite:") or name == configured or is_trusted(name):
        return
    raise UntrustedError(
        f"Expected a server that your own configuration or command names, found {name}, which only"
        f" the run names; give --uri {name} if it is yours."
    )


def must_have_no_links(folder: Path) -> None:
    """Raises UntrustedError for a link, a pipe or a device among the files of a run's folder."""
    try:
        entries = sorted(folder.iterdir())
    except OSError:  # there is no such folder, which is reported where it is read
        return
    for file in entries:
        must_be_no_link(file)


def must_be_no_link(file: Path) -> None:
    """Raises UntrustedError if a path is a link, a pipe or a device."""
    link = file.is_symlink()
    if link or (file.exists() and not (file.is_file() or file.is_dir())):
        raise UntrustedError(
            f"Expected a file of the run in {file}, found {'a link' if link else 'none'}; put the"
            " file itself there, or delete it."
        )


def names_in(config: Mapping[str, Any]) -> set[str]:
    """The code that a user's configuration names, and its tracking server."""
    names = set(code_in(config))
    tracking = config.get("tracking", config)
    policy = tracking.get("policy") if isinstance(tracking, Mapping) else None
    uri = policy.get("uri") if isinstance(policy, Mapping) else None
    return names | {server_name(uri)} if isinstance(uri, str) else names


def server_name(uri: str) -> str:
    """An address without a user's name and password, and without a slash at its end."""
    return re.sub(r"(?<=://)[^/\s]*@", "", uri).rstrip("/")


def trust_folder(folder: Path) -> None:
    """Trusts the code and servers named in the groups of a user's configuration folder."""
    trust(_names_below(folder))


@cache
def _installed() -> frozenset[str]:
    """The code and servers that the configuration of installed distributions names."""
    return frozenset(chain(*map(_names_below, conf_folders())))


def _names_below(folder: Path) -> Iterator[str]:
    """The code and servers that the groups of a configuration folder name.

    Files that are not YAML are skipped; they are reported when the configuration is composed.
    """
    import yaml

    for group in sorted(path.name for path in resource("conf").iterdir() if path.is_dir()):
        for file in sorted((folder / group).rglob("*.yaml")):
            with suppress(OSError, ValueError, yaml.YAMLError):
                config = yaml.safe_load(file.read_text(encoding="utf-8"))
                if isinstance(config, Mapping):
                    yield from names_in(config)
