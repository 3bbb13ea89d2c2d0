"""An archive of elites: the best tree of each cell of a grid over counters (MAP-Elites).

Every run has one, with any search; it does not affect the population. Mouret and Clune 2015, arXiv
1504.04909; coverage and QD score: Pugh, Soros and Stanley 2016, doi 10.3389/frobt.2016.00040. An
elite's value is the mean of its episodes. With `again` above 0 a challenger and the elite are
evaluated in further worlds first, because a single lucky episode would otherwise hold a cell
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

from islandgp.domain import Outcome, Schema, total
from islandgp.gp.population import Evaluated
from islandgp.scoring.classes import Classes
from islandgp.scoring.constraints import NO_CONSTRAINTS, Constraints, mean_violation
from islandgp.scoring.rewards import unknown

EDGES: Final = (0.0, 1.0, 2.0, 4.0, 8.0, 16.0)  # of a counter where none are configured
AXES: Final = 4  # at most: a map of more can hardly be read
CELLS: Final = 10_000  # at most: each checkpoint holds the whole archive

Edges = Annotated[tuple[FiniteFloat, ...], Field(min_length=2, max_length=100)]


class ArchiveSettings(BaseModel, frozen=True, extra="forbid"):
    """The key `archive`: the grid, and how elites are displaced."""

    cells: dict[str, Edges] | None = None
    """Rising edges by counter: a cell begins at each and ends before the next, the last has no
    end. None: edges 0, 1, 2, 4, 8, 16 for the first four counters of `classes.behaviours`."""
    again: Annotated[int, Field(ge=0, le=1000)] = 0
    """Episodes, in worlds that both meet, before a challenger may displace an elite."""
    floor: FiniteFloat = 0.0  # points; the QD score sums what the elites' means have above it

    @field_validator("cells")
    @classmethod
    def _grid(cls, cells: dict[str, Edges] | None) -> dict[str, Edges] | None:
        if cells is None:
            return None
        for counter, edges in cells.items():
            if any(b <= a for a, b in pairwise(edges)):
                shown = ", ".join(f"{edge:g}" for edge in edges)
                raise ValueError(f"expected rising edges of {counter}, found [{shown}]")
        if len(cells) > AXES:
            raise ValueError(f"expected at most {AXES} counters, found {len(cells)}")
        if (n := prod(map(len, cells.values()))) > CELLS:
            raise ValueError(f"expected at most {CELLS:,} cells in all, found {n:,}")
        return cells

    def axes(self, classes: Classes) -> Mapping[str, Edges]:
        """The grid's edges by counter."""
        counters = [*dict.fromkeys(classes.behaviours.values())][:AXES]
        return self.cells or dict.fromkeys(counters, EDGES)

    def faults(self, schema: Schema) -> Iterator[str]:
        """A line for each counter that the domain does not declare."""
        for counter in self.cells or ():
            yield from unknown(f"archive.cells.{counter}", counter, schema.counters)


@dataclass(frozen=True, slots=True)
class Elite:
    """The tree of a cell."""

    cell: tuple[int, ...]  # its place on each axis, from 0
    id: str  # of the individual that it came as
    tree: str  # canonical text
    stage: int  # of the curriculum, whose multipliers made its points
    episodes: int  # >= 1
    mean: float  # fitness over these, points
    world: int  # first world of its last generation: the same one again is no news


@dataclass(frozen=True, slots=True)
class ArchiveRecord:
    """The archive after a generation."""

    coverage: float  # share of the cells that have an elite, in [0, 1]
    qd_score: float  # sum of what the elites' means have above the floor, points, >= 0
    new: int  # cells filled in this generation
    improved: int  # elites displaced in this generation


@dataclass(frozen=True, slots=True)
class ArchiveUpdate:
    """The archive after a generation, and what it took."""

    elites: tuple[Elite, ...]  # by cell
    record: ArchiveRecord
    episodes: int  # in which challengers and elites were evaluated again


Again = Callable[[Sequence[str]], Sequence[Sequence[Outcome]]]
"""Evaluates trees, given as canonical text, in the same `again` worlds; an entry for each tree."""


def cell_of(counters: Mapping[str, float], axes: Mapping[str, Sequence[float]]) -> tuple[int, ...]:
    """The cell of these counters; what lies below the first edge is in the first cell."""
    return tuple(max(0, bisect_right(edges, counters[name]) - 1) for name, edges in axes.items())


def archive_record(
    elites: Sequence[Elite],
    axes: Mapping[str, Sequence[float]],
    *,
    floor: float,
    new: int = 0,
    improved: int = 0,
) -> ArchiveRecord:
    """Coverage and QD score of an archive.

    An elite below the floor adds nothing, so that to fill a cell never lowers the QD score.
    """
    coverage = len(elites) / prod(map(len, axes.values()))
    return ArchiveRecord(
        coverage, float(total(max(0.0, e.mean - floor) for e in elites)), new, improved
    )


def update_archive(
    before: Sequence[Elite],
    evaluated: Sequence[Evaluated],
    texts: Sequence[str],
    worlds: Sequence[int],
    settings: ArchiveSettings,
    classes: Classes,
    *,
    stage: int,
    episodes: int,
    again: Again,
    constraints: Constraints = NO_CONSTRAINTS,
) -> ArchiveUpdate:
    """The archive after a generation.

    A tree that is an elite already keeps its cell, and its mean takes the new episodes in. Of the
    others the fittest in each cell challenges the elite there. Stages of the curriculum have
    scales of their own: points of an earlier stage count for nothing against those of this one.
    Only trees that keep all constraints are elites: one that breaks them in a later evaluation
    leaves its cell.

    Args:
        before: the elites after the generation before.
        evaluated: this generation's individuals.
        texts: their canonical texts.
        worlds: the first world of each.
        settings: the grid, and how many episodes a challenge takes.
        classes: whose counters make the grid where `settings` name none.
        stage: index of this generation's stage.
        episodes: that each individual had.
        again: called once at most, and never where `settings.again` is 0.
        constraints: that elites keep.
    """
    axes = settings.axes(classes)
    elites = {e.cell: e for e in before}
    known = {e.tree: e.cell for e in before}
    challengers: dict[tuple[int, ...], Elite] = {}
    seen: set[str] = set()
    for e, text, world in zip(evaluated, texts, worlds, strict=True):
        if text in seen:  # it is in this generation twice, mostly in the same world
            continue
        seen.add(text)
        if (cell := known.get(text)) is not None:
            if e.violation:
                elites.pop(cell)
            elif (elites[cell].world, elites[cell].stage) != (world, stage):
                elites[cell] = replace(_with(elites[cell], episodes, e.fitness, stage), world=world)
            continue
        if e.violation:
            continue
        cell = cell_of(e.outcome.counters, axes)
        if cell not in challengers or e.fitness > challengers[cell].mean:
            challengers[cell] = Elite(
                cell, e.individual.id, text, stage, episodes, e.fitness, world
            )
    filled = [cell for cell in challengers if cell not in elites]
    rivals = [
        (elites[cell], challenger)
        for cell, challenger in sorted(challengers.items())
        if cell in elites and _beats(challenger, elites[cell])
    ]
    elites |= {cell: challengers[cell] for cell in filled}
    improved = 0
    for elite, _ in rivals:
        del elites[elite.cell]
    for old, new in _again(rivals, settings.again, again, constraints, stage):
        wins = new is not None and (old is None or _beats(new, old))
        improved += wins
        if (winner := new if wins else old) is not None:
            elites[winner.cell] = winner
    kept = tuple(elites[cell] for cell in sorted(elites))
    record = archive_record(kept, axes, floor=settings.floor, new=len(filled), improved=improved)
    return ArchiveUpdate(kept, record, 2 * settings.again * len(rivals))


def _again(
    rivals: Sequence[tuple[Elite, Elite]],
    n: int,
    again: Again,
    constraints: Constraints,
    stage: int,
) -> Iterator[tuple[Elite | None, Elite | None]]:
    """Elites and their challengers after `n` more episodes; None: it violates a constraint."""
    if not n or not rivals:
        yield from rivals
        return
    everyone = [elite for pair in rivals for elite in pair]
    outcomes = again([elite.tree for elite in everyone])
    entrants = [
        _with(elite, len(more), total(o.fitness for o in more) / len(more), stage)
        if not mean_violation(more, constraints)
        else None
        for elite, more in zip(everyone, outcomes, strict=True)
    ]
    yield from zip(entrants[::2], entrants[1::2], strict=True)


def _beats(challenger: Elite, elite: Elite) -> bool:
    """True if the challenger has a later stage, or a higher mean in the same stage."""
    return (challenger.stage, challenger.mean) > (elite.stage, elite.mean)


def _with(elite: Elite, n: int, mean: float, stage: int) -> Elite:
    """The elite after `n` more episodes; those of an earlier stage are dropped."""
    if elite.stage != stage:
        return replace(elite, stage=stage, episodes=n, mean=mean)
    whole = elite.episodes + n
    return replace(elite, episodes=whole, mean=(elite.episodes * elite.mean + n * mean) / whole)
