"""The whole configuration as one frozen value, validated before anything starts.

Each group's model stands beside the code that uses it; this module composes
them and checks what concerns several of them. Nothing below it sees Hydra's
config object.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from difflib import get_close_matches
from types import UnionType
from typing import Annotated, Any, Final, Literal, Self, Union, get_args, get_origin

from pydantic import (
    BaseModel,
    Field,
    ValidationError,
    ValidationInfo,
    field_validator,
    model_validator,
)

from islandgp.domain import Domain, Schema
from islandgp.errors import ConfigError, IslandError
from islandgp.evaluation.base import Problem
from islandgp.evaluation.perturbation import Perturbation
from islandgp.evaluation.worlds import staged
from islandgp.gp.archive import ArchiveSettings
from islandgp.gp.plan import GP, Allocation, Budget, Plan, Stop, Switches
from islandgp.gp.random_trees import check_growth
from islandgp.plugin import (
    ComponentConfig,
    ImportedClass,
    defined_in,
    imported,
    path_of,
    plugin_errors,
)
from islandgp.records.files import VALUES
from islandgp.scoring.classes import CLASS_NAME, Classes
from islandgp.scoring.constraints import Bound
from islandgp.scoring.constraints import faults as constraint_faults
from islandgp.scoring.curriculum import Curriculum
from islandgp.scoring.rewards import RewardTable
from islandgp.search.base import SEARCHES, USES
from islandgp.search.breeding import Breeding
from islandgp.supervision.base import SUPERVISES
from islandgp.supervision.library import LibrarySettings

TAG: Final = r"^[A-Za-z0-9_. :/-]{1,250}$"
"""Names of tags that MLflow takes."""

NAME: Final = r"^[A-Za-z0-9][A-Za-z0-9._-]*$"
"""Names of runs and sweeps, which are names of folders."""

IN_WORDS: Final = {
    TAG: "1 to 250 letters, digits, spaces and . _ : / -",
    NAME: "letters, digits and . _ -, beginning with a letter or a digit",
    CLASS_NAME: "small letters, digits and _, beginning with a letter",
}
"""What a pattern asks for, as people say it."""

OWN_TAGS: Final = frozenset(
    {"domain", "supervisor", "arm", "seed", "sweep", "code", "config", "kind", "pruned"}
)
"""Names of tags that each run has already."""


MACHINES_TAGS: Final = ("mlflow.", "islandgp.")
"""How the names of tags begin that MLflow and the mirror need."""


class DomainSettings(ImportedClass, frozen=True, extra="forbid"):
    """The group `domain`: the class of the world that trees live in."""

    needs = ("make", "run_episode")
    models = ("World", "Rewards")


class SupervisorSettings(Switches, ComponentConfig, frozen=True, extra="forbid"):
    """The group `supervisor`."""

    needs = SUPERVISES

    name: str = Field(pattern=r"^[a-z][a-z0-9_]*$")  # in records, tags and folders' names


class SearchSettings(ComponentConfig, frozen=True, extra="forbid"):
    """The group `search`: the class that decides which trees are evaluated."""

    needs = SEARCHES

    name: str = Field(pattern=r"^[a-z][a-z0-9_]*$")  # in tags and tables
    ranking: Literal["evidence", "fitness"] = "evidence"
    """Which trees race for the best robot: those with the best evidence over all generations, or
    the fittest of each generation and of each behaviour."""

    @field_validator("factory")
    @classmethod
    def _is_a_search(cls, factory: Any) -> Any:
        uses = getattr(factory, "uses", None)
        if not (isinstance(uses, frozenset) and uses <= USES):
            words = ", ".join(map(repr, sorted(USES)))
            raise ValueError(
                f"expected {factory!r} with a class attribute uses, a frozenset of some of {words},"
                f" found {uses!r}"
            )
        if not hasattr(factory, "Memory"):
            raise ValueError(
                f"expected {factory!r} with a class attribute Memory, the type of the state that a"
                " checkpoint keeps, found none"
            )
        return factory


PAPERS: Final = {"name": "paper", "factory": "islandgp.search.paper:Paper", "ranking": "fitness"}
"""The search of configurations that name none: those of versions before 0.3."""


OLDER_NAMES: Final = {
    "best": "validation_mean",
    "trained": "champion_fitness",
    "final_best": "final_fitness_max",
    "final_mean": "final_fitness_mean",
}
"""Objectives by the names of versions before 0.3."""


class EvaluatorSettings(ComponentConfig, frozen=True, extra="forbid"):
    """The group `evaluator`."""

    cache: bool


class TrackingSettings(ComponentConfig, frozen=True, extra="forbid"):
    """The group `tracking`."""


class Settings(BaseModel, frozen=True, extra="forbid"):
    """One run."""

    seed: int = Field(ge=0, lt=2**63)
    name: str = Field(pattern=NAME, max_length=60)
    runs: str = Field(min_length=1)
    resume: Literal["auto", "never", "force"]
    progress: Literal["auto", "plain", "off"]
    tags: dict[Annotated[str, Field(pattern=TAG)], str | int | float | bool] = Field(
        default_factory=dict
    )
    objectives: tuple[str, ...] = Field(("validation_mean",), min_length=1)  # of `values`
    start: str | None = Field(None, min_length=1)  # a run whose archive opens generation 0
    domain: DomainSettings
    world: Any  # the domain's own World
    rewards: Any  # the domain's own Rewards
    curriculum: Curriculum
    classes: Classes
    library: LibrarySettings
    allocation: Allocation
    gp: GP
    budget: Budget = Budget()
    stop: Stop = Stop()
    search: SearchSettings = SearchSettings.model_validate(PAPERS)
    archive: ArchiveSettings = ArchiveSettings()
    perturb: Perturbation | None = None  # worlds a little different: docs/domains.md
    constraints: dict[str, Bound] = Field(default_factory=dict)  # limits by counter of the domain
    supervisor: SupervisorSettings
    evaluator: EvaluatorSettings
    tracking: TrackingSettings

    @field_validator("objectives", mode="before")
    @classmethod
    def _older_names(cls, names: Any) -> Any:
        older = isinstance(names, (list, tuple)) and all(isinstance(n, str) for n in names)
        return [OLDER_NAMES.get(name, name) for name in names] if older else names

    @field_validator("constraints", mode="before")
    @classmethod
    def _none_are_none(cls, constraints: Any) -> Any:
        return {} if constraints is None else constraints

    @field_validator("world", "rewards", mode="plain")
    @classmethod
    def _of_the_domain(cls, value: Any, found: ValidationInfo) -> Any:
        if (domain := found.data.get("domain")) is None:
            return value  # its own error is told
        model = domain.factory.World if found.field_name == "world" else domain.factory.Rewards
        return model.model_validate(value)  # its errors become errors of this field

    @model_validator(mode="after")
    def _fits_together(self) -> Self:
        if self.gp.tournament > self.gp.population:
            raise ValueError(
                f"gp.tournament: expected at most gp.population={self.gp.population},"
                f" found {self.gp.tournament}"
            )
        if self.supervisor.lag >= self.gp.generations:
            raise ValueError(
                f"supervisor.lag: expected less than gp.generations={self.gp.generations},"
                f" found {self.supervisor.lag}"
            )
        if self.supervisor.edits > self.gp.population - 3:
            raise ValueError(
                f"supervisor.edits: expected at most gp.population - 3 = {self.gp.population - 3}"
                f" slots, found {self.supervisor.edits}"
            )
        if taken := [tag for tag in self.tags if tag in OWN_TAGS or tag.startswith(MACHINES_TAGS)]:
            raise ValueError(
                f"tags.{taken[0]}: expected a name of your own, found one that every run has;"
                " take another one"
            )
        if self.start is not None and self.gp.founders:
            raise ValueError(
                "gp.founders: expected one source of trees that open the population, found start"
                " as well; leave one of the two out"
            )
        known = {*VALUES, *(f"first.{name}" for name in self.classes.milestones)}
        for name in self.objectives:
            if name not in known:
                raise ValueError(
                    f"objectives: expected names among {', '.join(sorted(known))}, found {name}"
                )
        if self.stop.tier is not None and self.stop.tier not in self.classes.tiers:
            raise ValueError(
                f"stop.tier: expected one of {', '.join(self.classes.tiers)},"
                f" found {self.stop.tier!r}"
            )
        mutations = {"gp.mutation": self.gp.mutation}
        if isinstance(how := getattr(self.search.settings(), "breeding", None), Breeding):
            mutations["search.policy.breeding.mutation"] = how.mutation
        for path, mutation in mutations.items():
            check_growth(self.gp.trees, self.gp.limits, mutation.subtree_depth, path)
        return self

    def make_domain(self) -> Domain:
        """The domain with its world and rewards. Raises ConfigError where they do not fit."""
        factory = self.domain.factory
        with plugin_errors(path_of(factory)):
            domain: Domain = factory.make(self.world, self.rewards)
            schema = getattr(domain, "schema", None)
            if not isinstance(schema, Schema):
                found = "none" if schema is None else type(schema).__name__
                raise ConfigError(
                    f"domain.factory: expected {path_of(factory)} with a schema that is a Schema,"
                    f" found {found}{defined_in(factory)}"
                )
        return domain

    def problem(self, *, perturbed: bool | None = None) -> Problem:
        """What trees are evaluated in: the domain, and the worlds of the curriculum's stages.

        `perturbed`: whether episodes run in perturbed worlds, of which there must be some; None:
        as in training.
        """
        factory = self.domain.factory
        how = self.perturb
        wanted = (how is not None and how.training) if perturbed is None else perturbed
        with plugin_errors(path_of(factory)):
            return Problem.of(
                factory, self.world, self.rewards, self.curriculum, how if wanted else None
            )

    def plan(self, domain: Domain) -> Plan:
        """What evolution needs of it."""
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
        settings = Settings(**with_generations(config))
    except ValidationError as error:
        raise ConfigError("\n".join(sorted(set(_lines(error, config))))) from None
    wrong = list(_counted(config, settings)) or list(_faults(settings))
    if wrong:
        raise ConfigError("\n".join(wrong))
    return settings


def with_generations(config: Mapping[str, Any]) -> Mapping[str, Any]:
    """The configuration with `gp.generations` as `budget.episodes` allows, if that is set.

    A configuration whose values cannot be read is returned as it is: reading it reports them.
    """
    try:
        budget = Budget(**config["budget"])
        if budget.episodes is None:
            return config
        gp = GP(**config["gp"])
    except (KeyError, TypeError, ValidationError):
        return config
    try:
        found = budget.generations(gp.population, gp.episodes, gp.validation)
    except ValueError as error:
        raise ConfigError(str(error)) from None
    return {**config, "gp": {**config["gp"], "generations": found}}


def _faults(settings: Settings) -> Iterator[str]:
    """A line for each name that the domain does not declare."""
    schema = settings.make_domain().schema
    yield from _staged_worlds(settings, schema)
    if isinstance(settings.rewards, RewardTable):
        yield from settings.rewards.faults(schema)
    yield from settings.curriculum.faults(schema)
    yield from settings.classes.faults(schema)
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
    """A line for each stage whose world cannot be, or speaks another language."""
    for i, stage in enumerate(settings.curriculum.stages):
        if not stage.world:
            continue
        path, before = f"curriculum.stages.{i}.world", settings.world.model_dump()
        try:
            world = staged(settings.world, stage.world)
        except ValidationError as error:
            given = {**before, **stage.world}
            yield from _lines(error, given, model=type(settings.world), at=(path,))
            continue
        with plugin_errors(path_of(settings.domain.factory)):
            found = settings.domain.factory.make(world, settings.rewards).schema
        if (found.vocabulary, *map(tuple, (found.components, found.counters))) != (
            schema.vocabulary,
            *map(tuple, (schema.components, schema.counters)),
        ):
            yield (
                f"{path}: expected the same actions, keys, components and counters in every"
                " stage, found others; leave them out of the stage"
            )


def _counted(config: Any, settings: Any, path: str = "") -> Iterator[str]:
    """A line for each `true` or `false` that was taken for the number 1 or 0."""
    if isinstance(config, bool):
        if isinstance(settings, int | float) and not isinstance(settings, bool):
            word = str(config).lower()
            yield f"{path}={word}: input should be a number, found {word}"
    elif isinstance(config, Mapping):
        for key, value in config.items():
            yield from _counted(
                value, setting_at(settings, key), f"{path}.{key}" if path else str(key)
            )
    elif isinstance(config, list) and isinstance(settings, tuple | list):
        for i, (value, inner) in enumerate(zip(config, settings, strict=False)):
            yield from _counted(value, inner, f"{path}.{i}")


def setting_at(settings: Any, key: int | str) -> Any:
    """What stands at a key of the configuration, or what it became; None for nothing."""
    if isinstance(settings, ComponentConfig) and key == "policy":
        return settings.settings()
    if isinstance(settings, Mapping):
        return settings.get(key)
    if isinstance(settings, list):
        return settings[key] if isinstance(key, int) else None
    return getattr(settings, str(key), None)


def _lines(
    error: ValidationError,
    config: Mapping[str, Any],
    *,
    model: type[BaseModel] = Settings,
    at: tuple[str, ...] = (),
) -> Iterator[str]:
    """A line for each error of `model`, which was made of `config` and stands at the path `at`."""
    found = error.errors()
    inside = {e["loc"][:n] for e in found for n in range(len(e["loc"]))}
    for e in found:
        if e["type"] == "too_short" and e["loc"] in inside:
            continue  # what is wrong in an item is not counted
        if e["loc"][0:1] == ("tags",) and e["loc"][-1] != "[key]":
            name = f"tags.{e['loc'][1]}" if e["loc"][1:] else "tags"
            given = f"{name}={e['input']!r}"
            yield f"{given}: expected text, a number, true or false; give one of these"
            continue
        path = ".".join(str(part) for part in (*at, *e["loc"]))
        message = e["msg"].removeprefix("Value error, ")
        if e["type"] == "extra_forbidden":
            yield unknown_key(path, keys_at(config, e["loc"][:-1], model))
        elif (words := IN_WORDS.get(e.get("ctx", {}).get("pattern", ""))) is not None:
            yield f"{path.removesuffix('.[key]')}: expected {words}, found {e['input']!r}"
        elif e["type"] == "missing":
            yield f"{path}: expected a value, found none"
        elif e["type"] == "value_error":
            colon = "." if re.match(r"[a-z0-9_.]+: ", message) else ": "  # it begins with a key
            yield f"{path}{colon}{message}" if path else message
        else:
            yield f"{path}={e['input']!r}: {message[0].lower()}{message[1:]}"


def keys_at(
    config: Mapping[str, Any], path: Sequence[int | str], model: type[BaseModel] = Settings
) -> list[str]:
    """The keys that may be at a path below `model`: a model's fields, else those of `config`."""
    kind: Any = model
    found: Any = config
    for part in path:
        kind = _kind_below(kind, part, found)
        found = setting_at(found, part)
    if isinstance(kind, type) and issubclass(kind, BaseModel):
        return [*kind.model_fields]
    given = map(str, found) if isinstance(found, Mapping) else ()
    return [key for key in given if not key.startswith("_")]


def _kind_below(kind: Any, part: int | str, config: Any) -> Any:
    """The type at a key of a type; None where it is not known."""
    if isinstance(kind, type) and issubclass(kind, BaseModel):
        if kind is Settings and part in ("world", "rewards"):
            return getattr(_factory(setting_at(config, "domain")), str(part).capitalize(), None)
        if issubclass(kind, ComponentConfig) and part == "policy":
            return getattr(_factory(config), "Settings", None)
        field = kind.model_fields.get(str(part))
        kind = field and field.annotation
    else:
        inner = [a for a in get_args(kind) if a is not Ellipsis]
        kind = inner[-1] if inner else None  # of dict[str, kind] or tuple[kind, ...]
    models = [a for a in get_args(kind) if isinstance(a, type) and issubclass(a, BaseModel)]
    union = get_origin(kind) in (Union, UnionType)
    return models[0] if union and models else kind


def _factory(part: Any) -> Any:
    """The class that a group names; None where there is none."""
    try:
        return imported(str(setting_at(part, "factory")))
    except (ValidationError, IslandError):
        return None


def unknown_key(path: str, known: list[str]) -> str:
    """The line for a key that does not exist, with the nearest one that does."""
    parent, _, key = path.rpartition(".")
    known = [other for other in known if other != key]
    near = get_close_matches(key, known, 1, 0.5)
    dot = f"{parent}." if parent else ""
    there = f"there are {', '.join(sorted(known))}" if known else f"{parent} has no keys"
    hint = f"did you mean {dot}{near[0]}?" if near else there
    return f"{path}: unknown key; {hint}"
