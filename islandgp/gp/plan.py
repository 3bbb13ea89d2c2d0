"""The plan of a run: settings of genetic programming and of supervision."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Annotated, Any, Final, Literal, TypeVar

from pydantic import AfterValidator, BaseModel, Field, FiniteFloat

from islandgp.bt.core.node import Limits, Node
from islandgp.bt.core.vocabulary import Vocabulary
from islandgp.gp.archive import ArchiveSettings
from islandgp.gp.population import Evaluated
from islandgp.gp.random_trees import TreeSettings, TreeSpace
from islandgp.gp.selection import SELECTIONS
from islandgp.gp.variation import CROSSOVERS, MutationSettings
from islandgp.plugin import function
from islandgp.scoring.classes import Classes
from islandgp.scoring.constraints import Constraints
from islandgp.scoring.curriculum import Curriculum
from islandgp.scoring.state import Crisis, StateSettings

MAX_GENERATIONS: Final = 100_000  # of a run


RUN_READS: Final = (
    *("gp.population", "gp.generations", "gp.episodes", "gp.validation", "gp.founders"),
    *("gp.reseed_every", "gp.shared_seed", "gp.max_depth", "gp.max_nodes"),
)
"""Keys of `gp` that every run reads. A search or a supervisor declares others in `reads`."""


def name_in(table: Mapping[str, Any]) -> AfterValidator:
    """Makes pydantic reject what is neither an entry of a table nor a "module:function"."""

    def checked(name: str) -> str:
        function(name, table)
        return name

    return AfterValidator(checked)


S = TypeVar("S", bound=BaseModel)


def declared(settings: S, group: str, keys: Collection[str]) -> S:
    """The settings of a group, with only the fields that `keys` has, in whole or in part."""
    fields = {f: getattr(settings, f) for f in type(settings).model_fields}
    return settings.model_construct(
        **{f: v for f, v in fields.items() if is_read(f"{group}.{f}", keys)}
    )


def must_be_declared(key: str, keys: Collection[str]) -> None:
    """Raises AttributeError for a key that a search or a supervisor does not declare."""
    if not is_read(key, keys):
        raise AttributeError(
            f"expected {key} among the keys in `reads` of its Settings, found none"
        )


def is_read(key: str, keys: Collection[str]) -> bool:
    """True if `keys` has this dotted key, a group that it is in, or a key below it."""
    return any(f"{key}.".startswith(f"{k}.") or f"{k}.".startswith(f"{key}.") for k in keys)


class GP(BaseModel, frozen=True, extra="forbid"):
    """Genetic programming, section 2.3."""

    population: int = Field(ge=4, le=10_000)
    generations: int = Field(ge=1, le=MAX_GENERATIONS)  # including generation 0
    selection: Annotated[str, name_in(SELECTIONS)]  # of parents; or "module:function"
    tournament_size: int = Field(ge=1)  # individuals that a selection compares
    crossover: Annotated[str, name_in(CROSSOVERS)]  # or "module:function"
    crossover_rate: float = Field(ge=0, le=1)
    mutation_rate: float = Field(ge=0, le=1)  # until a supervisor sets another one
    founders: bool = False  # the library's trees start the initial population
    mutate_elites: bool  # elites and the injected tree are mutated, too
    max_depth: int = Field(ge=2, le=50)
    max_nodes: int = Field(ge=3, le=1000)
    episodes: int = Field(ge=1, le=1000)  # of each individual
    validation: float = Field(ge=0, le=1)
    """Episodes of the selection of the best robot, as a share of the training episodes."""
    reseed_every: Literal["generation", "epoch", "never"]  # interval of new world seeds
    shared_seed: bool  # all individuals of a generation have the same worlds
    trees: TreeSettings
    mutation: MutationSettings
    state: StateSettings
    crisis: Crisis

    @property
    def episodes_in_all(self) -> int:
        """Number of training episodes of a run."""
        return self.population * self.generations * self.episodes

    @property
    def limits(self) -> Limits:
        """The largest tree (section 2.2.3)."""
        return Limits(self.max_depth, self.max_nodes)


class Budget(BaseModel, frozen=True, extra="forbid"):
    """Budget of a run in episodes of any purpose."""

    episodes: Annotated[int, Field(ge=1)] | None = None
    """Of training, the archive, validation, the supervisor and the search for its library. None: as
    many as `gp.generations` needs."""

    def generations(
        self, population: int, episodes: int, validation: float, pruning: float = 0.0
    ) -> int:
        """Number of generations within the budget, >= 1; the budget must be set.

        Args:
            population: individuals per generation.
            episodes: of each individual.
            validation: episodes of validation, as a share of those of training.
            pruning: episodes of the best robot's shortening, as a share of the budget.

        Raises:
            ValueError: the budget is smaller than one generation and its validation.
        """
        assert self.episodes is not None
        one = population * episodes
        minimum = one + (max(1, round(validation * one)) if validation else 0)
        if self.episodes < minimum:
            raise ValueError(
                f"budget.episodes: expected at least {minimum:,}, one generation and its"
                f" validation, found {self.episodes:,}; raise it, or lower gp.population or"
                " gp.episodes"
            )
        most = MAX_GENERATIONS * minimum
        if self.episodes > most:
            raise ValueError(
                f"budget.episodes: expected at most {most:,}, those of {MAX_GENERATIONS:,}"
                f" generations, found {self.episodes:,}; lower it, or raise gp.population"
            )
        return max(1, int(self.episodes * (1 - pruning) / (1 + validation)) // one)


class Stop(BaseModel, frozen=True, extra="forbid"):
    """Targets that end a run early; validation follows as in any run."""

    tier: str | None = None  # reached by an individual of a generation
    fitness: FiniteFloat | None = None  # points reached by an individual of a generation

    def reason(self, population: Sequence[Evaluated]) -> str:
        """The reason to stop after this generation, or "". Infeasible individuals do not count."""
        able = [e for e in population if not e.violation]
        if self.tier is not None and any(self.tier in e.labels.tiers for e in able):
            return f"stop.tier={self.tier}"
        if self.fitness is not None and any(e.fitness >= self.fitness for e in able):
            return f"stop.fitness={self.fitness:g}"
        return ""


class Switches(BaseModel, frozen=True, extra="forbid"):
    """Switches for the parts of a supervisor's guidance, for ablations."""

    adapt_mutation: bool  # its mutation rate takes effect
    inject: bool  # its tree is injected; else a random tree has this slot
    edits: int = Field(0, ge=0, le=1000)  # slots of the next population for its edited trees


@dataclass(frozen=True, slots=True)
class Plan:
    """The settings of a run, except for seed, supervisor and evaluator."""

    vocabulary: Vocabulary
    gp: GP
    allocation: Any  # an instance of the search's `Allocation`
    curriculum: Curriculum
    classes: Classes
    switches: Switches
    budget: Budget = field(default_factory=Budget)
    stop: Stop = field(default_factory=Stop)
    archive: ArchiveSettings = field(default_factory=ArchiveSettings)
    constraints: Constraints = field(default_factory=dict)
    founders: tuple[Node, ...] = ()  # first trees of the initial population

    def left(self, generation: int, spent: int) -> int:
        """Number of generations that follow this one, at most 0 after the last.

        Args:
            generation: from 0.
            spent: episodes of the run so far, including this generation.
        """
        planned = self.gp.generations - 1 - generation
        if self.budget.episodes is None:
            return planned
        affordable = (self.gp.episodes_in_all - spent) // (self.gp.population * self.gp.episodes)
        return min(planned, affordable)

    @property
    def space(self) -> TreeSpace:
        """The search space of trees."""
        return TreeSpace(self.gp.trees, self.vocabulary, self.gp.limits)
