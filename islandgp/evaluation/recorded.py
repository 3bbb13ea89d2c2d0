"""The world and the rules of a run that is over, from its configuration."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from islandgp.errors import RunError, brief
from islandgp.evaluation.base import Problem
from islandgp.plain import UNREADABLE
from islandgp.plugin import imported
from islandgp.scoring.curriculum import Curriculum


def setting_of(config: Mapping[str, Any]) -> Problem:
    """What the run's trees were evaluated in.

    Raises:
        RunError: the configuration is of a version before domains, or damaged.
    """
    check_version(config)
    try:
        return _setting_of(config)
    except UNREADABLE as error:
        raise RunError(
            f"Expected the configuration of a run, found a damaged one ({brief(error)}); run its"
            " command again under another name."
        ) from error


def _setting_of(config: Mapping[str, Any]) -> Problem:
    factory = imported(config["domain"]["factory"])
    world = factory.World.model_validate(config["world"])
    rewards = factory.Rewards.model_validate(config["rewards"])
    return Problem.of(factory, world, rewards, Curriculum(**config["curriculum"]))


def check_version(config: Mapping[str, Any]) -> None:
    """Raises RunError for a configuration that names no domain."""
    if "domain" not in config:
        raise RunError(
            "Expected a run whose configuration names its domain, found one of version 0.1, which"
            " had none; look at it with that version, or run its command again."
        )
