"""Options that several commands share."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, fields
from functools import wraps
from pathlib import Path
from typing import Any, Final

import click

from islandgp.commands.files import OUTPUT, STDIN
from islandgp.gate import user_folder

Command = Callable[..., None]
Decorator = Callable[[Command], Command]

TIMEOUT: Final = 30  # s


@dataclass(frozen=True, slots=True)
class DomainOptions:
    """The options of a command that choose a domain, and how episodes run in it."""

    overrides: tuple[str, ...] = ()
    config_dir: Path | None = None
    declaration: str | None = None  # a file that declares the vocabulary instead
    run: Path | None = None  # a run's folder, whose settings are used
    stage: int | None = None  # from 1; None: the last
    timeout: int = TIMEOUT  # s of an episode; 0: none


def grouped(name: str, kind: type, *options: Decorator) -> Decorator:
    """A decorator that adds options to a command and passes their values as one argument.

    Args:
        name: of the argument.
        kind: dataclass whose fields are named like the options' values.
        *options: Click's decorators.
    """

    def decorate(command: Command) -> Command:
        @wraps(command)
        def runs(**arguments: Any) -> None:
            names = [field.name for field in fields(kind) if field.name in arguments]
            command(**{name: kind(**{n: arguments.pop(n) for n in names})}, **arguments)

        decorated: Command = runs
        for option in options:
            decorated = option(decorated)
        return decorated

    return decorate


config_dir_option = click.option(
    "--config-dir",
    type=click.Path(exists=True, file_okay=False, path_type=Path),
    help="Folder with your configuration, which names domains and servers.",
)
DOMAIN: Final = (
    config_dir_option,
    click.option(
        "--set",
        "overrides",
        multiple=True,
        metavar="KEY=VALUE",
        help="Override of the configuration, as for a run, e.g. --set domain=NAME."
        " Default: the domain that the tree's file names, or the project's.",
    ),
)
VOCABULARY: Final = click.option(
    "--vocabulary",
    "declaration",
    type=click.Path(exists=True, dir_okay=False),
    help="Vocabulary of a robot that is not configured here: JSON of `islandgp domain --json`,"
    " or BehaviorTree.CPP XML with a TreeNodesModel.",
)
TIMEOUT_OPTION: Final = click.option(
    "--timeout",
    type=click.IntRange(0),
    default=TIMEOUT,
    help="Time limit of an episode in seconds; 0: none.",
)
EPISODES: Final = (
    TIMEOUT_OPTION,
    click.option(
        "--stage",
        type=click.IntRange(1),
        help="Stage of the curriculum (Table 2 of the paper) that scores the episode, from 1;"
        " default: the last.",
    ),
    click.option(
        "--run",
        type=click.Path(exists=True, file_okay=False, path_type=Path),
        help="Folder of a run whose world and settings are used; default: the one of the tree.",
    ),
)

with_workers_option = click.option(
    "--workers", type=click.IntRange(0, 1024), default=0, help="Processes; 0: one per core."
)
with_output_option = click.option(
    "-o", "--output", type=OUTPUT, default=STDIN, help="File to write; -: the standard output."
)

with_domain_options = grouped("options", DomainOptions, TIMEOUT_OPTION, *DOMAIN)
"""Adds --set, --config-dir and --timeout."""
with_vocabulary_options = grouped("options", DomainOptions, VOCABULARY, *DOMAIN)
"""Adds --set, --config-dir and --vocabulary."""
with_episode_options = grouped("options", DomainOptions, *EPISODES, *DOMAIN)
"""Adds --set, --config-dir, --run, --stage and --timeout."""


def with_config_dir_option(command: Command) -> Command:
    """Adds --config-dir: the user's folder, whose domains and servers the command may use."""

    @wraps(command)
    def runs(*, config_dir: Path | None, **arguments: Any) -> None:
        with user_folder(config_dir):
            command(**arguments)

    return config_dir_option(runs)
