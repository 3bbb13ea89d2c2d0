"""Work on configuration that tests repeat, done once a process: parsing YAML, composing `conf`.

Both give a new value at each call and raise what they raise without this module.
"""

from __future__ import annotations

import os
import pickle
from functools import lru_cache
from typing import Any, Final

import yaml
from hydra import version
from hydra._internal.config_loader_impl import ConfigLoaderImpl
from hydra.core.utils import JobRuntime
from omegaconf import OmegaConf

from islandgp.resources import resource

PACKAGED: Final = ("pkg:", "structured:")  # what does not change under a running process

_parse = yaml.load
_compose = ConfigLoaderImpl._load_configuration_impl
_loaders: dict[str, Any] = {}  # OmegaConf makes a class for each text, always the same one
_composed: dict[object, bytes] = {}


@lru_cache(maxsize=2048)
def _parsed(text: str | bytes, loader: str) -> bytes:
    return pickle.dumps(_parse(text, _loaders[loader]))


def _load(stream: Any, Loader: Any) -> Any:  # the name of the argument is PyYAML's
    text = stream.read() if hasattr(stream, "read") else stream
    name = f"{Loader.__module__}.{Loader.__qualname__}"
    _loaders[name] = Loader
    return pickle.loads(_parsed(text, name))


def _load_configuration(self: ConfigLoaderImpl, **given: Any) -> Any:
    """As Hydra's, which composes; a configuration of `conf` alone is kept."""
    paths = [part.path for part in self.config_search_path.get_path()]
    folders = [p.removeprefix("file://") for p in paths if p and not p.startswith(PACKAGED)]
    if folders != [str(resource("conf"))] or any("searchpath" in w for w in given["overrides"]):
        return _compose(self, **given)
    name = JobRuntime().conf.get("name")
    key = repr((paths, sorted(given.items()), name, version.getbase()))
    if key not in _composed:
        config = _compose(self, **given)
        _composed[key] = pickle.dumps(config)
        return config
    config = pickle.loads(_composed[key])
    OmegaConf.update(config, "hydra.runtime.cwd", os.getcwd())
    return config


def install() -> None:
    """Replaces PyYAML's and Hydra's functions for the rest of this process."""
    yaml.load = _load
    ConfigLoaderImpl._load_configuration_impl = _load_configuration
