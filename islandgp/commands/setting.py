"""The domain in which commands read and run a tree: the project's configuration, with changes."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import suppress
from functools import cache
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import click

from islandgp.bt.language import domain_of, parse
from islandgp.commands.files import called, folder_of, read_text
from islandgp.errors import ConfigError, DomainError
from islandgp.resources import resource

if TYPE_CHECKING:
    from islandgp.bt.node import Node
    from islandgp.bt.vocabulary import Vocabulary
    from islandgp.config.settings import Settings
    from islandgp.evaluation.base import Problem

_QUICK: Final = {"tracking": "off", "supervisor": "fixed"}
"""Parts that no episode needs: the ones that are quick to load."""

_CHOOSES: Final = frozenset({"domain", "experiment", "domain.factory"})
"""Keys of the configuration that choose the domain."""


def with_domain_options(command: Callable[..., None]) -> Callable[..., None]:
    """Adds --set and --config-dir: `configured` and `vocabulary_of` read them."""
    for option in (
        click.option(
            "--config-dir",
            type=click.Path(exists=True, file_okay=False),
            help="Your own folder of configuration, beside the project's.",
        ),
        click.option(
            "--set",
            "overrides",
            multiple=True,
            metavar="KEY=VALUE",
            help="Another configuration, as for a run, e.g. --set domain=NAME."
            " Default: the domain that the tree's file names, or the project's.",
        ),
    ):
        command = option(command)
    return command


def with_vocabulary_option(command: Callable[..., None]) -> Callable[..., None]:
    """Adds --vocabulary: `vocabulary_of` reads it."""
    return click.option(
        "--vocabulary",
        "declaration",
        type=click.Path(exists=True, dir_okay=False),
        help="The words of a robot that is not configured here: JSON of `islandgp domain --json`,"
        " or BehaviorTree.CPP XML with a TreeNodesModel.",
    )(command)


def with_stage_option(command: Callable[..., None]) -> Callable[..., None]:
    """Adds --stage: `stage_index` reads it."""
    return click.option(
        "--stage",
        type=click.IntRange(1),
        help="Stage of the curriculum (Table 2) that scores the episode, from 1; default: the"
        " last.",
    )(command)


def configured(overrides: Sequence[str], config_dir: str | None = None) -> Settings:
    """The settings that a run with these overrides has. Raises ConfigError."""
    from hydra._internal.utils import get_args_parser

    from islandgp.config.compose import planned

    given = _given(overrides)
    words = [f"{group}={part}" for group, part in _QUICK.items() if group not in given]
    words += overrides
    flags = ["--config-dir", config_dir] if config_dir is not None else []
    args: Any = get_args_parser().parse_args([*flags, *words])
    return next(planned(args, words, Path.cwd())).settings


def stage_index(settings: Settings, stage: int | None) -> int:
    """The index of a stage that people count from 1; None is the last. Raises ConfigError."""
    stages = len(settings.curriculum.stages)
    if stage is not None and stage > stages:
        raise ConfigError(f"--stage: expected 1 to {stages}, found {stage}")
    return (stage or stages) - 1


def tree_in_domain(
    file: str, overrides: Sequence[str], config_dir: str | None
) -> tuple[Node, Settings, Problem]:
    """The tree in a file, the settings of its domain, and what its episodes need.

    Raises:
        ConfigError, DomainError: the domain is not configured so, or is not the tree's.
        TreeError: the file holds no tree in the words of the domain.
    """
    text, name = read_text(file), called(file)
    settings = configured(for_tree(text, overrides, config_dir, name=name), config_dir)
    problem = settings.problem()
    tree = parse(text, problem.domain.schema.vocabulary, name=name, folder=folder_of(file))
    return tree, settings, problem


def vocabulary_of(
    text: str,
    overrides: Sequence[str],
    config_dir: str | None,
    *,
    name: str,
    declaration: str | None = None,
    folder: Path | None = None,
) -> Vocabulary:
    """The words of the domain that the overrides choose, or the text of a tree.

    `declaration` is a file that declares them instead; `folder`: of the tree's file.

    Raises:
        ConfigError, DomainError: the domain is not configured so, or the file declares none.
        TreeError: the file is not XML, or the text is no tree.
    """
    if declaration is not None:
        from islandgp.bt.declared import declared

        return declared(
            read_text(declaration), text, name=declaration, tree_name=name, folder=folder
        )
    return _vocabulary(for_tree(text, overrides, config_dir, name=name), config_dir)


def for_tree(
    text: str, overrides: Sequence[str], config_dir: str | None, *, name: str
) -> tuple[str, ...]:
    """The overrides with the domain that the text of a tree names, unless they choose one.

    Raises:
        ConfigError: an override is not KEY=VALUE.
        DomainError: no configuration has the domain of the text.
    """
    domain = domain_of(text)
    if not domain or _given(overrides) & _CHOOSES:
        return tuple(overrides)
    if _domain_file(domain, config_dir) is None:
        known = ", ".join(configured_domains(config_dir))
        raise DomainError(
            f"{name}: expected a tree for a domain that is configured ({known}), found one for"
            f" {domain!r}; give --config-dir FOLDER with a file domain/{domain}.yaml in it, or"
            " choose a domain by --set domain=NAME."
        )
    return (*overrides, f"domain={domain}")


def configured_domains(config_dir: str | None) -> list[str]:
    """The domains that a tree can be for."""
    return sorted({file.stem for d in _folders(config_dir) for file in d.glob("*.yaml")})


def default_domain() -> str:
    """The domain of a command that chooses none."""
    import yaml

    first = yaml.safe_load((resource("conf") / "config.yaml").read_text(encoding="utf-8"))
    chosen = [group for group in first["defaults"] if isinstance(group, dict)]
    return next(str(group["domain"]) for group in chosen if "domain" in group)


def _given(overrides: Sequence[str]) -> set[str]:
    """The keys of overrides. Raises ConfigError."""
    for override in overrides:
        if "=" not in override:
            raise ConfigError(f"--set: expected KEY=VALUE, found {override!r}")
    return {override.lstrip("+").partition("=")[0] for override in overrides}


def _folders(config_dir: str | None) -> list[Path]:
    """Where files of domains are, in the order in which Hydra looks."""
    return [resource("conf") / "domain", *([Path(config_dir) / "domain"] if config_dir else [])]


def _domain_file(domain: str, config_dir: str | None) -> Path | None:
    files = (folder / f"{domain}.yaml" for folder in _folders(config_dir))
    return next((file for file in files if file.is_file()), None)


@cache
def _vocabulary(overrides: tuple[str, ...], config_dir: str | None) -> Vocabulary:
    quick = None
    if _given(overrides) <= {"domain"}:
        name = overrides[-1].partition("=")[2] if overrides else default_domain()
        # Whatever is wrong with the class or its file, the whole configuration tells it better.
        with suppress(Exception):
            quick = _declared(name, config_dir)
    if quick is not None:
        return quick
    return configured(overrides, config_dir).make_domain().schema.vocabulary


def _declared(domain: str, config_dir: str | None) -> Vocabulary | None:
    """The vocabulary that the class of a domain declares, without composing a configuration.

    None where its schema depends on settings.
    """
    import yaml

    from islandgp.domain import Schema

    file = _domain_file(domain, config_dir)
    if file is None:
        return None
    found = yaml.safe_load(file.read_text(encoding="utf-8"))
    module, _, attribute = found.get("domain", found)["factory"].partition(":")
    schema = getattr(getattr(import_module(module), attribute), "schema", None)
    return schema.vocabulary if isinstance(schema, Schema) else None
