"""Work on configuration that tests repeat, done once a process.

A text of YAML is parsed once and a file of `conf` is loaded once. The files are merged once for
each choice of options; values given by the command are applied once for each command. All of it
gives new objects at each call and raises what it raises without this module.
"""

from __future__ import annotations

import os
import pickle
import re
from functools import lru_cache
from pathlib import Path
from typing import Any, Final

import yaml
from hydra._internal import config_loader_impl
from hydra._internal.config_loader_impl import ConfigLoaderImpl
from hydra._internal.config_repository import ConfigRepository
from hydra.core.config_store import ConfigStore
from hydra.core.utils import JobRuntime
from hydra.version import getbase

from islandgp.resources import resource

SEARCHED: Final = re.compile(r"hydra\.searchpath=\[file://([^\]]+)\]")
SCHEMES: Final = ("pkg", "structured")  # sources that do not change under a running process

_parse = yaml.load
_read = ConfigRepository.load_config
_choose = config_loader_impl.create_defaults_list
_merge = ConfigLoaderImpl._compose_config_from_defaults_list
_configure = ConfigLoaderImpl.load_configuration

_loaders: dict[str, Any] = {}  # OmegaConf makes a class for each text, always the same one
_files: dict[tuple[str, str], bytes] = {}
_chosen: dict[str, bytes] = {}
_merged: dict[str, bytes] = {}
_configured: dict[str, bytes] = {}


@lru_cache(maxsize=2048)
def _parsed(text: str | bytes, loader: str) -> bytes:
    return pickle.dumps(_parse(text, _loaders[loader]))


def _load(stream: Any, Loader: Any) -> Any:  # the name of the argument is PyYAML's
    """As `yaml.load`."""
    text = stream.read() if hasattr(stream, "read") else stream
    name = f"{Loader.__module__}.{Loader.__qualname__}"
    _loaders[name] = Loader
    try:
        return pickle.loads(_parsed(text, name))
    except yaml.YAMLError:
        if not hasattr(stream, "seek"):
            raise
        stream.seek(0)  # its message names the file
        return _parse(stream, Loader)


def _sources(repo: Any) -> str:
    """The places that files are read from, and what is in folders of tests."""
    found = [(s.scheme(), s.path.removeprefix("file://")) for s in repo.get_sources()]
    return repr([(*place, place[0] not in SCHEMES and _content(place[1])) for place in found])


def _content(folder: str) -> dict[str, bytes]:
    """The YAML files of a folder that is not the package's."""
    if folder == str(resource("conf")):
        return {}
    return {str(file): file.read_bytes() for file in sorted(Path(folder).rglob("*.yaml"))}


def _load_config(self: ConfigRepository, config_path: str) -> Any:
    """As Hydra's: a file of the configuration, or None."""
    key = (_sources(self), config_path)
    if key not in _files:
        found = _read(self, config_path)
        if found is None:
            return found
        _files[key] = pickle.dumps(found)
    return pickle.loads(_files[key])


def _create_defaults_list(repo: Any, overrides_list: Any, **given: Any) -> Any:
    """As Hydra's: which files are chosen, and the overrides that are values."""
    sources = _sources(repo)
    values, groups = [], []
    for override in overrides_list:
        if not override.is_sweep_override():
            is_group = repo.group_exists(override.key_or_group)
            is_choice = is_group and not isinstance(override.value(), dict)
            (groups if is_choice else values).append(override)
    key = repr((sources, [o.input_line for o in groups], sorted(given.items())))
    if key not in _chosen:
        _chosen[key] = pickle.dumps(_choose(repo=repo, overrides_list=groups, **given))
    found = pickle.loads(_chosen[key])
    found.config_overrides = values
    return found


def _compose_config(self: ConfigLoaderImpl, defaults: Any, repo: Any) -> Any:
    """As Hydra's: the chosen files, merged."""
    key = repr((_sources(repo), defaults))
    if key not in _merged:
        _merged[key] = pickle.dumps(_merge(self, defaults=defaults, repo=repo))
    return pickle.loads(_merged[key])


def _load_configuration(
    self: ConfigLoaderImpl, config_name: str | None, overrides: list[str], *args: Any, **given: Any
) -> Any:
    """As Hydra's: the whole configuration of a command."""
    sources = _sources(self.repository)
    own = [_content(path) for path in SEARCHED.findall(" ".join(overrides))]
    job = JobRuntime.instance().conf
    key = repr((sources, own, config_name, overrides, args, sorted(given.items()), job, getbase()))
    if key not in _configured:
        _configured[key] = pickle.dumps(_configure(self, config_name, overrides, *args, **given))
    config = pickle.loads(_configured[key])
    config.hydra.runtime.cwd = os.getcwd()
    return config


def install() -> None:
    """Replaces PyYAML's and Hydra's functions for the rest of this process."""
    yaml.load = _load
    ConfigStore.__deepcopy__ = lambda store, _: store  # type: ignore[attr-defined] # its nodes are copied when read
    ConfigRepository.load_config = _load_config
    ConfigLoaderImpl.load_configuration = _load_configuration
    config_loader_impl.create_defaults_list = _create_defaults_list
    ConfigLoaderImpl._compose_config_from_defaults_list = _compose_config
