"""Modules that mypyc has compiled, which Python imports in place of their sources.

`extension_modules.txt` lists them. `islandgp compile` compiles them into a folder whose name has a
digest of the sources, so changed sources are run by Python until they are compiled again. Outcomes
are equal to the last bit. With `ISLANDGP_EXTENSIONS=0` in the environment, Python runs the sources.

The package imports this module first, so it imports nothing that takes time.
"""

from __future__ import annotations

import os
import sys
from _imp import extension_suffixes, source_hash
from importlib.machinery import ExtensionFileLoader, ModuleSpec

TYPE_CHECKING = False  # not from typing: its import takes time
if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence
    from types import ModuleType

PACKAGE = os.path.dirname(__file__)
LIBRARY = "islandgp__mypyc"  # the extension module with the code of all of them
SUFFIX = extension_suffixes()[0]  # of this version of Python on this platform
PREFIX = "extensions-"  # of the name of a folder with compiled modules
CHECKSUM = "checksum"  # the file in it with the checksum of the others


def module_files() -> list[str]:
    """The sources of the compiled modules, relative to the package."""
    with open(os.path.join(PACKAGE, "extension_modules.txt"), encoding="utf-8") as file:
        return file.read().split()


def folder_name(package: str = PACKAGE) -> str:
    """The name of the folder for the sources in `package`, this version of Python and platform.

    Its digest covers all sources beside the compiled ones, whose constants are compiled in.
    """
    content = []
    for folder in sorted({os.path.dirname(file) for file in module_files()}):
        for name in sorted(os.listdir(os.path.join(package, folder))):
            if name.endswith(".py"):
                with open(os.path.join(package, folder, name), "rb") as file:
                    content += [name.encode(), file.read()]
    return f"{PREFIX}{source_hash(0, b''.join(content)).hex()}{SUFFIX}"


def parent_folders() -> Iterator[str]:
    """Where that folder can be: in the package, or in the user's cache."""
    yield os.path.join(PACKAGE, "__pycache__")
    if folder := user_cache():
        yield folder


def user_cache() -> str | None:
    """The user's folder for files that hold code, which perhaps does not exist yet, or None.

    A relative one, as without a home, one of another user and one that anybody may write are not
    trusted.
    """
    cache = os.environ.get("XDG_CACHE_HOME") or os.path.expanduser("~/.cache")
    folder = os.path.join(cache, "islandgp")
    try:
        status = os.stat(folder)
    except FileNotFoundError:
        is_own = True
    except OSError:
        is_own = False
    else:
        is_own = os.name != "posix" or (status.st_uid == os.geteuid() and not status.st_mode & 0o2)
    return folder if is_own and os.path.isabs(cache) else None


def compiled_folder() -> str | None:
    """The folder with the compiled modules of the present sources, or None."""
    for parent in parent_folders():
        try:
            names = [name for name in os.listdir(parent) if name.startswith(PREFIX)]
        except OSError:
            continue
        if names and (name := folder_name()) in names:
            folder = os.path.join(parent, name)
            if is_complete(folder):
                return folder
    return None


def compiled_files(folder: str) -> dict[str, str]:
    """The files of the compiled modules in a folder, by the name of the module."""
    modules = sorted({f"islandgp/{file[:-3]}" for file in module_files()} | {LIBRARY})
    return {name.replace("/", "."): os.path.join(folder, name) + SUFFIX for name in modules}


def checksum(folder: str) -> bytes:
    """The checksum of the compiled modules in a folder. Raises OSError if one is missing."""
    content = []
    for file in compiled_files(folder).values():
        with open(file, "rb") as opened:
            content.append(opened.read())
    return source_hash(0, b"".join(content))


def is_complete(folder: str) -> bool:
    """True if the files are those that were compiled; a part of a file would end the process."""
    try:
        with open(os.path.join(folder, CHECKSUM), "rb") as file:
            return file.read() == checksum(folder)
    except OSError:
        return False


class ExtensionFinder:
    """Finds compiled modules for `import`; it looks for their folder at the first one."""

    def __init__(self, folder: str | None = None) -> None:
        """`folder`: of the compiled modules; None: that of the present sources, if any."""
        self._names = compiled_files("")
        self._files = None if folder is None else compiled_files(folder)

    def find_spec(
        self,
        fullname: str,
        _path: Sequence[str] | None = None,
        _target: ModuleType | None = None,
    ) -> ModuleSpec | None:
        """The specification of a compiled module, or None for any other."""
        if fullname not in self._names:
            return None
        if self._files is None:
            self._look_for_files()
        file = (self._files or {}).get(fullname)
        if file is None:
            return None
        spec = ModuleSpec(fullname, ExtensionFileLoader(fullname, file), origin=file)
        spec.has_location = True
        return spec

    def _look_for_files(self) -> None:
        """Sets `_files`; {} if there are none that this machine can import."""
        folder = compiled_folder()
        self._files = compiled_files(folder) if folder else {}
        try:
            __import__(LIBRARY)
        except ImportError:  # it was compiled on a machine with another C library
            self._files = {}


def is_enabled() -> bool:
    """False if the environment asks for Python."""
    return os.environ.get("ISLANDGP_EXTENSIONS") != "0"


def use_extensions() -> None:
    """Makes `import` find the compiled modules, if those of the present sources exist."""
    if is_enabled():
        sys.meta_path.insert(0, ExtensionFinder())
