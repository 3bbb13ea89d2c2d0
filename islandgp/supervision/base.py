"""The supervisor interface: Eq. (5), advise(state) -> guidance."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from enum import StrEnum
from pathlib import Path
from typing import Annotated, ClassVar, Final, Protocol, runtime_checkable

import numpy as np
from pydantic import AfterValidator, BaseModel, Field, Strict

from islandgp.bt.core.node import Limits
from islandgp.domain import Domain, Schema
from islandgp.gp.archive import Elite
from islandgp.gp.edits import STRICT, CheckedTree, Edit, EditTrial, Text, encodable
from islandgp.gp.plan import GP
from islandgp.gp.record import GuidanceRecord, IndividualRecord
from islandgp.plain import RISING
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


Share = Annotated[float, Field(ge=0, le=1, allow_inf_nan=False), AfterValidator(float)]


def _complete(ranges: dict[Phase, tuple[float, float]]) -> dict[Phase, tuple[float, float]]:
    if missing := [phase.value for phase in Phase if phase not in ranges]:
        raise ValueError(f"expected a range for each phase, missing {', '.join(missing)}")
    return ranges


Rates = Annotated[tuple[Share, Share], RISING]
"""The lowest and the highest mutation rate, in [0, 1]."""
PhaseRates = Annotated[dict[Phase, Rates], AfterValidator(_complete)]


@dataclass(frozen=True, slots=True)
class Guidance:
    """A supervisor's answer. None means that a part is left out."""

    __pydantic_config__: ClassVar = STRICT

    mutation_rate: Share | None  # in [0, 1]
    tree: CheckedTree | None  # to inject
    source: Annotated[str, Field(min_length=1), AfterValidator(encodable)]
    """The supervisor's name, or "fallback"."""
    phase: Annotated[Phase, Strict(False)] | None = None
    pattern: Annotated[Pattern, Strict(False)] | None = None
    target: Text | None = None  # purpose of the tree: one of the state's targets
    intervention: bool = False  # the supervisor considers an intervention necessary
    risk: Text = ""  # in its assessment
    reasoning: Text = ""  # for the rate
    rationale: Text = ""  # for the tree
    notes: dict[Text, Text] = field(default_factory=dict)  # further entries of the record
    edits: tuple[Edit, ...] = ()  # of individuals, the most important first
    episodes: Annotated[int, Field(ge=0)] = 0
    """Episodes simulated for this answer; they count toward the run's budget."""


@dataclass(frozen=True, slots=True)
class RunContext:
    """Arguments of a supervisor's `make` and `check` that come from the run."""

    seed: int  # of the run
    generations: int  # of the run
    limits: Limits  # of trees
    folder: Path | None  # of the run's files; None: the run writes none
    schema: Schema  # of the domain
    domain: Domain  # with the settings of `world`
    domain_in: Callable[[int], Domain]  # by generation, as stages may change the world
    rewards: BaseModel  # the domain's Rewards
    classes: Classes
    library: Callable[[], Library]  # loads trees to inject, in seconds; raises ConfigError
    crisis: Crisis  # conditions in which the run overrides the rate
    gp: GP
    curriculum: Curriculum
    adapt_mutation: bool  # False: rates are not used and need not be computed
    inject: bool  # False: trees are not used and need not be computed
    edits: int = 0  # most edits per generation; further ones are rejected
    by_rate: bool = True  # the search mutates by a rate
    constraints: Constraints = field(default_factory=dict)  # of the individuals; {}: none


@dataclass(frozen=True, slots=True)
class GenerationView:
    """One generation as recorded: the statistics with individuals, seeds and trials."""

    snapshot: GenerationStats
    worlds: tuple[int, ...]  # world seeds: one per episode, or one per individual and episode
    multipliers: Mapping[str, float]  # of the curriculum's stage, by component
    individuals: tuple[IndividualRecord, ...]  # in slot order
    guidance: GuidanceRecord | None  # with which it was created; None for generation 0
    archive: tuple[Elite, ...] = ()
    """The run's elites after this generation; edits may refer to them. () for the generations that
    a resumed run repeats from its records."""
    trials: tuple[EditTrial, ...] = ()  # edited trees that were evaluated
    learned: tuple[str, ...] = ()
    """What the search has found out before this generation, in sentences; () as for `archive`."""


SUPERVISES: Final = ("make", "advise")
"""Methods that a configured supervisor must have, besides the class `Settings`."""


class Supervisor(Protocol):
    """Advises the run once per generation. `tests/contracts` checks every implementation.

    A supervisor that can be configured has two more class attributes: `Settings`, a pydantic
    model, and `make(settings, context)`. A third, `check(settings, context)`, is optional: it is
    called before the first run of a command and raises SupervisionError if the supervisor
    cannot work. `Settings` may have a property `reads`: the keys that each part of the guidance
    ("rate", "tree", "edits") depends on, e.g. `{"rate": ("supervisor.policy", "gp.state")}`.
    Without it the supervisor gives every part, and reads `supervisor.policy` alone. The context's
    `gp` and `library` have nothing else, except for RUN_READS.
    """

    name: str

    def advise(self, state: PopulationState, rng: np.random.Generator) -> Guidance:
        """Returns guidance for the next generation.

        Args:
            state: of the population that was evaluated last.
            rng: the only source of randomness; the generator is consumed.

        Returns:
            The guidance: a function of the state and the draws.
        """
        ...


@runtime_checkable
class GenerationListener(Protocol):
    """Interface of a supervisor that uses more than the population's state."""

    def on_generation(self, generation: GenerationView) -> None:
        """Called for each generation, in order, before `advise` is called with its state.

        A resumed run calls it first for the generations in its records.

        Args:
            generation: as recorded.
        """
        ...


@runtime_checkable
class SupervisorLifecycle(Protocol):
    """Interface of a supervisor that needs an external service."""

    def start(self) -> str:
        """Connects to the service before generation 0; returns a line for the console.

        Raises:
            SupervisionError: the service cannot answer at all, so that the run must not start.
        """
        ...

    def spent(self) -> dict[str, float]:
        """The costs of the whole run so far, by name; may be called at any time."""
        ...

    def close(self) -> None:
        """Releases the service; the supervisor is not used afterwards."""
        ...
