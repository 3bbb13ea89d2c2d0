"""The domain and settings with which commands read and run a tree."""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from contextlib import closing, contextmanager, suppress
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Final

from islandgp.bt.core.language import domain_of, domain_place
from islandgp.bt.core.node import Node
from islandgp.bt.core.source import Source, plain, shown
from islandgp.commands.files import TreeText, read_text, read_tree_text
from islandgp.commands.options import DomainOptions, EpisodeOptions
from islandgp.domain import Outcome
from islandgp.errors import ConfigError, EvaluationError, IslandError, OtherDomainError
from islandgp.installed import domain_class, domain_files
from islandgp.resources import resource

if TYPE_CHECKING:
    from rich.progress import Progress

    from islandgp.bt.core.node import Node
    from islandgp.bt.core.vocabulary import Vocabulary
    from islandgp.config.settings import Settings
    from islandgp.evaluation.base import Evaluator, Problem
    from islandgp.viewer.recording import Recording

_QUICK: Final = {"tracking": "off", "supervisor": "baseline"}
"""Components that no episode needs, replaced by those that are fast to load."""

_CHOOSES: Final = frozenset({"domain", "experiment", "domain.factory"})
"""Keys of the configuration that choose the domain."""


def configured(overrides: Sequence[str], config_dir: str | Path | None = None) -> Settings:
    """The settings of a run with these overrides. Raises ConfigError."""
    from islandgp.config.compose import only_job

    keys = _keys_of(overrides)
    quick = [f"{group}={part}" for group, part in _QUICK.items() if group not in keys]
    return only_job([*quick, *overrides], config_dir).settings


def settings_of(source: TreeText, options: DomainOptions) -> Settings:
    """The settings of the domain chosen by the options or the text.

    Raises:
        ConfigError, DomainError: the configuration is invalid, or has no domain of this name.
    """
    return configured(_for_tree(source, options), options.config_dir)


def read_in_domain(
    file: str, options: DomainOptions, *, marked: bool = False
) -> tuple[str, Vocabulary, Node]:
    """The text of a tree file, the vocabulary of its domain, and the parsed tree.

    Raises:
        ConfigError, DomainError, TreeError: as `vocabulary_of` and `parse`.
    """
    source = read_tree_text(file)
    vocabulary = vocabulary_of(source, options)
    return source.text, vocabulary, source.tree(vocabulary, marked=marked)


def vocabulary_of(
    source: TreeText, options: DomainOptions, *, in_world: bool = False
) -> Vocabulary:
    """The vocabulary of the domain that the options or the text of a tree name.

    `in_world`: with the conditions of actions that hold in the configured worlds, in addition to
    those that hold in every world.

    Raises:
        ConfigError, DomainError: the configuration is invalid, or the file declares no vocabulary.
        TreeError: the file is not XML, or the text is no tree.
    """
    if (file := options.declaration) is not None:
        from islandgp.bt.export.declared import declared

        text, name, folder = source
        return declared(read_text(file), text, name=file, tree_name=name, folder=folder)
    return _vocabulary(_for_tree(source, options), options.config_dir, in_world)


def _for_tree(source: TreeText, options: DomainOptions) -> tuple[str, ...]:
    """The overrides, with the domain named by the text of a tree unless they choose one.

    Raises:
        ConfigError: an override is not KEY=VALUE.
        OtherDomainError: no configuration has the domain of the text.
    """
    domain = domain_of(source.text)
    if not domain or _keys_of(options.overrides) & _CHOOSES:
        return options.overrides
    if domain not in domain_files(options.config_dir):
        domains = ", ".join(configured_domains(options.config_dir))
        raise Source(plain(source.text), source.name).error(
            domain_place(source.text),
            f"unknown domain {shown(domain)}",
            f"a domain that is configured ({domains}); give --config-dir FOLDER with a"
            f" file domain/{domain}.yaml in it, or choose a domain by --set domain=NAME",
            kind=OtherDomainError,
        )
    return (*options.overrides, f"domain={domain}")


def configured_domains(config_dir: str | Path | None) -> list[str]:
    """The names of the configured domains."""
    return sorted(domain_files(config_dir))


def domain_file(name: str, options: DomainOptions) -> Path:
    """The configuration file of a domain; for "", of the domain chosen by the options.

    Raises ConfigError if there is none.
    """
    overrides = [word.lstrip("+").partition("=") for word in options.overrides]
    named = [value for key, _, value in overrides if key == "domain"]
    name = name or (named[-1] if named else default_domain())
    files = domain_files(options.config_dir)
    if name not in files:
        from islandgp.config.errors import unknown_option

        raise ConfigError(unknown_option("domain", name, sorted(files)))
    return files[name]


def default_domain() -> str:
    """The default domain of commands."""
    import yaml

    first = yaml.safe_load((resource("conf") / "config.yaml").read_text(encoding="utf-8"))
    group_defaults = [group for group in first["defaults"] if isinstance(group, dict)]
    return next(str(group["domain"]) for group in group_defaults if "domain" in group)


def _keys_of(overrides: Sequence[str]) -> set[str]:
    """The keys of overrides. Raises ConfigError."""
    for override in overrides:
        if "=" not in override:
            raise ConfigError(f"--set: expected KEY=VALUE, found {override!r}")
    return {override.lstrip("+").partition("=")[0] for override in overrides}


@cache
def _vocabulary(
    overrides: tuple[str, ...], config_dir: str | Path | None, in_world: bool
) -> Vocabulary:
    if _keys_of(overrides) <= {"domain"}:
        name = overrides[-1].partition("=")[2] if overrides else default_domain()
        # Composing the whole configuration reports errors of the class or its file better.
        with suppress(Exception):
            kind = domain_class(name, config_dir)
            declared: Vocabulary = kind.schema.vocabulary
            if not in_world or not hasattr(kind, "vocabulary_in"):
                return declared
            with suppress(IslandError):  # errors of a world do not matter for a tree's text
                return _configured_vocabulary(overrides, config_dir, in_world)
            return declared
    return _configured_vocabulary(overrides, config_dir, in_world)


def _configured_vocabulary(
    overrides: Sequence[str], config_dir: str | Path | None, in_world: bool
) -> Vocabulary:
    """The vocabulary of a composed configuration's domain, as for `vocabulary_of`."""
    from islandgp.evaluation.perturbation import staged

    settings = configured(overrides, config_dir)
    domain = settings.make_domain()
    words_in = getattr(domain, "vocabulary_in", None) if in_world else None
    if words_in is None:
        return domain.schema.vocabulary
    stages = settings.curriculum.stages
    vocabulary: Vocabulary = words_in([staged(settings.world, stage.world) for stage in stages])
    return vocabulary


CHUNK = 16  # worlds between two steps of the progress bar


@dataclass(frozen=True, slots=True)
class TreeTrials:
    """A tree of a file, and episodes in its domain."""

    source: TreeText
    tree: Node
    settings: Settings
    problem: Problem
    stage: int  # of the curriculum, from 0
    _evaluator: Evaluator
    _bar: Progress

    def outcomes(self, trees: Sequence[str | Node], worlds: Sequence[int]) -> list[list[Outcome]]:
        """The outcomes of each tree in each world."""
        from islandgp.evaluation.base import TREE_INTRODUCTION, evaluated

        by_tree: list[list[Outcome]] = [[] for _ in trees]
        for start in range(0, len(worlds), CHUNK):
            chunk = worlds[start : start + CHUNK]
            try:
                results = evaluated(self._evaluator, trees, self.stage, chunk)
            except EvaluationError as error:  # the tree is that of the file
                raise EvaluationError(str(error).partition(TREE_INTRODUCTION)[0]) from error
            for known, new in zip(by_tree, results, strict=True):
                known += new
            self._bar.advance(self._bar.task_ids[0], len(trees) * len(chunk))
        return by_tree


def _prepared(file: str, episode: EpisodeOptions) -> tuple[TreeText, Node, Settings, Problem, int]:
    """The text of a file, its marked tree, the settings of its domain, its problem and the stage.

    Raises:
        ConfigError, DomainError: the configuration is invalid, or the tree is for another domain.
        TreeError: the file is not a tree of the domain.
    """
    source = read_tree_text(file)
    for override in episode.options.overrides:
        if re.match(r"\+*evaluator\b.*\bepisode_timeout\b", override):
            raise ConfigError(
                f"--set {override}: expected --timeout SECONDS in its place, found no effect"
            )
    settings = settings_of(source, episode.options)
    problem = settings.problem()
    stages = len(settings.curriculum.stages)
    if episode.stage is not None and episode.stage > stages:
        raise ConfigError(f"--stage: expected 1 to {stages}, found {episode.stage}")
    tree = source.tree(problem.domain.schema.vocabulary, marked=True)
    return source, tree, settings, problem, (episode.stage or stages) - 1


def recorded(file: str, seed: int, episode: EpisodeOptions) -> Recording:
    """The recording of an episode of the tree in a file, in the world of `seed`.

    Raises:
        IslandError: as `tree_trials` and `viewer.recording.record`.
    """
    from islandgp.viewer.recording import record

    _, tree, _, problem, stage = _prepared(file, episode)
    return record(tree, problem, seed=seed, stage=stage, limit=episode.timeout)


@contextmanager
def tree_trials(file: str, episode: EpisodeOptions, episodes: int) -> Iterator[TreeTrials]:
    """The tree in a file, ready for about so many episodes, with a progress bar on a terminal.

    If the configuration perturbs worlds, episodes run in perturbed ones.

    Raises:
        ConfigError, DomainError: the configuration is invalid, or the tree is for another domain.
        TreeError: the file is not a tree of the domain.
    """
    from rich.console import Console
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn

    from islandgp.evaluation.serial import Serial
    from islandgp.running.parts import make_evaluator

    source, tree, settings, problem, stage = _prepared(file, episode)
    perturbed, evaluator = settings.perturb is not None, settings.evaluator
    made: Evaluator
    if episodes < 12:  # faster than starting processes
        made = Serial(settings.problem(perturbed=perturbed), episode_timeout=episode.timeout)
    else:
        policy = {**evaluator.policy, "episode_timeout": episode.timeout}
        changed = {"evaluator": evaluator.model_copy(update={"policy": policy})}
        made = make_evaluator(settings.model_copy(update=changed), perturbed=perturbed)
    console = Console(stderr=True)
    columns = (BarColumn(20), MofNCompleteColumn(), TextColumn("episodes"))
    bar = Progress(*columns, console=console, disable=not console.is_terminal, transient=True)
    with closing(made), bar:
        bar.add_task("", total=episodes)
        yield TreeTrials(source, tree, settings, problem, stage, made, bar)
