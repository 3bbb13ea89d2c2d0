"""Data that the sections of a run's page share."""

from __future__ import annotations

import shlex
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

from islandgp.records.folder import RunFolder, Status
from islandgp.redaction import HIDDEN
from islandgp.viewer.history import RunCurves

WORLD_GROUPS: Final = frozenset(
    {"domain", "world", "rewards", "curriculum", "classes", "experiment", "search"}
)
"""Groups of the configuration on which an episode may depend."""


@dataclass(frozen=True, slots=True)
class RunView:
    """A run as read from its folder, for all sections of its page."""

    folder: RunFolder
    status: Status
    config: Mapping[str, Any]
    history: RunCurves
    champion: Mapping[str, Any] | None  # an individual's record
    summary: Mapping[str, Any] | None  # of a finished run


def world_flags(view: RunView) -> str:
    """The command-line options for this run's world."""
    about = view.folder.about()
    try:
        arguments = [] if about is None else shlex.split(about.command)
    except ValueError:  # the quotes of a damaged file
        arguments = []
    flags: list[str] = []
    for k, word in enumerate(arguments):
        group = word.lstrip("+~").partition("=")[0].partition(".")[0].partition("/")[0]
        if word == "--config-dir":
            flags += arguments[k : k + 2]
        elif word.startswith("--config-dir="):
            flags.append(word)
        elif "=" in word and group in WORLD_GROUPS and HIDDEN not in word:
            flags += ["--set", word]
    return shlex.join(flags)


def path_from_home(view: RunView) -> Path:
    """The run's folder, relative to the folder in which the run was started."""
    about, path = view.folder.about(), view.folder.path
    home = Path("/" if about is None else about.home)
    return path.relative_to(home) if path.is_relative_to(home) else path
