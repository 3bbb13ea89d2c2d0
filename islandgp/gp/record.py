"""The record of a generation, and the state from which a run continues.

Both are plain values without times or machine names, so the same seed gives the same bytes. `Cost`
has the times and is stored separately.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Annotated, Any

from pydantic import Field, PlainSerializer

from islandgp.bt.core.node import size_and_depth
from islandgp.gp.archive import ArchiveRecord, Elite
from islandgp.gp.edits import EditRecord, EditTrial
from islandgp.gp.population import Advice, Evaluated
from islandgp.plain import to_json
from islandgp.scoring.constraints import NO_CONSTRAINTS, Constraints, merit, violation
from islandgp.scoring.generation_stats import GenerationStats


@dataclass(frozen=True, slots=True)
class IndividualRecord:
    """An individual in the records: lineage, tree, behaviour, fitness."""

    id: str  # "<generation>.<slot>"
    origin: str  # a value of population.Origin
    parents: tuple[str, ...]  # ids
    mutation: str  # operator, or ""
    tree: str  # canonical text
    nodes: int  # >= 1
    depth: int  # levels, >= 1
    fitness: float  # points, Eq. (1)
    components: dict[str, float]  # points by component of the domain
    specialist: str  # its exclusive class (section 2.3.3)
    tiers: tuple[str, ...]  # rows of Table 4, best first
    counters: dict[str, float]  # by counter of the domain, mean over episodes
    endings: tuple[str, ...]  # why each episode ended


def to_record(e: Evaluated, text: str) -> IndividualRecord:
    """The record of an individual; `text` is its tree's canonical text."""
    i, o = e.individual, e.outcome
    nodes, levels = size_and_depth(i.tree)
    return IndividualRecord(
        id=i.id,
        origin=i.origin,
        parents=i.parents,
        mutation=i.mutation,
        tree=text,
        nodes=nodes,
        depth=levels,
        fitness=e.fitness,
        components=dict(o.components),
        specialist=e.labels.specialist,
        tiers=e.labels.tiers,
        counters=dict(o.counters),
        endings=o.endings,
    )


@dataclass(frozen=True, slots=True)
class GuidanceRecord:
    """The supervisor's guidance after a generation, and its effect."""

    asked_at: int | None  # generation whose state it answers
    source: str  # the supervisor's name, or "fallback"
    phase: str | None  # row of Table 8
    pattern: str | None  # row of Table 6
    target: str | None  # row of Table 7 that the tree is meant to add
    intervention: bool  # the supervisor considered an intervention necessary
    wanted_rate: float | None  # in [0, 1]; None: no rate was advised
    crisis: str  # Eq. (7): reason for a crisis, or ""
    applied_rate: float  # Eq. (8): mutation rate of the next population
    tree: str | None  # canonical text
    injected: bool  # True: the tree is in the next population
    refused: str  # why a tree was not injected, or ""
    risk: str  # these four as in supervision.base.Guidance
    reasoning: str
    rationale: str
    notes: dict[str, str]
    edits: tuple[EditRecord, ...] = ()  # that it advised


@dataclass(frozen=True, slots=True)
class GenerationRecord:
    """One generation."""

    snapshot: GenerationStats
    worlds: tuple[int, ...]  # world seeds
    origins: dict[str, int]  # individuals by origin
    stagnant_generations: int  # since the highest fitness of the stage last rose
    individuals: tuple[IndividualRecord, ...]  # in slot order
    guidance: GuidanceRecord | None  # for the next generation; None after the last
    archive: ArchiveRecord  # after it
    trials: tuple[EditTrial, ...] = ()  # its edited trees, in slot order


def record_values(record: GenerationRecord) -> dict[str, Any]:
    """A record as JSON values. The fields of edits are left out if there are none."""
    values: dict[str, Any] = to_json(record)
    if not record.trials:
        del values["trials"]
    if record.guidance is not None and not record.guidance.edits:
        del values["guidance"]["edits"]
    return values


@dataclass(frozen=True, slots=True)
class Champion:
    """The fittest individual so far; with constraints, those that keep them come first."""

    generation: int  # in which it was evaluated, from 0
    record: IndividualRecord


def updated_champion(
    before: Champion | None,
    generation: int,
    lines: Sequence[IndividualRecord],
    constraints: Constraints = NO_CONSTRAINTS,
) -> Champion:
    """The champion after `generation`; the earlier of equal individuals."""

    best = fittest(lines, constraints)
    if before is not None and fittest([before.record, best], constraints) is before.record:
        return before
    return Champion(generation, best)


def fittest(lines: Sequence[IndividualRecord], constraints: Constraints) -> IndividualRecord:
    """The fittest individual that keeps the constraints, or else that with the least violation.

    The first of several equal ones.
    """
    return max(lines, key=lambda i: merit(i.fitness, violation(i.counters, constraints)))


@dataclass(frozen=True, slots=True)
class RunState:
    """All that the next generation depends on, besides configuration and seed."""

    generation: Annotated[int, Field(ge=0)]  # the next to be evaluated
    advice: Advice  # of the supervisor for this generation, with its mutation rate
    history: tuple[GenerationStats, ...]  # of the generations before, oldest first
    memory: Annotated[Any, PlainSerializer(to_json)]
    """`SearchState.memory`; as plain values if it was read from a checkpoint."""
    champion: Champion | None
    spent: Annotated[int, Field(ge=0)] = 0  # episodes of the generations before
    archive: tuple[Elite, ...] = ()  # by cell
    edit_parents: dict[str, str] = field(default_factory=dict)
    """Texts of the trees whose edits the next generation evaluates, by id."""


@dataclass(frozen=True, slots=True)
class Cost:
    """Costs of a generation. Not part of the record, as they differ between machines."""

    evaluation: float  # s
    supervision: float  # s spent waiting for guidance
    operators: float  # s, everything else in the loop
    episodes: int
    llm: dict[str, float] = field(default_factory=dict)  # supervision since the start, by name
    outside_training: int = 0
    """Of `episodes`, those of the supervisor, and of the search for its library."""
    library: int = 0
    """Of these, those of the search: all runs that use the library count the same search."""


@dataclass(frozen=True, slots=True)
class Step:
    """The result of a generation, as the evolution loop yields it."""

    record: GenerationRecord
    state: RunState | None  # to continue from; None after the last generation
    champion: Champion
    cost: Cost
    stopped: str = ""  # the target of `stop` that ended the run here, or ""
    archive: tuple[Elite, ...] = ()  # after it, by cell
