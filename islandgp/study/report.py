"""What a comparison has to say, in the order of the page."""

from __future__ import annotations

from dataclasses import dataclass

from islandgp.study.figures.drawing import Picture
from islandgp.study.findings import Finding
from islandgp.study.generalise import Generalisation
from islandgp.study.table import Table

Item = Table | Picture | str  # a string is a paragraph


@dataclass(frozen=True, slots=True)
class Section:
    """A heading with what stands below it."""

    title: str
    items: tuple[Item, ...]


@dataclass(frozen=True, slots=True)
class Report:
    """Everything that a comparison has to say."""

    title: str
    doubts: tuple[str, ...]
    sections: tuple[Section, ...]
    findings: tuple[Finding, ...]  # family by family
    unseen: tuple[Generalisation, ...] = ()  # champions and yardsticks in unseen worlds

    @property
    def tables(self) -> list[Table]:
        """In the order of the page."""
        return [i for s in self.sections for i in s.items if isinstance(i, Table)]

    @property
    def pictures(self) -> list[Picture]:
        """In the order of the page."""
        return [i for s in self.sections for i in s.items if isinstance(i, Picture)]
