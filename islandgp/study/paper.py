"""Published figures, for comparison with those of a report.

They are read from `paper.yaml` next to the domain's module. Figures of another simulator or of few
runs can be compared in direction, but not in magnitude.
"""

from __future__ import annotations

from collections.abc import Mapping
from functools import cache
from inspect import getfile
from pathlib import Path
from typing import Any, Final, Literal, TypeVar

import yaml
from pydantic import BaseModel, Field

from islandgp.errors import StudyError
from islandgp.resources import resource
from islandgp.scoring.classes import Classes
from islandgp.study.library import domain_of

M = TypeVar("M", bound=BaseModel)

FILE: Final = "paper.yaml"

MARK: Final = "paper*"
"""Prefix of the heading of a column with published figures."""


class Tested(BaseModel, frozen=True, extra="forbid"):
    """A row of Table 9 or 10."""

    proposed: tuple[float, float]  # mean and SD
    baseline: tuple[float, float]
    p: float
    p_bh: float  # after Benjamini and Hochberg
    r: float


class Emergence(BaseModel, frozen=True, extra="forbid"):
    """A row of Table 11: the generation of the first one, run by run."""

    proposed: tuple[int, ...]
    baseline: tuple[int, ...]
    earlier: float  # relative reduction
    p_bh: float | None = None


class Diversity(BaseModel, frozen=True, extra="forbid"):
    """A row of Table 12."""

    proposed: float
    baseline: float
    difference: float  # as a share


class Count(BaseModel, frozen=True, extra="forbid"):
    """A row of Table 13: individuals of a population that show a behaviour."""

    mean: float
    sd: float
    least: int
    most: int


class Claim(BaseModel, frozen=True, extra="forbid"):
    """A claim on the proposed system against the baseline."""

    text: str
    measure: str  # key of a `measures.Measure`
    direction: Literal[-1, 0, 1]  # of the proposed system's values; 0: no difference
    difference: float | None = None  # as a share
    p_bh: float | None = None


class PublishedFigures(BaseModel, frozen=True, extra="forbid"):
    """All figures of one publication."""

    classes: str  # file of the classes to which they refer, next to this one or in conf
    note: str  # the source
    fitness: dict[str, Tested] = Field(default_factory=dict)  # by measure, as the next three
    emergence: dict[str, Emergence] = Field(default_factory=dict)  # by milestone
    diversity: dict[str, Diversity] = Field(default_factory=dict)
    specialists: dict[str, Count] = Field(default_factory=dict)  # by behaviour
    overhead: dict[str, str] = Field(default_factory=dict)
    decisions: dict[str, float] = Field(default_factory=dict)  # by label: share of all decisions
    decisions_note: str = ""
    crises: dict[str, int] = Field(default_factory=dict)  # by reason, over all runs
    trees: dict[str, str] = Field(default_factory=dict)  # "early" and "late": what is drawn there
    drawn_after: dict[str, str] = Field(default_factory=dict)  # figure by tree of the library
    claims: tuple[Claim, ...] = ()

    @property
    def footnote(self) -> str:
        """The footnote of a table with a column of these figures."""
        return f"* {self.note}"


def paper_of(config: Mapping[str, Any]) -> PublishedFigures | None:
    """Figures of a run's domain and classes, if there are any. Raises StudyError if damaged."""
    domain = domain_of(config)
    if domain is None:
        return None
    folder = Path(getfile(type(domain))).parent
    paper = read_paper(folder / FILE)
    if paper is None or Classes(**config["classes"]) != _classes(folder, paper.classes):
        return None
    return paper


@cache
def read_paper(file: Path) -> PublishedFigures | None:
    """The figures in a file; None if it does not exist. Raises StudyError if it is damaged."""
    if not file.exists():
        return None
    return _read(PublishedFigures, file, "a publication's figures")


@cache
def _classes(folder: Path, name: str) -> Classes:
    file = folder / name
    return _read(Classes, file if file.exists() else resource("conf") / name, "classes")


def _read(model: type[M], file: Path, description: str) -> M:
    try:
        return model.model_validate(yaml.safe_load(file.read_text(encoding="utf-8")))
    except (OSError, yaml.YAMLError, ValueError) as error:
        raise StudyError(f"Expected {description} in {file}, found {error}") from error
