"""The small files of a run's folder: what they hold, and what to say of damaged ones."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import yaml

from islandgp.errors import RunError, brief
from islandgp.records.checkpoint import usable

SUMMARY: Final = frozenset({"champion", "first", "mean_diversity", "generations", "seconds"})
"""What summary.json holds for those who read it."""


@dataclass(frozen=True, slots=True)
class RunMetadata:
    """Identity and provenance of a run."""

    id: str  # unique; the same after each resumption
    title: str  # what people call the run
    home: str  # absolute path of the folder in which the command was given
    command: str  # that does the run, or what is missing of it
    started: int  # ms since 1970
    identity: str  # hash of all configuration that shapes the records
    tags: dict[str, str]
    domain_code: str = ""  # digest of the domain's source; "" for the package's own domains


def read_about(file: Path) -> RunMetadata | None:
    """What was written down at the start; None if there was no start.

    Raises:
        RunError: the file is damaged, or of another version.
    """
    try:
        return (
            RunMetadata(**json.loads(file.read_text(encoding="utf-8"))) if file.exists() else None
        )
    except (ValueError, TypeError) as error:
        raise damaged("what a run says of itself", file, brief(error)) from error


def read_configuration(file: Path) -> dict[str, Any]:
    """A configuration as plain values; {} if there is none. Raises RunError where it is damaged."""
    what = "a run's configuration"
    try:
        with usable(file.parent):
            found = yaml.safe_load(file.read_text(encoding="utf-8")) if file.exists() else {}
    except (yaml.YAMLError, UnicodeDecodeError) as error:
        raise damaged(what, file, brief(error)) from error
    if not isinstance(found, dict):
        raise damaged(what, file, "there are no keys in it")
    return found


def score(summary: Mapping[str, Any]) -> float:
    """What a finished run is worth: its best robot's mean fitness in validation worlds, points.

    Without validation it is the robot's fitness in training.
    """
    champion = summary["champion"]
    validation = champion["validation"]
    return float(champion["record"]["fitness"] if validation is None else validation["mean"])


VALUES: Final = (
    "best",
    "trained",
    "generations",
    "final_best",
    "final_mean",
    "mean_diversity",
    "seconds",
)
"""What `values` tells of every run."""


def values(summary: Mapping[str, Any]) -> dict[str, Any]:
    """The numbers of a finished run, by the names that `islandgp.load` has for them.

    `first.<milestone>` is the generation of the first such robot, None if there was none.
    """
    found = {"best": score(summary), "trained": summary["champion"]["record"]["fitness"]}
    return {
        **{name: found[name] if name in found else summary[name] for name in VALUES},
        **{f"first.{tier}": generation for tier, generation in summary["first"].items()},
    }


def objectives(summary: Mapping[str, Any], names: Sequence[str]) -> tuple[float, ...]:
    """The values that a search compares runs by; a robot that never came came after the end."""
    found = values(summary)
    return tuple(float(summary["generations"] if found[n] is None else found[n]) for n in names)


def read_summary(file: Path) -> dict[str, Any]:
    """The end of a finished run."""
    found: dict[str, Any] = json.loads(file.read_text(encoding="utf-8"))
    return found


def check_summary(file: Path) -> None:
    """Raises RunError where the end of a finished run cannot be told."""
    what = "a finished run's summary"
    try:
        missing = SUMMARY - set(read_summary(file))
    except (ValueError, TypeError) as error:
        raise damaged(what, file, brief(error)) from error
    if missing:
        raise damaged(what, file, f"it lacks {', '.join(sorted(missing))}")


def damaged(what: str, file: Path, why: str) -> RunError:
    """The error for a file that was expected to hold `what`."""
    return RunError(
        f"Expected {what} in {file}, found a damaged file ({why});"
        " delete the run's folder or use resume=never."
    )


def pretty(value: dict[str, Any]) -> bytes:
    """JSON for people."""
    return (json.dumps(value, indent=1) + "\n").encode()
