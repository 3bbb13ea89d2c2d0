"""The lineage of the best robot on a run's page: the chain of its ancestors, from the records.

The chain follows the first parent of each individual, whose tree was changed, to an individual
without parents. Consecutive individuals with the same tree are one step.
"""

from __future__ import annotations

from array import array
from collections.abc import Mapping
from dataclasses import dataclass
from functools import lru_cache
from itertools import accumulate
from statistics import fmean
from typing import Any, Final

from islandgp.bt.core.language import parse
from islandgp.bt.core.node import Node, size
from islandgp.bt.export.render import label
from islandgp.gate import opened
from islandgp.records.files import generation_lines
from islandgp.records.folder import RunFolder

MAX_INDIVIDUALS: Final = 5_000  # most individuals of a chain that are read
MAX_NODES: Final = 300  # most nodes of trees that are compared
MAX_CHANGES: Final = 40  # most changed nodes of a step that are listed


@dataclass(frozen=True, slots=True)
class LineageStep:
    """A tree in the chain."""

    first: Mapping[str, Any]  # record of the first individual with this tree
    last: str  # id of the last one
    fitness: float  # points, mean over the individuals with this tree
    evaluated: int  # number of individuals with this tree
    changes: tuple[str, ...] | None
    """Lines with a mark (-, + or ~) for nodes that differ from the first parent's tree, MAX_CHANGES
    at most; None: the trees are too large."""
    left_out: int  # number of changes that are not listed
    guidance: Mapping[str, Any] | None  # with the tree, if a supervisor injected or edited it


@dataclass(frozen=True, slots=True)
class Lineage:
    """A chain of ancestors, oldest first."""

    steps: tuple[LineageStep, ...]
    is_complete: bool  # True: it begins with an individual without parents


def lineage(folder: RunFolder, name: str) -> Lineage:
    """The ancestors of the individual with this id, including itself.

    Raises RunError if a record is damaged.
    """
    reader = _Reader(folder)
    steps: list[LineageStep] = []
    same: list[dict[str, Any]] = []  # individuals with one tree, the newest first
    ancestor = reader.individual(name)
    for _ in range(MAX_INDIVIDUALS):
        if ancestor is None:
            break
        same.append(ancestor)
        parent = reader.parent(ancestor)
        if parent is None or parent["tree"] != ancestor["tree"]:
            steps.append(_step(reader, same, parent))
            same = []
        ancestor = parent
    if same:  # the chain is longer than MAX_INDIVIDUALS
        steps.append(_step(reader, same, None))
    is_complete = bool(steps) and not steps[-1].first["parents"]
    return Lineage(tuple(reversed(steps)), is_complete)


def _step(
    reader: _Reader, same: list[dict[str, Any]], parent: dict[str, Any] | None
) -> LineageStep:
    """The step of the individuals `same`, the newest first, whose first parent is `parent`."""
    first, generation = same[-1], _generation(same[-1]["id"])
    changes = () if parent is None else tree_changes(parent["tree"], first["tree"])
    guidance = None
    if first["origin"] in ("injected", "edited") and generation:
        guidance = (reader.record(generation - 1) or {}).get("guidance")
    return LineageStep(
        first=first,
        last=same[0]["id"],
        fitness=fmean(i["fitness"] for i in same),
        evaluated=len(same),
        changes=None if changes is None else changes[:MAX_CHANGES],
        left_out=max(0, len(changes or ()) - MAX_CHANGES),
        guidance=guidance,
    )


@lru_cache(maxsize=8)  # an ancestor is compared with its parent, and its child with it
def _tree(text: str) -> Node:
    return parse(text)


def tree_changes(old: str, new: str) -> tuple[str, ...] | None:
    """A line for each node that differs between two trees; None if one has over MAX_NODES."""
    from islandgp.bt.analysis.compare import Mark, compare  # only for a tree with a parent

    if max(size(_tree(old)), size(_tree(new))) > MAX_NODES:
        return None
    arrow = " \N{RIGHTWARDS ARROW} "
    return tuple(
        f"{line.mark} {'  ' * line.level}"
        + arrow.join(dict.fromkeys(label(n) for n in (line.old, line.new) if n is not None))
        for line in compare(_tree(old), _tree(new))
        if line.mark is not Mark.SAME
    )


class _Reader:
    """Reads single generations of a long file."""

    def __init__(self, folder: RunFolder) -> None:
        self._lines = generation_lines(folder.path)
        self._offsets = array("Q", accumulate(map(len, self._lines.whole()), initial=0))
        """Of each generation's record, and of the end of the last one."""
        self.record = lru_cache(maxsize=4)(self._record)

    def _record(self, generation: int) -> dict[str, Any] | None:
        """A generation's record; None if there is none."""
        if not 0 <= generation < len(self._offsets) - 1:
            return None
        with opened(self._lines.path) as file:
            file.seek(self._offsets[generation])
            return self._lines.value(file.readline(), generation)

    def individual(self, name: str) -> dict[str, Any] | None:
        """The individual with this id; None if the records have none."""
        generation = name.partition(".")[0]
        record = self.record(int(generation)) if generation.isdecimal() else None
        return next((i for i in (record or {}).get("individuals", ()) if i["id"] == name), None)

    def parent(self, child: Mapping[str, Any]) -> dict[str, Any] | None:
        """The first parent of an individual; None if it has none in an earlier generation."""
        for name in child["parents"][:1]:
            ancestor = self.individual(name)
            if ancestor is not None and _generation(ancestor["id"]) < _generation(child["id"]):
                return ancestor
        return None


def _generation(name: str) -> int:
    return int(name.partition(".")[0])
