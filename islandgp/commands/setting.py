"""The domain and settings with which commands read and run a tree."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Final

from islandgp.bt.core.language import domain_of, domain_place
from islandgp.bt.core.source import Source, plain, shown
from islandgp.commands.files import TreeText, read_text, read_tree_text
from islandgp.commands.options import DomainOptions
from islandgp.domain_files import domain_class, domain_files
from islandgp.errors import ConfigError, IslandError, OtherDomainError
from islandgp.resources import resource

if TYPE_CHECKING:
    from islandgp.bt.core.node import Node
    from islandgp.bt.core.vocabulary import Vocabulary
    from islandgp.config.settings import Settings

_QUICK: Final = {"tracking": "off", "supervisor": "baseline"}
"""Components that no episode needs, replaced by those that are fast to load."""

_CHOOSES: Final = frozenset({"domain", "experiment", "domain.factory"})
"""Keys of the configuration that choose the domain."""


def configured(overrides: Sequence[str], config_dir: str | None = None) -> Settings:
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
            f"unknown domain {shown(domain)}",
            *domain_place(source.text),
            expected=f"a domain that is configured ({domains}); give --config-dir FOLDER with a"
            f" file domain/{domain}.yaml in it, or choose a domain by --set domain=NAME",
            kind=OtherDomainError,
        )
    return (*options.overrides, f"domain={domain}")


def configured_domains(config_dir: str | None) -> list[str]:
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
def _vocabulary(overrides: tuple[str, ...], config_dir: str | None, in_world: bool) -> Vocabulary:
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
    overrides: Sequence[str], config_dir: str | None, in_world: bool
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
