"""The configuration of `conf/`, composed as `python -m islandgp` composes it.

`composed` and `composed_plan` take `search=paper` where no override names a search or an
experiment, since most tests of evolution are about Algorithm 1.
"""

from __future__ import annotations

from collections.abc import Sequence
from copy import deepcopy
from functools import cache, partial
from tempfile import gettempdir
from typing import Any

from hydra import compose, initialize_config_dir
from hydra._internal.config_loader_impl import ConfigLoaderImpl
from hydra.core.override_parser.overrides_parser import OverridesParser
from omegaconf import DictConfig, OmegaConf

from islandgp.config.settings import Settings, read_settings
from islandgp.gp.plan import Plan
from islandgp.resources import resource
from tests.once import made_once


def plain(*overrides: str) -> dict[str, Any]:
    """The resolved configuration as plain values, a new one at each call."""
    return deepcopy(_plain(*overrides))


@cache
def _plain(*overrides: str) -> dict[str, Any]:
    make = partial(_with_values, overrides)
    keep = all(gettempdir() not in word for word in overrides)  # folders of one run of the tests
    found: dict[str, Any] = made_once(("plain", overrides), make, keep=keep)
    return found


def _with_values(overrides: Sequence[str]) -> dict[str, Any]:
    """Hydra merges the files once for each choice of options; it adds the values to a copy."""
    options = tuple(word for word in overrides if _is_option(word))
    config = made_once(("options", options), partial(_composed, options), keep=True)
    values = [word for word in overrides if word not in options]
    parsed = OverridesParser.create().parse_overrides(values)
    ConfigLoaderImpl._apply_overrides_to_config(parsed, config)
    found = OmegaConf.to_container(config, resolve=True, throw_on_missing=True)
    assert isinstance(found, dict)
    return {str(key): value for key, value in found.items()}


def _is_option(word: str) -> bool:
    group, _, value = word.lstrip("+~").partition("=")
    return (resource("conf") / group).is_dir() and not value.startswith("{")


def _composed(options: Sequence[str]) -> DictConfig:
    with initialize_config_dir(str(resource("conf")), version_base="1.3"):
        return compose("config", ["tracking=off", *options])


@cache
def composed(*overrides: str) -> Settings:
    """The validated settings. Frozen, so that tests may share them."""
    chosen = any(word.startswith(("search=", "experiment=")) for word in overrides)
    return read_settings(plain(*(() if chosen else ("search=paper",)), *overrides))


def named(settings: Settings) -> dict[str, Any]:
    """Of the plain configuration what names a job's folder, and tells its length."""
    return {
        "runs": settings.runs,
        "name": settings.name,
        "seed": settings.seed,
        "supervisor": {"name": settings.supervisor.name},
        "gp": {"generations": settings.gp.generations},
    }


def composed_plan(*overrides: str) -> Plan:
    """What evolution needs of those settings."""
    settings = composed(*overrides)
    return settings.plan(settings.make_domain())
