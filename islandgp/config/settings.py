"""The whole configuration as one frozen value, validated before anything starts.

The model of each group is defined next to the code that uses it. This module combines them and
checks conflicts between groups. No other module uses Hydra's configuration objects.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from typing import Any, Final, Literal

from pydantic import BaseModel, Field, ValidationError, ValidationInfo, field_validator

from islandgp.config.errors import error_lines
from islandgp.domain import Domain, RewardTable, Schema
from islandgp.errors import ConfigError
from islandgp.evaluation.base import Problem
from islandgp.evaluation.perturbation import Perturbation, staged
from islandgp.evolution.prune import Pruning
from islandgp.gp.archive import ArchiveSettings
from islandgp.gp.plan import GP, Budget, Plan, Stop, Switches, is_read
from islandgp.gp.random_trees import check_growth
from islandgp.plugin import (
    ComponentConfig,
    ImportedClass,
    defined_in,
    path_of,
    plugin_errors,
    switched_numbers,
)
from islandgp.scoring.classes import Classes
from islandgp.scoring.constraints import Bound
from islandgp.scoring.constraints import faults as constraint_faults
from islandgp.scoring.curriculum import Curriculum
from islandgp.search.base import SEARCHES, USES
from islandgp.search.breeding import Breeding
from islandgp.supervision.base import SUPERVISES
from islandgp.supervision.library import LibrarySettings

NAME: Final = r"^[A-Za-z0-9][A-Za-z0-9._-]*$"
"""Names of runs and sweeps, which are names of folders."""


class DomainSettings(ImportedClass, frozen=True, extra="forbid"):
    """The group `domain`: the domain's class."""

    needs = ("make", "run_episode")
    models = ("World", "Rewards")


class SupervisorSettings(Switches, ComponentConfig, frozen=True, extra="forbid"):
    """The group `supervisor`."""

    needs = SUPERVISES

    name: str = Field(pattern=r"^[a-z][a-z0-9_]*$")  # in records, tags and folders' names

    def reads(self) -> Mapping[str, Sequence[str]]:
        """The keys that each part of the supervisor's guidance depends on; see `Supervisor`."""
        every_part = dict.fromkeys(USES, ("supervisor.policy",))
        parts: Mapping[str, Sequence[str]] = getattr(self.settings(), "reads", every_part)
        return parts


class SearchSettings(ComponentConfig, frozen=True, extra="forbid"):
    """The group `search`: the class that decides which trees are evaluated."""

    needs = SEARCHES

    name: str = Field(pattern=r"^[a-z][a-z0-9_]*$")  # in tags and tables
    ranking: Literal["evidence", "fitness"] = "evidence"
    """The candidates for the best robot: the trees with the best evidence over all generations, or
    the fittest ones of each generation and of each behaviour."""

    def reads(self) -> frozenset[str]:
        """The keys of other groups that the search reads; see `Search`."""
        return frozenset(getattr(self.settings(), "reads", ()))

    @field_validator("factory")
    @classmethod
    def _is_a_search(cls, factory: Any) -> Any:
        uses = getattr(factory, "uses", None)
        if isinstance(uses, frozenset) and uses <= USES and hasattr(factory, "Memory"):
            return factory
        raise ValueError(
            f"expected {factory!r} with class attributes uses, a frozenset of some of"
            f" {', '.join(map(repr, sorted(USES)))}, and Memory, the type of the state that a"
            f" checkpoint keeps, found uses = {uses!r}"
        )


class Settings(BaseModel, frozen=True, extra="forbid"):
    """One run."""

    seed: int = Field(ge=0, lt=2**63)
    name: str = Field(pattern=NAME, max_length=60)
    runs: str = Field(min_length=1)
    resume: Literal["auto", "never"]
    keep_going: bool = True  # of a sweep, after a job has failed
    progress: Literal["plain", "off"]
    start: str | None = Field(None, min_length=1)
    """First trees of generation 0: a .bt file, or a finished run, whose archive is used."""
    domain: DomainSettings
    world: Any  # the domain's own World
    rewards: Any  # the domain's own Rewards
    curriculum: Curriculum
    classes: Classes
    library: LibrarySettings
    gp: GP
    budget: Budget = Budget()
    stop: Stop = Stop()
    prune: Pruning = Field(default_factory=lambda: Pruning.model_validate({}))
    search: SearchSettings
    allocation: Any = Field(default={}, validate_default=True)  # the search's own Allocation
    archive: ArchiveSettings = ArchiveSettings()
    perturb: Perturbation | None = None  # docs/domains.md
    constraints: dict[str, Bound] = Field(default_factory=dict)  # limits by counter of the domain
    supervisor: SupervisorSettings
    evaluator: ComponentConfig
    tracking: ComponentConfig

    @field_validator("constraints", mode="before")
    @classmethod
    def _none_are_none(cls, constraints: Any) -> Any:
        return {} if constraints is None else constraints

    @field_validator("world", "rewards", mode="plain")
    @classmethod
    def _of_the_domain(cls, value: Any, info: ValidationInfo) -> Any:
        if (domain := info.data.get("domain")) is None:
            return value  # the domain reports its own error
        model = domain.factory.World if info.field_name == "world" else domain.factory.Rewards
        return model.model_validate(value)  # its errors become errors of this field

    @field_validator("allocation", mode="plain")
    @classmethod
    def _of_the_search(cls, value: Any, info: ValidationInfo) -> Any:
        """The keys that the search has; others act as those of `gp` that it does not read."""
        model = getattr(getattr(info.data.get("search"), "factory", None), "Allocation", None)
        if model is None or not isinstance(value, Mapping):
            return None
        if value and any(f.is_required() and k not in value for k, f in model.model_fields.items()):
            raise ValueError(
                f"expected the slots of the search ({', '.join(model.model_fields)}), found those"
                " of another one; leave out allocation, which follows the search"
            )
        return model.model_validate({k: v for k, v in value.items() if k in model.model_fields})

    def make_domain(self) -> Domain:
        """The domain with its world and rewards. Raises ConfigError if it rejects them."""
        factory = self.domain.factory
        with plugin_errors(path_of(factory)):
            domain: Domain = factory.make(self.world, self.rewards)
            schema = getattr(domain, "schema", None)
            if not isinstance(schema, Schema):
                type_name = "none" if schema is None else type(schema).__name__
                raise ConfigError(
                    f"domain.factory: expected {path_of(factory)} with a schema that is a Schema,"
                    f" found {type_name}{defined_in(factory)}"
                )
        return domain

    def problem(self, *, perturbed: bool = False) -> Problem:
        """The problem of the run: the domain, and the worlds of the curriculum's stages.

        `perturbed`: True: episodes run in perturbed worlds, if some are configured; False: as in
        training.
        """
        factory, task = self.domain.factory, (self.world, self.rewards, self.curriculum)
        with plugin_errors(path_of(factory)):
            problem = Problem.of(factory, *task, self.perturb, perturbed=perturbed)
        return replace(problem, observer=getattr(self.search.factory, "observer", None))

    def plan(self, domain: Domain) -> Plan:
        """The plan of the run, for the evolution loop."""
        return Plan(
            vocabulary=domain.schema.vocabulary,
            gp=self.gp,
            allocation=self.allocation,
            curriculum=self.curriculum,
            classes=self.classes,
            switches=self.supervisor,
            budget=self.budget,
            stop=self.stop,
            archive=self.archive,
            constraints=self.constraints,
        )


def read_settings(config: Mapping[str, Any]) -> Settings:
    """The settings in a plain nested mapping.

    Raises:
        ConfigError: with one line for each wrong key or value.
    """
    try:
        settings = _within_budget(Settings(**config))
    except ValidationError as error:
        models = Settings.model_json_schema()["$defs"].values()
        fields = {name for model in models for name in model.get("properties", ())}
        lines = error_lines(error, config, fields=fields)
        raise ConfigError("\n".join(sorted(set(lines)))) from None
    wrong = [*switched_numbers(config, settings.model_dump()), *_conflicts(settings)]
    wrong = wrong or [*_faults(settings)]
    if wrong:
        raise ConfigError("\n".join(dict.fromkeys(wrong)))
    return settings


def _within_budget(settings: Settings) -> Settings:
    """The settings with `gp.generations` derived from `budget.episodes`, if that is set."""
    gp, pruning, budget = settings.gp, settings.prune, settings.budget
    if budget.episodes is None:
        return settings
    share = 0.0
    if gp.validation:  # without validation the best robot is not shortened
        share = min(pruning.budget_share, pruning.episodes / budget.episodes)
    try:
        affordable = budget.generations(gp.population, gp.episodes, gp.validation, share)
    except ValueError as error:
        raise ConfigError(str(error)) from None
    limited = gp.model_copy(update={"generations": affordable})
    return settings.model_copy(update={"gp": limited})


def _conflicts(settings: Settings) -> Iterator[str]:
    """A line for each value that conflicts with another setting."""
    gp, supervisor = settings.gp, settings.supervisor
    injected = getattr(settings.allocation, "injected", 1)
    read = settings.search.reads()
    for key, value, most, bound in (
        ("gp.tournament_size", gp.tournament_size, gp.population, "gp.population"),
        ("supervisor.edits", supervisor.edits, gp.population - 3, "gp.population - 3"),
        ("allocation.injected", injected, gp.population - 3, "gp.population - 3"),
    ):
        if value > most and (not key.startswith("gp.") or is_read(key, read)):
            yield f"{key}: expected at most {bound} = {most}, found {value}"
    if settings.start is not None and gp.founders:
        yield (
            "gp.founders: expected one source of trees that open the population, found start"
            " as well; leave one of the two out"
        )
    tiers = settings.classes.tiers
    if settings.stop.tier is not None and settings.stop.tier not in tiers:
        yield f"stop.tier: expected one of {', '.join(tiers)}, found {settings.stop.tier!r}"
    mutations = {"gp.mutation": gp.mutation}
    if isinstance(breeding := getattr(settings.search.settings(), "breeding", None), Breeding):
        mutations["search.policy.breeding.mutation"] = breeding.mutation
    for path, mutation in mutations.items():
        try:
            check_growth(gp.trees, gp.limits, mutation.subtree_depth, path)
        except ValueError as error:
            yield str(error)


def _faults(settings: Settings) -> Iterator[str]:
    """A line for each name that the domain does not declare."""
    schema = settings.make_domain().schema
    yield from _staged_worlds(settings, schema)
    if isinstance(settings.rewards, RewardTable):
        yield from settings.rewards.faults(schema)
    yield from settings.curriculum.faults(schema)
    yield from settings.classes.faults(schema)
    yield from settings.gp.trees.faults(schema.vocabulary)
    search = settings.search.settings()
    if hasattr(search, "faults"):
        with plugin_errors(path_of(settings.search.factory)):
            yield from search.faults(schema)
    yield from settings.archive.faults(schema)
    yield from constraint_faults(settings.constraints, schema)
    if settings.perturb is not None:
        factory = settings.domain.factory
        with plugin_errors(path_of(factory)):
            yield from settings.perturb.faults(factory, settings.world, settings.rewards, schema)


def _staged_worlds(settings: Settings, schema: Schema) -> Iterator[str]:
    """A line for each stage with an invalid world, or with another vocabulary or other counters."""
    for i, stage in enumerate(settings.curriculum.stages):
        if not stage.world:
            continue
        path = f"curriculum.stages.{i}.world"
        try:
            world = staged(settings.world, stage.world)
        except ValidationError as error:
            yield from error_lines(error, settings.world.model_dump() | {**stage.world}, path)
            continue
        with plugin_errors(path_of(settings.domain.factory)):
            declared = settings.domain.factory.make(world, settings.rewards).schema
        if _names_of(declared) != _names_of(schema):
            yield (
                f"{path}: expected the same actions, keys, components and counters in every"
                " stage, found others; leave them out of the stage"
            )


def _names_of(schema: Schema) -> tuple[Any, ...]:
    return schema.vocabulary, tuple(schema.components), tuple(schema.counters)
