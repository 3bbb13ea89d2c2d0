"""The small files of a run's folder: what they hold, and what to say of damaged ones."""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Final

import yaml
from pydantic import Field

from islandgp.errors import brief
from islandgp.evolution.record import IndividualRecord
from islandgp.evolution.validation import Validation
from islandgp.plain import must_fit, read_json
from islandgp.records.checkpoint import reading, usable


@dataclass(frozen=True, slots=True)
class _Best:
    generation: int
    record: IndividualRecord
    validation: Validation | None


@dataclass(frozen=True, slots=True)
class _Summary:
    """What summary.json holds for those who read it."""

    champion: _Best
    first: dict[str, int | None]  # by milestone
    final_best: float
    final_mean: float
    mean_diversity: float
    generations: Annotated[int, Field(ge=1)]
    seconds: float
    records: str | None = None  # the digest of the last record; older versions lack it


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
    if not file.exists():
        return None
    with reading("what a run says of itself", file):
        text = file.read_bytes()
        must_fit(RunMetadata, text)
        return RunMetadata(**read_json(text))


def read_configuration(file: Path) -> dict[str, Any]:
    """A configuration as plain values; {} if there is none. Raises RunError where it is damaged."""
    with reading("a run's configuration", file):
        try:
            with usable(file.parent):
                found = yaml.safe_load(file.read_text(encoding="utf-8")) if file.exists() else {}
        except yaml.YAMLError as error:
            raise ValueError(brief(error)) from error
        if not isinstance(found, dict):
            raise TypeError("there are no keys in it")
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
    """The end of a finished run. Raises RunError where it cannot be told."""
    with reading("a finished run's summary", file):
        text = file.read_bytes()
        must_fit(_Summary, text)
        return dict(read_json(text))


def pretty(value: dict[str, Any]) -> bytes:
    """JSON for people."""
    return (json.dumps(value, indent=1) + "\n").encode()


def answers(records: Iterable[Mapping[str, Any]]) -> dict[str, int]:
    """The guidances that were due, and how many of them came from the fallback, and in part."""
    given = [r["guidance"] for r in records if r["guidance"] is not None]
    sources = Counter(g["source"] for g in given if g["asked_at"] is not None)
    fallback = sum(n for source, n in sources.items() if "fallback" in source)
    return {
        "total": sources.total(),
        "fallback": fallback,
        "in_part": fallback - sources["fallback"],
    }


def fallback_share(found: Mapping[str, int]) -> float:
    """The share of the fallback in what `answers` counts; an answer in part counts half."""
    total = found.get("total", 0)
    return (found["fallback"] - found["in_part"] / 2) / total if total else 0.0


def fallback_words(summaries: Iterable[Mapping[str, Any]]) -> str:
    """The same over some runs in words, "" where no answer was the fallback's."""
    found: Counter[str] = Counter()
    for summary in summaries:
        found.update(summary.get("answers", {}))  # a run of an older version lacks them
    if not found["fallback"]:
        return ""
    part = f", {found['in_part']:,} of them in part" if found["in_part"] else ""
    return f"{found['fallback']:,} of {found['total']:,}{part}"
