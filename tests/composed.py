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
from tests.caches import cached


def plain(*overrides: str) -> dict[str, Any]:
    """The resolved configuration as plain values, a new one at each call."""
    return deepcopy(_plain(*overrides))


@cache
def _plain(*overrides: str) -> dict[str, Any]:
    make = partial(_with_values, overrides)
    keep = all(gettempdir() not in each for each in overrides)  # tests' folders are temporary
    config: dict[str, Any] = cached(("plain", overrides), make, keep=keep)
    return config


def _with_values(overrides: Sequence[str]) -> dict[str, Any]:
    """The configuration with the overrides: values are set in a copy of the merged files."""
    options = tuple(each for each in overrides if _is_option(each))
    config = cached(("options", options), partial(_composed, options), keep=True)
    values = [each for each in overrides if each not in options]
    parsed = OverridesParser.create().parse_overrides(values)
    ConfigLoaderImpl._apply_overrides_to_config(parsed, config)
    resolved = OmegaConf.to_container(config, resolve=True, throw_on_missing=True)
    assert isinstance(resolved, dict)
    return {str(key): value for key, value in resolved.items()}


def _is_option(override: str) -> bool:
    group, _, value = override.lstrip("+~").partition("=")
    return (resource("conf") / group).is_dir() and not value.startswith("{")


def _composed(options: Sequence[str]) -> DictConfig:
    with initialize_config_dir(str(resource("conf")), version_base="1.3"):
        return compose("config", ["tracking=off", *options])


@cache
def composed(*overrides: str) -> Settings:
    """The validated settings, which tests share, as they are immutable."""
    has_search = any(each.startswith(("search=", "experiment=")) for each in overrides)
    return read_settings(plain(*(() if has_search else ("search=paper",)), *overrides))


def named(settings: Settings) -> dict[str, Any]:
    """The part of the plain configuration that determines a job's folder and generations."""
    return {
        "runs": settings.runs,
        "name": settings.name,
        "seed": settings.seed,
        "supervisor": {"name": settings.supervisor.name},
        "gp": {"generations": settings.gp.generations},
    }


def composed_plan(*overrides: str) -> Plan:
    """The plan of a run with those settings."""
    settings = composed(*overrides)
    return settings.plan(settings.make_domain())
