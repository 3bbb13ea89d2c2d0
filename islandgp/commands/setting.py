"""The domain and settings with which commands read and run a tree."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Sequence
from contextlib import closing, contextmanager
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Final

from islandgp.atomic_files import reading
from islandgp.bt.core.language import domain_of, domain_place
from islandgp.bt.core.node import Node
from islandgp.bt.core.source import Source, plain, shown
from islandgp.commands.files import TreeText, read_text, read_tree_text
from islandgp.commands.options import DomainOptions
from islandgp.domain import Outcome
from islandgp.errors import ConfigError, EvaluationError, OtherDomainError, RunError
from islandgp.gate import must_be_known_code, user_folder
from islandgp.installed import domain_files
from islandgp.records.folder import RunFolder
from islandgp.resources import resource

if TYPE_CHECKING:
    from islandgp.bt.core.vocabulary import Vocabulary
    from islandgp.config.compose import Planned
    from islandgp.config.settings import Settings
    from islandgp.evaluation.base import Evaluator, Problem

QUICK: Final = ("tracking=off", "supervisor=baseline")
"""Components that no episode needs, replaced by those that are fast to load."""

RECORDED: Final = ["domain", "world", "rewards", "curriculum", "classes", "constraints", "perturb"]
"""Keys of a run's configuration on which its episodes, tiers and constraints depend."""

_CHOOSES: Final = frozenset({"domain", "experiment", "domain.factory"})
"""Keys of the configuration that choose the domain."""


def configured(overrides: Sequence[str], config_dir: str | Path | None = None) -> Settings:
    """The settings of a run with these overrides. Raises ConfigError."""
    return _job(overrides, config_dir).settings


def _job(overrides: Sequence[str], config_dir: str | Path | None) -> Planned:
    from islandgp.config.compose import only_job

    keys = _keys_of(overrides)
    quick = [word for word in QUICK if word.partition("=")[0] not in keys]
    return only_job([*quick, *overrides], config_dir)


_job_of_trees = cache(_job)  # the job for trees, composed once for all files of a command


def settings_of(source: TreeText, options: DomainOptions) -> Settings:
    """The settings for a tree: those of a run, or of the domain that options or text choose.

    The run is that of --run, or the one in whose folder the tree is: what its episodes depend on is
    as recorded, unless --set changes it.

    Raises:
        ConfigError, DomainError: the configuration is invalid, or has no domain of this name.
        RunError: the run is damaged, or names code that the user's configuration does not name.
    """
    run, overrides = options.run or source.folder or Path(), _for_tree(source, options)
    names = ("about.json", "config.yaml")
    is_run = options.run is not None or all((run / name).is_file() for name in names)
    if is_run and not _keys_of(overrides) & _CHOOSES:
        about = RunFolder(run).about()
        domain = about.tags.get("domain") if about else None
        if domain in domain_files(options.config_dir):
            overrides = (*overrides, f"domain={domain}")
    job = _job_of_trees(overrides, options.config_dir)
    return _as_recorded(run, job, options) if is_run else job.settings


def _as_recorded(run: Path, job: Planned, options: DomainOptions) -> Settings:
    """The settings of a job with the recorded values of a run, unless an option gives others."""
    from islandgp.config.settings import read_settings

    folder, given = RunFolder(run), _keys_of(options.overrides)
    if not (config := folder.configuration()):
        raise RunError(f"Expected a run in {run}, found none; give a run's own folder.")
    config = {key: config.get(key) for key in RECORDED if key not in given}
    with user_folder(options.config_dir):
        must_be_known_code(config)
    with reading("a run's configuration", run / "config.yaml"):
        for group, *inner, name in (key.split(".") for key in given if "." in key):
            if group in config:
                old, new = config[group], job.config[group]
                for part in inner:
                    old, new = old[part], new[part]
                old[name] = new[name]
    return read_settings({**job.config, **config})


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
    from islandgp.evaluation.perturbation import staged

    settings = settings_of(source, options)
    domain = settings.make_domain()
    if not in_world:
        return domain.schema.vocabulary
    stages = settings.curriculum.stages
    return domain.vocabulary_in([staged(settings.world, stage.world) for stage in stages])


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


TIME_LIMIT: Final = r"evaluator\b.*\bepisode_timeout\b"  # of a run; of commands, --timeout

CHUNK: Final = 16  # worlds between two steps of the progress bar

Trials = Callable[[Sequence[str | Node], Sequence[int]], list[list[Outcome]]]
"""A function that returns the outcomes of each tree in each world."""


@dataclass(frozen=True, slots=True)
class TreeTask:
    """A tree of a file, with the settings and the problem for its episodes."""

    source: TreeText
    tree: Node  # marked
    settings: Settings
    problem: Problem
    stage: int  # of the curriculum, from 0
    timeout: float  # s of an episode; 0: none

    @contextmanager
    def trials(self, episodes: int) -> Iterator[Trials]:
        """A context with `Trials` for about so many episodes, with a progress bar on a terminal.

        If the configuration perturbs worlds, episodes run in perturbed ones.
        """
        from rich.console import Console
        from rich.progress import Progress

        from islandgp.evaluation.base import TREE_INTRODUCTION, evaluated
        from islandgp.evaluation.serial import Serial
        from islandgp.running.parts import make_evaluator

        evaluator = self.settings.evaluator
        made: Evaluator
        if episodes < 12:  # faster than starting processes
            problem = self.settings.problem(perturbed=True)
            made = Serial(problem, episode_timeout=self.timeout)
        else:
            policy = {**evaluator.policy, "episode_timeout": self.timeout}
            changed = {"evaluator": evaluator.model_copy(update={"policy": policy})}
            made = make_evaluator(self.settings.model_copy(update=changed), perturbed=True)
        console = Console(stderr=True)
        bar = Progress(console=console, disable=not console.is_terminal, transient=True)
        task = bar.add_task("episodes", total=episodes)

        def outcomes(trees: Sequence[str | Node], worlds: Sequence[int]) -> list[list[Outcome]]:
            by_tree: list[list[Outcome]] = [[] for _ in trees]
            for start in range(0, len(worlds), CHUNK):
                chunk = worlds[start : start + CHUNK]
                try:
                    results = evaluated(made, trees, self.stage, chunk)
                except EvaluationError as error:  # the tree is that of the file
                    raise EvaluationError(str(error).partition(TREE_INTRODUCTION)[0]) from error
                for known, new in zip(by_tree, results, strict=True):
                    known += new
                bar.advance(task, len(trees) * len(chunk))
            return by_tree

        with closing(made), bar:
            yield outcomes


def tree_task(file: str, options: DomainOptions, unread: str = TIME_LIMIT) -> TreeTask:
    """The tree in a file, ready for episodes.

    `unread`: matches the keys of the configuration that the command does not read.

    Raises:
        ConfigError, DomainError: the configuration is invalid, or the tree is for another domain.
        RunError: as `settings_of`.
        TreeError: the file is not a tree of the domain.
    """
    source = read_tree_text(file)
    for override in options.overrides:
        if re.match(unread, override.lstrip("+")):
            raise ConfigError(
                f"--set {override}: expected a key that this command reads, found one without"
                " effect; leave it out. --timeout SECONDS limits an episode."
            )
    settings = settings_of(source, options)
    problem = settings.problem()
    stages = len(settings.curriculum.stages)
    if options.stage is not None and options.stage > stages:
        raise ConfigError(f"--stage: expected 1 to {stages}, found {options.stage}")
    tree = source.tree(problem.domain.schema.vocabulary, marked=True)
    stage = (options.stage or stages) - 1
    return TreeTask(source, tree, settings, problem, stage, options.timeout)
