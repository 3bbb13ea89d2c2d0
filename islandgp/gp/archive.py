"""An archive of elites: the best tree of each cell of a grid over counters (MAP-Elites).

Every run has one, with any search; it does not affect the population. Mouret and Clune 2015, arXiv
1504.04909; coverage and QD score: Pugh, Soros and Stanley 2016, doi 10.3389/frobt.2016.00040. An
elite's fitness is the mean over its episodes. With `reevaluations` above 0 a challenger and the
elite are first evaluated in further worlds, as a single lucky episode would otherwise hold a cell
forever (Flageat and Cully 2020, arXiv 2003.13530).
"""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from math import prod
from typing import Annotated, Final

from pydantic import BaseModel, Field, FiniteFloat, field_validator

from islandgp.domain import Schema, total
from islandgp.domain.rewards import unknown
from islandgp.scoring.classes import Classes

EDGES: Final = (0.0, 1.0, 2.0, 4.0, 8.0, 16.0)  # of a counter where none are configured
MAX_AXES: Final = 4  # a map with more axes is hard to read
MAX_CELLS: Final = 10_000  # each checkpoint holds the whole archive

Edges = Annotated[tuple[FiniteFloat, ...], Field(min_length=2, max_length=100)]


class ArchiveSettings(BaseModel, frozen=True, extra="forbid"):
    """The key `archive`: the grid, and how elites are displaced."""

    cells: dict[str, Edges] | None = None
    """Rising edges by counter: a cell begins at an edge and ends before the next one; the last
    cell has no end. None: EDGES for the first four counters of `classes.behaviours`."""
    reevaluations: Annotated[int, Field(ge=0, le=1000)] = 0
    """Further episodes of a challenger and of the elite, in the same worlds, before the challenger
    can displace it."""
    floor: FiniteFloat = 0.0  # points; the QD score sums the elites' means above the floor

    @field_validator("cells")
    @classmethod
    def _grid(cls, cells: dict[str, Edges] | None) -> dict[str, Edges] | None:
        if cells is None:
            return None
        for counter, edges in cells.items():
            if any(b <= a for a, b in pairwise(edges)):
                edge_list = ", ".join(f"{edge:g}" for edge in edges)
                raise ValueError(f"expected rising edges of {counter}, found [{edge_list}]")
        if len(cells) > MAX_AXES:
            raise ValueError(f"expected at most {MAX_AXES} counters, found {len(cells)}")
        if (n := prod(map(len, cells.values()))) > MAX_CELLS:
            raise ValueError(f"expected at most {MAX_CELLS:,} cells in all, found {n:,}")
        return cells

    def axes(self, classes: Classes) -> Mapping[str, Edges]:
        """The grid's edges by counter."""
        counters = [*dict.fromkeys(classes.behaviours.values())][:MAX_AXES]
        return self.cells or dict.fromkeys(counters, EDGES)

    def faults(self, schema: Schema) -> Iterator[str]:
        """A line for each counter that the domain does not declare."""
        for counter in self.cells or ():
            yield from unknown(f"archive.cells.{counter}", counter, schema.counters)


@dataclass(frozen=True, slots=True)
class Elite:
    """The best tree of a cell."""

    cell: tuple[int, ...]  # index on each axis, from 0
    id: str  # of the individual that filled the cell
    tree: str  # canonical text
    stage: int  # of the curriculum, whose multipliers are in `mean`
    episodes: int  # in which it was evaluated, >= 1
    mean: float  # fitness over these episodes, points
    world: int  # seed of the first world that it met in its last generation


@dataclass(frozen=True, slots=True)
class ArchiveRecord:
    """The archive after a generation."""

    coverage: float  # share of the cells that have an elite, in [0, 1]
    qd_score: float  # sum of the elites' means above the floor, points, >= 0
    new: int  # cells filled in this generation
    improved: int  # elites displaced in this generation


@dataclass(frozen=True, slots=True)
class ArchiveUpdate:
    """The archive after a generation, its record, and the number of episodes."""

    elites: tuple[Elite, ...]  # by cell
    record: ArchiveRecord
    episodes: int  # of the re-evaluations of challengers and elites


Reevaluate = Callable[[Sequence[str]], Sequence[float | None]]
"""Evaluates trees (canonical text) in the same `reevaluations` worlds; returns the mean fitness of
each, None for one that violates a constraint."""


def cell_of(counters: Mapping[str, float], axes: Mapping[str, Sequence[float]]) -> tuple[int, ...]:
    """The cell of these counters; a value below the first edge is in the first cell."""
    return tuple([max(0, bisect_right(edges, counters[name]) - 1) for name, edges in axes.items()])


def archive_record(
    elites: Sequence[Elite],
    axes: Mapping[str, Sequence[float]],
    *,
    floor: float,
    new: int = 0,
    improved: int = 0,
) -> ArchiveRecord:
    """Coverage and QD score of an archive.

    An elite below the floor adds nothing, so filling a cell never lowers the QD score.
    """
    coverage = len(elites) / prod(map(len, axes.values()))
    return ArchiveRecord(
        coverage, float(total(max(0.0, e.mean - floor) for e in elites)), new, improved
    )


def update_archive(
    before: Sequence[Elite],
    individuals: Sequence[tuple[Elite, bool]],
    axes: Mapping[str, Sequence[float]],
    settings: ArchiveSettings,
    reevaluate: Reevaluate,
) -> ArchiveUpdate:
    """The archive after a generation.

    A tree that is already an elite keeps its cell, and its mean includes the new episodes. The
    fittest of the other trees of a cell challenges its elite. Stages of the curriculum have
    different scales, so the mean of an earlier stage loses against any mean of this one. Only
    trees that keep all constraints are elites; an elite that violates one in a later evaluation
    is removed.

    Args:
        before: the elites after the previous generation.
        individuals: of this generation, in slot order: the elite that each would be, and whether
            it violates a constraint.
        axes: the grid's edges by counter.
        settings: the floor, and the number of re-evaluations.
        reevaluate: called at most once, and not if `settings.reevaluations` is 0.

    Returns:
        The elites, the generation's record, and the number of re-evaluation episodes.
    """
    elites = {e.cell: e for e in before}
    cell_of_elite = {e.tree: e.cell for e in before}
    challengers: dict[tuple[int, ...], Elite] = {}
    trees: set[str] = set()
    for new, broken in individuals:
        if new.tree in trees:  # a duplicate, mostly evaluated in the same world
            continue
        trees.add(new.tree)
        cell = cell_of_elite.get(new.tree)
        if broken:
            if cell is not None:
                del elites[cell]
        elif cell is not None:
            elite = elites[cell]
            if (elite.world, elite.stage) != (new.world, new.stage):  # else the same episodes again
                mean = _updated(elite, new.episodes, new.mean, new.stage)
                elites[cell] = replace(mean, world=new.world)
        elif new.cell not in challengers or new.mean > challengers[new.cell].mean:
            challengers[new.cell] = new
    filled = {cell: c for cell, c in challengers.items() if cell not in elites}
    rivals = [
        (elites.pop(cell), challenger)
        for cell, challenger in sorted(challengers.items())
        if cell in elites and _beats(challenger, elites[cell])
    ]
    elites |= filled
    improved = 0
    for old, rival in _reevaluated(rivals, settings.reevaluations, reevaluate):
        wins = rival is not None and (old is None or _beats(rival, old))
        improved += wins
        if (winner := rival if wins else old) is not None:
            elites[winner.cell] = winner
    after = tuple(elites[cell] for cell in sorted(elites))
    record = archive_record(after, axes, floor=settings.floor, new=len(filled), improved=improved)
    return ArchiveUpdate(after, record, 2 * settings.reevaluations * len(rivals))


def _reevaluated(
    rivals: Sequence[tuple[Elite, Elite]], n: int, reevaluate: Reevaluate
) -> Iterator[tuple[Elite | None, Elite | None]]:
    """Elites and challengers after `n` more episodes; None for one that violates a constraint."""
    if not n or not rivals:
        yield from rivals
        return
    before = [elite for pair in rivals for elite in pair]
    stage = before[1].stage  # of this generation
    after = [
        None if mean is None else _updated(elite, n, mean, stage)
        for elite, mean in zip(before, reevaluate([e.tree for e in before]), strict=True)
    ]
    yield from zip(after[::2], after[1::2], strict=True)


def _beats(challenger: Elite, elite: Elite) -> bool:
    """True if the challenger has a later stage, or a higher mean in the same stage."""
    return (challenger.stage, challenger.mean) > (elite.stage, elite.mean)


def _updated(elite: Elite, n: int, mean: float, stage: int) -> Elite:
    """The elite after `n` more episodes with this mean; those of an earlier stage are dropped."""
    if elite.stage != stage:
        return replace(elite, stage=stage, episodes=n, mean=mean)
    episodes = elite.episodes + n
    total_points = elite.episodes * elite.mean + n * mean
    return replace(elite, episodes=episodes, mean=total_points / episodes)
