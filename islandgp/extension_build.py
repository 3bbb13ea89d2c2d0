"""Compiles the modules of `extension_modules` with mypyc and the machine's C compiler."""

from __future__ import annotations

import os
import shlex
import shutil
import subprocess
import sys
import sysconfig
from importlib.util import find_spec
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Final

from islandgp import extension_modules
from islandgp.errors import IslandError

TIMEOUT_S: Final = 900
# Without `-ffp-contract=off`, some processors round a product and a sum at once.
FLAGS: Final = "-O2 -g0 -ffp-contract=off"
# mypy would take settings, even plugins, from a file in any folder above the temporary one. Types
# of installed packages are not read, which takes an eighth of the time.
SCRIPT: Final = """
import sys
from mypyc.build import mypycify
from setuptools import Distribution

extensions = mypycify(
    ["--config-file=", "--follow-imports=silent", "--ignore-missing-imports",
     "--no-site-packages", *sys.argv[1:]],
    opt_level="2", group_name="islandgp", target_dir="c",
)
command = Distribution({"name": "islandgp", "ext_modules": extensions}).get_command_obj("build_ext")
command.build_lib, command.build_temp = "lib", "objects"
command.ensure_finalized()
command.run()
"""


def build_extensions() -> str:
    """Compiles the modules into the first folder that can be written.

    Returns:
        The folder.

    Raises:
        IslandError: mypy, a C compiler or Python's headers are missing, compiling failed, or no
            folder can be written.
    """
    _require_tools()
    try:
        with TemporaryDirectory(prefix="islandgp-") as build:
            library = _compiled(build)
            # The copy's sources, as those of the package may have changed in the meantime.
            return _moved(library, extension_modules.folder_name(str(Path(build, "islandgp"))))
    except OSError as error:
        reason = error.args[0][0][2] if isinstance(error, shutil.Error) else error
        raise IslandError(
            f"Expected a temporary folder with room to compile, found: {reason}; make room, or"
            " name another folder in TMPDIR."
        ) from error


def _compiled(build: str) -> Path:
    """Compiles the modules in a folder; returns the folder of the results in it."""
    library = Path(build, "lib")
    shutil.copytree(
        extension_modules.PACKAGE,
        Path(build, "islandgp"),
        ignore=shutil.ignore_patterns("__pycache__"),
    )
    files = [f"islandgp/{file}" for file in extension_modules.module_files()]
    _run([sys.executable, "-P", "-c", SCRIPT, *files], build)
    _check(build)
    checksum = extension_modules.checksum(str(library))
    Path(library, extension_modules.CHECKSUM).write_bytes(checksum)
    return library


def _require_tools() -> None:
    """Raises IslandError that names what is missing."""
    if find_spec("mypyc") is None or find_spec("setuptools") is None:
        raise IslandError("Expected mypy, found none: pip install 'islandgp[fast]'.")
    compiler = _compiler()
    if sys.platform != "win32" and shutil.which(compiler) is None:
        raise IslandError(
            f"Expected the C compiler {compiler}, found none: install it, for example with"
            " apt install gcc. islandgp runs without it, but more slowly."
        )
    header = Path(sysconfig.get_path("include"), "Python.h")
    if not header.is_file():
        raise IslandError(
            f"Expected Python's headers, found no {header}: install them, for example with"
            " apt install python3-dev. islandgp runs without them, but more slowly."
        )


def _compiler() -> str:
    """The C compiler, the first word of CC."""
    words = os.environ.get("CC") or sysconfig.get_config_var("CC") or "cc"
    try:
        return shlex.split(words)[0]
    except (IndexError, ValueError):  # blanks, or a quote that is not closed
        return repr(words)


def _run(command: list[str], folder: str) -> None:
    """Runs the compiler; raises IslandError with the last line that it wrote."""
    environment = {name: os.environ[name] for name in os.environ if not name.startswith("MYPY")}
    environment |= {"ISLANDGP_EXTENSIONS": "0", "CFLAGS": FLAGS}
    try:
        done = subprocess.run(
            command,
            cwd=folder,
            env=environment,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            timeout=TIMEOUT_S,
            text=True,
            errors="replace",
            check=False,
        )
    except subprocess.TimeoutExpired as error:
        raise IslandError(f"Expected to compile in {TIMEOUT_S} s, found no end.") from error
    if done.returncode:
        lines = done.stdout.splitlines()
        reason = next((line for line in lines if "error: " in line), (lines or ["no output"])[-1])
        raise IslandError(f"Expected mypyc to compile islandgp, found: {reason.strip():.300}")


def _check(build: str) -> None:
    """Raises IslandError if Python cannot import the compiled modules."""
    finder = "from islandgp.extension_modules import ExtensionFinder as Finder; import sys"
    names = [f"islandgp.{file[:-3].replace('/', '.')}" for file in extension_modules.module_files()]
    imports = "; ".join(f"import {name}" for name in names)
    start = "sys.meta_path.insert(0, Finder('lib'))"
    _run([sys.executable, "-c", f"{finder}; {start}; {imports}"], build)


def _moved(library: Path, name: str) -> str:
    """Moves the compiled modules to a folder `name`, and removes those of earlier sources."""
    for parent in map(Path, extension_modules.parent_folders()):
        temporary = parent / f".{name}.{os.getpid()}.tmp"
        try:
            parent.mkdir(mode=0o700, parents=True, exist_ok=True)
            shutil.copytree(library, temporary)
            for old in parent.glob(f"{extension_modules.PREFIX}*{extension_modules.SUFFIX}"):
                shutil.rmtree(old, ignore_errors=True)
            temporary.rename(parent / name)
        except OSError:
            shutil.rmtree(temporary, ignore_errors=True)
            if not extension_modules.is_complete(str(parent / name)):  # by another process
                continue
        return str(parent / name)
    raise IslandError(
        "Expected a folder for compiled modules, found none that can be written; name one in"
        " XDG_CACHE_HOME."
    )
