"""The island on which commands run a tree: the project's configuration, with changes."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, Final

import click

from islandgp.commands.here import import_from_here
from islandgp.errors import ConfigError
from islandgp.settings import Settings

_QUICK: Final = {"tracking": "off", "supervisor": "fixed"}
"""Parts that no episode needs: the ones that are quick to load."""


def with_island_options(command: Callable[..., None]) -> Callable[..., None]:
    """Adds --set, --config-dir and --stage; `configured` and `stage_index` read them."""
    for option in (
        click.option(
            "--stage",
            type=click.IntRange(1),
            help="Row of Table 2 whose multipliers score the episode, from 1; default: the last.",
        ),
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
            help="Another configuration, as for a run: --set world.robot.speed=6.",
        ),
    ):
        command = option(command)
    return command


def configured(overrides: Sequence[str], config_dir: str | None = None) -> Settings:
    """The settings that a run with these overrides has. Raises ConfigError."""
    from hydra._internal.utils import get_args_parser

    from islandgp.compose import planned

    import_from_here()
    given = {override.lstrip("+").partition("=")[0] for override in overrides}
    wrong = [override for override in overrides if "=" not in override]
    if wrong:
        raise ConfigError(f"--set: expected KEY=VALUE, found {wrong[0]!r}")
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
