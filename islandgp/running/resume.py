"""The identity of a run, and the check whether a command can continue the run in a folder."""

from __future__ import annotations

import json
import subprocess
import sys
from collections.abc import Mapping
from contextlib import suppress
from functools import cache
from hashlib import sha256
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from time import time
from typing import Any, Final
from uuid import uuid4

from islandgp.config.settings import Settings
from islandgp.errors import IslandError, RunError
from islandgp.plain import flatten
from islandgp.plugin import path_of
from islandgp.records.files import RunMetadata
from islandgp.records.folder import RunFolder
from islandgp.records.parameters import identity_config, runtime_keys

REPEAT_MARK: Final = "~"
"""Precedes the number in the folder name of a repeated run; no other name contains it."""


def choose(folder: RunFolder, settings: Settings, config: Mapping[str, Any]) -> RunFolder:
    """The folder of the run: for `resume=never` a new one beside an existing one.

    Raises:
        RunError: the folder holds a run of another configuration or of other code of the
            domain, or its files are damaged.
    """
    if not folder.begun():
        return folder
    if settings.resume == "never":
        n = 2
        while (path := folder.path.with_name(f"{folder.path.name}{REPEAT_MARK}{n}")).exists():
            n += 1
        return RunFolder(path)
    changed = differences(folder.configuration(), config)
    about = folder.about()
    if about is not None and about.domain_code not in ("", domain_code(settings)):
        changed.append(f"domain.factory: the code of {path_of(settings.domain.factory)}")
    start = _start_digest(settings, finished=folder.finished())
    if about is not None and start not in (about.start, ""):
        changed.append(f"start: the content of {settings.start}")
    if changed:
        state = "the finished run" if folder.finished() else "the run"
        raise RunError(
            f"Expected the configuration of {state} in {folder.path}, found it changed:\n  "
            + "\n  ".join(changed)
            + "\nGive this run another name=..., or resume=never for a new folder beside it."
        )
    if folder.finished():
        folder.summary()
    return folder


def _start_digest(settings: Settings, *, finished: bool = False) -> str:
    """The digest of the content of `start`; "" without one. Raises as `start.start_digest`.

    A finished run does not need it: "" if it cannot be read.
    """
    if settings.start is None:
        return ""
    from islandgp.running.parts import start_digest  # only with `start`

    with suppress(*[IslandError] * finished):
        return start_digest(settings.start)
    return ""


def differences(old: Mapping[str, Any], new: Mapping[str, Any]) -> list[str]:
    """The differing keys that determine the records, as `key: old -> new`."""
    without = runtime_keys(old, new)
    before, after = (
        flatten({key: value for key, value in config.items() if key not in without})
        for config in (old, new)
    )
    for values in (before, after):  # drop an empty part if the other one has keys
        for key in [key for key, value in values.items() if value == {}]:
            del values[key]
    return [
        f"{key}: {before.get(key)} -> {after.get(key)}"
        for key in sorted({*before, *after})
        if before.get(key) != after.get(key)
    ]


def about_run(
    settings: Settings, config: Mapping[str, Any], target: RunFolder, home: Path, command: str
) -> RunMetadata:
    """The metadata of a run; a resumed run keeps its id and start."""
    before = target.about()
    shaping, start = identity_config(config), _start_digest(settings)
    if start:
        shaping["start"] = start  # in place of its path
    without_seed = {key: value for key, value in shaping.items() if key not in {"seed", "name"}}
    return RunMetadata(
        id=before.id if before else uuid4().hex,
        title=target.path.name,
        home=str(home),
        command=command,
        started=before.started if before else int(1000 * time()),
        tags={
            "domain": settings.make_domain().schema.vocabulary.domain,
            "supervisor": settings.supervisor.name,
            "arm": settings.supervisor.name,  # outside of sweeps
            "seed": str(settings.seed),
            "sweep": settings.name,
            "code": _code_version(),
            # The same for all seeds.
            "config": sha256(json.dumps(without_seed, sort_keys=True).encode()).hexdigest()[:12],
        },
        domain_code=domain_code(settings),
        start=start,
    )


def domain_code(settings: Settings) -> str:
    """A digest of the domain's source: its module, or all modules of its package.

    "" for the domains of islandgp, which have the tag `code`, and for a domain without a file.
    """
    module = sys.modules[settings.domain.factory.__module__]
    if module.__name__.startswith("islandgp.") or not getattr(module, "__file__", None):
        return ""
    file = Path(str(module.__file__))
    files = sorted(file.parent.glob("*.py")) if module.__package__ else [file]
    return sha256(b"".join(path.read_bytes() for path in files)).hexdigest()[:12]


@cache
def _code_version() -> str:
    """The package's version and, in a checkout, its commit: `0.1.0+6ba196d8d3f1-dirty`."""
    try:
        release = version("islandgp")
    except PackageNotFoundError:  # run from a checkout that is not installed
        release = "0"
    commit = _commit(Path(__file__).resolve().parents[2])
    return f"{release}+{commit}" if commit else release


def _commit(checkout: Path) -> str:
    """The commit of a checkout, with -dirty if a tracked file is changed; "" if unknown.

    Nothing is written: `git describe --dirty` and `git diff` would write the index.
    """
    if not (checkout / ".git").exists():
        return ""
    words = ["git", "--no-optional-locks", "status", "--porcelain=v2", "--branch", "-uno"]
    try:
        lines = subprocess.check_output(words, cwd=checkout, text=True, timeout=5).splitlines()
    except (OSError, subprocess.SubprocessError):
        return ""
    commit = next((line[13:25] for line in lines if line.startswith("# branch.oid ")), "")
    if not commit.isalnum():  # there is no commit yet
        return ""
    return commit if lines[-1].startswith("#") else f"{commit}-dirty"
