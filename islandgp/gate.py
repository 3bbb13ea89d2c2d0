"""The gate: how the files of a run, a sweep or an archive are read, whoever wrote them.

They are data. No command imports code that only they name, connects to an address that only they
name, follows a link in their folder or reads a pipe there, and their texts hold no control
characters on a terminal. Code comes from this package, from installed distributions and from the
user's configuration folder; servers come from the user's command, configuration and environment.
"""

from __future__ import annotations

import os
import re
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from io import BufferedReader
from pathlib import Path
from stat import S_ISREG
from typing import Any, Final

from islandgp.errors import UntrustedError
from islandgp.installed import conf_folders
from islandgp.resources import resource

MAX_BYTES: Final = 2**28
"""Largest file, or line of a file; an archive of 10,000 trees with 1,000 nodes is smaller."""

CODE: Final = re.compile(r"\s*[^\W\d][\w.]*:(?!//)\S+\s*")
"""A class, a function or an environment as "module:name"."""

CONTROL: Final = re.compile(r"[\x00-\x08\x0b-\x1f\x7f-\x9f\u202a-\u202e\u2066-\u2069\ud800-\udfff]")
"""Characters that move a terminal's cursor, start an escape sequence, reorder the line, or that it
cannot show (of a file's name that is not UTF-8)."""

_user_folder: Path | None = None  # of the command's --config-dir


def set_user_folder(folder: Path | None) -> None:
    """Sets the user's folder of configuration for this process; runs may use code it names."""
    global _user_folder
    _user_folder = folder


def configuration_folder() -> Path | None:
    """The user's folder of configuration; None without one."""
    return _user_folder


@contextmanager
def user_folder(folder: Path | None) -> Iterator[None]:
    """A context with the user's folder of configuration, unless it is None."""
    before = _user_folder
    set_user_folder(folder or before)
    try:
        yield
    finally:
        set_user_folder(before)


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


def must_be_known_code(config: Any) -> None:
    """Raises UntrustedError if a run's configuration names code that the user's does not name."""
    for name in code_in(config):
        if not (name.startswith("islandgp.") or name in _code_below(_user_folder)):
            raise UntrustedError(
                f"Expected code that your own configuration names, found {name!r}, which only the"
                " run names; give --config-dir FOLDER with a file that names it, such as"
                " domain/NAME.yaml."
            )


def _code_below(user_folder: Path | None) -> frozenset[str]:
    """The code that installed distributions and the user's folder of configuration name."""
    names = frozenset[str]().union(*map(_code_in_files, conf_folders()))
    return names if user_folder is None else names | frozenset(_code_in_files(user_folder))


def _code_in_files(folder: Path) -> frozenset[str]:
    """The code named in the groups of a folder of configuration.

    Files that are not YAML are skipped; they are reported when the configuration is composed.
    """
    import yaml

    names: set[str] = set()
    for group in sorted(path.name for path in resource("conf").iterdir() if path.is_dir()):
        for file in sorted((folder / group).rglob("*.yaml")):
            with suppress(OSError, ValueError, yaml.YAMLError):
                names.update(code_in(yaml.safe_load(file.read_text(encoding="utf-8"))))
    return frozenset(names)


def cleaned(text: str) -> str:
    """The text with `?` for each control character but line breaks and tabs."""
    return CONTROL.sub("?", text)


def cleaned_values(value: Any) -> Any:
    """Plain values with all their texts and keys cleaned."""
    if isinstance(value, Mapping):
        return {cleaned_values(key): cleaned_values(each) for key, each in value.items()}
    if isinstance(value, list | tuple):
        return [*map(cleaned_values, value)]
    return cleaned(value) if isinstance(value, str) else value


def check_folder(folder: Path) -> None:
    """Raises UntrustedError for a link, a pipe, a device or a folder in a file's place."""
    try:
        entries = sorted(folder.iterdir())
    except OSError:  # there is no such folder, which is reported where it is read
        return
    for file in entries:
        check_file(file)


def check_file(file: Path) -> None:
    """Raises UntrustedError if there is a link, or anything but a file where a file belongs."""
    kind = "a link" if file.is_symlink() else "none" if file.exists() else ""
    is_plain = file.is_file() or (file.is_dir() and "." not in file.name)
    if kind == "a link" or (kind and not is_plain):
        raise UntrustedError(
            f"Expected a file of the run in {file}, found {kind}; put the file itself there, or"
            " delete it."
        )


@contextmanager
def opened(file: Path) -> Iterator[BufferedReader]:
    """A context with a file of a run's or a sweep's folder, open for reading.

    Raises:
        UntrustedError: it is a link, a pipe, a device or a folder.
        OSError: it cannot be read.
    """
    check_file(file)
    # A pipe in its place would block, and a link could have been put there since the check.
    flags = os.O_RDONLY | getattr(os, "O_NOFOLLOW", 0) | getattr(os, "O_NONBLOCK", 0)
    with os.fdopen(os.open(file, flags), "rb") as stream:
        if not S_ISREG(os.fstat(stream.fileno()).st_mode):
            raise UntrustedError(f"Expected a file in {file}, found none; delete it.")
        yield stream


def read_bytes(file: Path) -> bytes:
    """The content of such a file. Raises as `opened`, and for more than MAX_BYTES."""
    with opened(file) as stream:
        data = stream.read(MAX_BYTES + 1)
    check_length(file, data)
    return data


def check_length(file: Path, data: bytes) -> None:
    """Raises UntrustedError if a file, or a line of it, has more than MAX_BYTES."""
    if len(data) > MAX_BYTES:
        raise UntrustedError(
            f"Expected at most {MAX_BYTES:,} bytes in {file}, found more; delete it."
        )


def read_text(file: Path) -> str:
    """The content of a file as text, cleaned; bytes that are not UTF-8 are replaced. As above."""
    return cleaned(read_bytes(file).decode("utf-8", "replace"))


def is_inside(name: str) -> bool:
    """True if a name is that of an entry of a folder, not a path out of it."""
    return bool(name) and name not in (".", "..") and not re.search(r"[/\\\x00]", name)
