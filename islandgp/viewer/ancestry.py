"""The lineage of a tree: the chain of its ancestors, from a run's records.

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
from typing import TYPE_CHECKING, Any, Final

from islandgp.bt.core.language import parse
from islandgp.bt.core.node import Node, size
from islandgp.bt.export.render import label
from islandgp.records.folder import RunFolder
from islandgp.records.lines import generation_lines

if TYPE_CHECKING:
    from islandgp.bt.analysis.compare import Mark

MAX_INDIVIDUALS: Final = 5_000  # most individuals of a chain that are read
MAX_NODES: Final = 300  # most nodes of trees that are compared
MAX_CHANGES: Final = 40  # most changed nodes of a step that are listed


@dataclass(frozen=True, slots=True)
class TreeChange:
    """A node that differs between two trees."""

    mark: Mark
    level: int  # from 0
    text: str


@dataclass(frozen=True, slots=True)
class LineageStep:
    """A tree in the chain."""

    id: str  # of the first individual with this tree
    generation: int  # of the first individual
    until: int  # generation of the last individual with this tree
    origin: str  # a value of population.Origin
    mutation: str  # operator, or ""
    parents: tuple[str, ...]  # ids
    tree: str  # canonical text
    nodes: int
    fitness: float  # points, mean over the individuals with this tree
    evaluated: int  # number of individuals with this tree
    changes: tuple[TreeChange, ...]  # to the first parent's tree, MAX_CHANGES at most
    left_out: int  # number of changes that are not listed; -1: the trees are too large
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
    is_complete = bool(steps) and not steps[-1].parents
    return Lineage(tuple(reversed(steps)), is_complete)


@lru_cache(maxsize=8)  # an ancestor is compared with its parent, and its child with it
def _tree(text: str) -> Node:
    return parse(text)


def tree_changes(old: str, new: str) -> list[TreeChange]:
    """The differences between two trees, given as texts, node by node."""
    from islandgp.bt.analysis.compare import Mark, compare  # only for a tree with a parent

    changes = []
    for line in compare(_tree(old), _tree(new)):
        if line.mark is not Mark.SAME:
            texts = [label(node) for node in (line.old, line.new) if node is not None]
            end = "end of " if line.end else ""
            text = end + " \N{RIGHTWARDS ARROW} ".join(texts)
            changes.append(TreeChange(line.mark, line.level, text))
    return changes


def _step(
    reader: _Reader, same: list[dict[str, Any]], parent: dict[str, Any] | None
) -> LineageStep:
    """The step of the individuals `same`, the newest first, whose first parent is `parent`."""
    first, last = same[-1], same[0]
    generation = _generation(first["id"])
    changes: list[TreeChange] = []
    left_out = 0
    if parent is not None:
        if max(size(_tree(i["tree"])) for i in (parent, first)) > MAX_NODES:
            left_out = -1
        else:
            changes = tree_changes(parent["tree"], first["tree"])
            left_out = max(0, len(changes) - MAX_CHANGES)
    guidance = None
    if first["origin"] in ("injected", "edited") and generation:
        guidance = (reader.record(generation - 1) or {}).get("guidance")
    return LineageStep(
        id=first["id"],
        generation=generation,
        until=_generation(last["id"]),
        origin=first["origin"],
        mutation=first["mutation"],
        parents=tuple(first["parents"]),
        tree=first["tree"],
        nodes=first["nodes"],
        fitness=fmean(i["fitness"] for i in same),
        evaluated=len(same),
        changes=tuple(changes[:MAX_CHANGES]),
        left_out=left_out,
        guidance=guidance,
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
        with self._lines.path.open("rb") as file:
            file.seek(self._offsets[generation])
            return self._lines.value(file.readline(), generation)

    def individual(self, name: str) -> dict[str, Any] | None:
        """The individual with this id; None if the records have none."""
        generation, _, slot = name.partition(".")
        if not (generation.isdecimal() and slot.isdecimal()):
            return None
        if (record := self.record(int(generation))) is None:
            return None
        everyone = record["individuals"]
        likely = everyone[int(slot) : int(slot) + 1]
        return next((i for i in (*likely, *everyone) if i["id"] == name), None)

    def parent(self, child: Mapping[str, Any]) -> dict[str, Any] | None:
        """The first parent of an individual; None if it has none in an earlier generation."""
        for name in child["parents"][:1]:
            ancestor = self.individual(name)
            if ancestor is not None and _generation(ancestor["id"]) < _generation(child["id"]):
                return ancestor
        return None


def _generation(name: str) -> int:
    return int(name.partition(".")[0])
