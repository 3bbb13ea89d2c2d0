"""Names derived from a job's overrides: its folder, its arm and its command."""

from __future__ import annotations

import re
import shlex
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Final

from islandgp.records.parameters import (
    RUNTIME_KEYS,
    ending_in_digest,
    is_secret,
    key_of,
    without_credentials,
)
from islandgp.redaction import HIDDEN

NOT_IN_FOLDER: Final = RUNTIME_KEYS | {
    "hydra",
    "name",
    "seed",
    "experiment",
    "supervisor",
    "supervisor.policy.base_url",
}
"""Keys and groups that are not appended to the name of a run's folder."""

MAX_LENGTH: Final = 180  # most characters of a folder's name; file systems allow 255 bytes


def run_folder(config: Mapping[str, Any], overrides: Sequence[str], home: Path) -> Path:
    """The folder of a run: <runs>/<name>/<supervisor>-seed<n>[-<overrides>].

    Characters with a meaning in shells or file systems are replaced by `_`. A changed or shortened
    name ends with a digest of the full one, so different overrides have different names.
    """
    last = {key_of(override): override for override in overrides}  # Hydra takes the last of a key
    choices = [
        override
        for key, override in last.items()
        if key not in NOT_IN_FOLDER
        and (key.startswith("supervisor.") or group_of(key) not in NOT_IN_FOLDER)
        and not is_secret(key)
    ]
    leaf = "-".join([f"{config['supervisor']['name']}-seed{int(config['seed'])}", *sorted(choices)])
    return (home / str(config["runs"]) / str(config["name"]) / _safe(leaf)).resolve()


def _safe(name: str) -> str:
    """The name as a valid folder name; see `run_folder`."""
    safe = re.sub(r"[^A-Za-z0-9._=,+-]+", "_", name)
    if safe == name and len(name) <= MAX_LENGTH:
        return name
    return ending_in_digest(safe, name, MAX_LENGTH)


def is_choice(override: str) -> bool:
    """True if the override is part of an arm's identity."""
    group = group_of(override)
    return not is_secret(key_of(override)) and group not in RUNTIME_KEYS | {"hydra", "name", "seed"}


def command_line(argv: Sequence[str]) -> str:
    """The command for a shell, with secrets hidden."""
    words = [f"{w.partition('=')[0]}={HIDDEN}" if is_secret(key_of(w)) else w for w in argv]
    return shlex.join(["python", "-m", "islandgp", *map(without_credentials, words)])


def group_of(override: str) -> str:
    """The first part of that key."""
    return key_of(override).split(".")[0].split("/")[0]
