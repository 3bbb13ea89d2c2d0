"""May this command go on with the run in a folder? `resume=auto|never|force`."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Final

from islandgp.errors import RunError
from islandgp.records.folder import RunFolder
from islandgp.records.parameters import machinery

AGAIN: Final = "~"
"""Before the number of a run that is made anew; no folder that a configuration names holds it."""


def choose(folder: RunFolder, resume: str, config: Mapping[str, Any]) -> RunFolder:
    """The folder to work in: `never` takes a new one beside an old one.

    Raises:
        RunError: the folder holds a run of another configuration, and `resume` is `auto`,
            or `force` while that run is finished; or its files are damaged.
    """
    if not folder.begun():
        return folder
    if resume == "never":
        n = 2
        while (path := folder.path.with_name(f"{folder.path.name}{AGAIN}{n}")).exists():
            n += 1
        return RunFolder(path)
    changed = differences(folder.configuration(), config)
    if changed and (resume != "force" or folder.finished()):
        state = "the finished run" if folder.finished() else "the run"
        raise RunError(
            f"Expected the configuration of {state} in {folder.path}, found it changed:\n  "
            + "\n  ".join(changed)
            + "\nGive this run another name=..., or resume=never for a new folder beside it."
        )
    if folder.finished():
        folder.check_summary()
    return folder


def differences(old: Mapping[str, Any], new: Mapping[str, Any]) -> list[str]:
    """The keys that shape the records and whose values differ, as `key: old -> new`."""
    without = machinery(old, new)
    return _differences(
        {key: value for key, value in old.items() if key not in without},
        {key: value for key, value in new.items() if key not in without},
        "",
    )


def _differences(old: Mapping[str, Any], new: Mapping[str, Any], path: str) -> list[str]:
    found = []
    for key in sorted({*old, *new}, key=str):
        name, a, b = f"{path}{key}", old.get(key), new.get(key)
        if isinstance(a, Mapping) and isinstance(b, Mapping):
            found += _differences(a, b, f"{name}.")
        elif a != b:
            found.append(f"{name}: {a} -> {b}")
    return found
