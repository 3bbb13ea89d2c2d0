"""The interface between evolution and supervisors: Eq. (5), advise(state) -> guidance."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from enum import StrEnum
from pathlib import Path
from typing import Final, Protocol, runtime_checkable

import numpy as np
from pydantic import BaseModel

from islandgp.bt.core.node import Limits, Node
from islandgp.domain import Domain, Schema
from islandgp.gp.archive import Elite
from islandgp.gp.edits import Edit, EditTrial
from islandgp.gp.plan import GP
from islandgp.gp.record import GuidanceRecord, IndividualRecord
from islandgp.scoring.classes import Classes
from islandgp.scoring.constraints import Constraints
from islandgp.scoring.curriculum import Curriculum
from islandgp.scoring.generation_stats import GenerationStats
from islandgp.scoring.state import Crisis, PopulationState
from islandgp.supervision.library import Library


class Phase(StrEnum):
    """The rows of Table 8."""

    EARLY_EXPLORATION = "early_exploration"
    EXPLOITATION = "exploitation"
    REFINEMENT = "refinement"
    BALANCED_OPTIMIZATION = "balanced_optimization"
    BALANCED_EXPLORATION = "balanced_exploration"
    AGGRESSIVE_EXPLORATION = "aggressive_exploration"
    CRISIS_INTERVENTION = "crisis_intervention"


class Pattern(StrEnum):
    """The rows of Table 6."""

    EXPLORATION_PHASE = "exploration_phase"
    HEALTHY_PROGRESS = "healthy_progress"
    RAPID_IMPROVEMENT = "rapid_improvement"
    PREMATURE_CONVERGENCE = "premature_convergence"
    STAGNATION = "stagnation"


def check_ranges(key: str, ranges: Mapping[Phase, tuple[float, float]]) -> None:
    """Raises ValueError unless each phase has a range of mutation rates; `key` is its name."""
    if missing := [phase.value for phase in Phase if phase not in ranges]:
        raise ValueError(f"{key}: expected a range for each phase, missing {', '.join(missing)}")
    for phase, (low, high) in ranges.items():
        if not 0 <= low <= high <= 1:
            raise ValueError(f"{key}.{phase}: expected 0 <= low <= high <= 1")


@dataclass(frozen=True, slots=True)
class Guidance:
    """A supervisor's answer. `None` means that it says nothing to that."""

    mutation_rate: float | None  # in [0, 1]
    tree: Node | None  # to inject
    source: str  # who it comes from: a supervisor's name, or "fallback"
    phase: Phase | None = None
    pattern: Pattern | None = None
    target: str | None = None  # what the tree is for: one of the state's targets
    intervention: bool = False  # the supervisor sees a need to step in
    risk: str = ""  # what it thinks may go wrong
    reasoning: str = ""  # why this rate
    rationale: str = ""  # why this tree
    notes: dict[str, str] = field(default_factory=dict)  # what a supervisor adds for the record
    edits: tuple[Edit, ...] = ()  # of individuals, the most important first
    episodes: int = 0  # that the supervisor ran for this answer; they count in the run's budget


@dataclass(frozen=True, slots=True)
class RunContext:
    """What a run can give to a supervisor that is made for it."""

    seed: int  # of the run
    generations: int  # of the run
    limits: Limits  # of trees
    folder: Path | None  # where the run keeps its files, None when it keeps none
    schema: Schema  # of the domain
    domain: Domain  # as `world` says
    domain_in: Callable[[int], Domain]  # by generation: stages may change it
    rewards: BaseModel  # the domain's Rewards
    classes: Classes
    library: Callable[[], Library]  # trees to inject; may take seconds; raises ConfigError
    crisis: Crisis  # when the run overrides the rate
    gp: GP
    curriculum: Curriculum
    adapt_mutation: bool  # False: rates are not used, and need not be worked out
    inject: bool  # False: trees are not used, and need not be worked out
    edits: int = 0  # edits that are used at most; the others are refused
    constraints: Constraints = field(
        default_factory=dict
    )  # who breaks one is worse than who keeps all
    coming: frozenset[Path] = frozenset()  # folders of runs that the same command makes before


@dataclass(frozen=True, slots=True)
class GenerationView:
    """One generation as records keep it: individuals, worlds and trials besides the state."""

    snapshot: GenerationStats
    worlds: tuple[int, ...]  # seeds: one an episode, or one an individual and episode
    multipliers: Mapping[str, float]  # of its stage, by component
    individuals: tuple[IndividualRecord, ...]  # in slot order
    guidance: GuidanceRecord | None  # that made it; None for generation 0
    archive: tuple[Elite, ...] = ()
    """The run's elites after it, which edits may name too; () with `supervisor.lag`, and for the
    generations that a resumed run repeats from its records."""
    trials: tuple[EditTrial, ...] = ()  # the edited trees that it evaluated


SUPERVISES: Final = ("make", "advise")
"""Methods of a class that configuration can choose as a supervisor, besides `Settings`."""


class Supervisor(Protocol):
    """Advises once a generation. `tests/contracts` holds what every one promises.

    A supervisor that configuration can choose has two class attributes more:
    `Settings`, a pydantic model, and `make(settings, context)`. It may have
    `ready(settings, context)`, which raises SupervisionError where it could not work; this
    is asked before the first run of a command starts.
    """

    name: str

    def advise(self, state: PopulationState, rng: np.random.Generator) -> Guidance:
        """Guidance for the next generation; a function of the state and the generator's draws."""
        ...


@runtime_checkable
class GenerationListener(Protocol):
    """Interface of a supervisor that uses more than the state."""

    def on_generation(self, generation: GenerationView) -> None:
        """Called for each generation, in order, before `advise` is called with its state.

        A resumed run calls it for the earlier generations from its records.
        """
        ...


@runtime_checkable
class SupervisorLifecycle(Protocol):
    """Interface of a supervisor that needs an external service."""

    def start(self) -> str:
        """Gets ready, before generation 0; returns a line for the person who started the run.

        Raises:
            SupervisionError: the other side will never answer, and the run must not start.
        """
        ...

    def spent(self) -> dict[str, float]:
        """What the whole run's supervision has taken so far, by name; may be asked at any time."""
        ...

    def close(self) -> None:
        """Frees what the supervisor holds; it is not asked afterwards."""
        ...
