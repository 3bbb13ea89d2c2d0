"""Caches of parsed and composed configurations and of library trees, for faster tests.

Each process parses a YAML text and a library tree, and loads a file of `conf`, only once. Merged
files are cached by the chosen options, and kept for later processes in .pytest_cache until a file
of `conf` changes; overrides are applied once for each command. Each call returns new objects, and
raises the same errors as without this module.
"""

from __future__ import annotations

import hashlib
import os
import pickle
import re
import sys
from collections.abc import Callable
from functools import cache, lru_cache, partial
from pathlib import Path
from typing import Any, Final

import hydra
import omegaconf
import yaml
from hydra._internal import config_loader_impl
from hydra._internal.config_loader_impl import ConfigLoaderImpl
from hydra._internal.config_repository import ConfigRepository
from hydra.core.config_store import ConfigStore
from hydra.core.utils import JobRuntime
from hydra.version import getbase

from islandgp.bt.core.language import parse
from islandgp.bt.core.node import Node
from islandgp.bt.core.vocabulary import Vocabulary
from islandgp.resources import resource
from islandgp.supervision import library

SEARCHED: Final = re.compile(r'hydra\.searchpath=\["file://(.+)"\]')
SCHEMES: Final = ("pkg", "structured")  # sources that do not change under a running process

_parse = yaml.load
_read = ConfigRepository.load_config
_choose = config_loader_impl.create_defaults_list
_merge = ConfigLoaderImpl._compose_config_from_defaults_list
_configure = ConfigLoaderImpl.load_configuration

_loaders: dict[str, Any] = {}  # OmegaConf makes a class for each text, always the same one
_cache: dict[str, bytes] = {}
_trees: dict[tuple[str, str, int], tuple[Node, Vocabulary]] = {}  # it keeps the vocabularies' ids


@lru_cache(maxsize=2048)
def _parsed(text: str | bytes, loader: str) -> bytes:
    return pickle.dumps(_parse(text, _loaders[loader]))


def _load(stream: Any, Loader: Any) -> Any:  # the name of the argument is PyYAML's
    """`yaml.load`, cached."""
    text = stream.read() if hasattr(stream, "read") else stream
    name = f"{Loader.__module__}.{Loader.__qualname__}"
    _loaders[name] = Loader
    try:
        return pickle.loads(_parsed(text, name))
    except yaml.YAMLError:
        if not hasattr(stream, "seek"):
            raise
        stream.seek(0)  # parsing the stream again gives a message that names the file
        return _parse(stream, Loader)


@cache
def _folder() -> Path:
    """The cache's folder for the current files of `conf` and versions of the packages."""
    state = hashlib.sha256(repr((sys.version, hydra.__version__, omegaconf.__version__)).encode())
    for file in sorted(resource("conf").rglob("*.yaml")):
        state.update(str(file).encode() + file.read_bytes())
    folder = Path(__file__).parents[1] / ".pytest_cache" / "composed" / state.hexdigest()[:16]
    folder.mkdir(parents=True, exist_ok=True)
    return folder


def cached(key: object, make: Callable[[], Any], *, keep: bool) -> Any:
    """A new copy of the result of `make` for the key; `keep`: also for later processes."""
    name = hashlib.sha256(repr(key).encode()).hexdigest()
    file = _folder() / name
    if name not in _cache and keep and file.exists():
        _cache[name] = file.read_bytes()
    if name not in _cache:
        _cache[name] = pickle.dumps(make())
        if keep:
            part = file.with_suffix(f".{os.getpid()}")
            part.write_bytes(_cache[name])
            part.replace(file)
    return pickle.loads(_cache[name])


def _is_ours(repo: Any) -> bool:
    """True if the configuration comes from no test's folder."""
    paths = [
        s.path.removeprefix("file://") for s in repo.get_sources() if s.scheme() not in SCHEMES
    ]
    return paths == [str(resource("conf"))]


def _sources(repo: Any) -> str:
    """The places from which files are read, with the content of tests' folders."""
    places = [(s.scheme(), s.path.removeprefix("file://")) for s in repo.get_sources()]
    return repr([(*place, place[0] not in SCHEMES and _content(place[1])) for place in places])


def _content(folder: str) -> dict[str, bytes]:
    """The YAML files of a folder by path, none for the package's folder."""
    if folder == str(resource("conf")):
        return {}
    return {str(file): file.read_bytes() for file in sorted(Path(folder).rglob("*.yaml"))}


def _load_config(self: ConfigRepository, config_path: str) -> Any:
    """Hydra's `load_config`, cached: a file of the configuration, or None."""
    key = ("file", _sources(self), config_path)
    return cached(key, lambda: _read(self, config_path), keep=_is_ours(self))


def _create_defaults_list(repo: Any, overrides_list: Any, **options: Any) -> Any:
    """Hydra's `create_defaults_list`, cached: the chosen files, and overrides of values."""
    values, groups = [], []
    for override in overrides_list:
        if not override.is_sweep_override():
            is_group = repo.group_exists(override.key_or_group)
            is_choice = is_group and not isinstance(override.value(), dict)
            (groups if is_choice else values).append(override)
    key = ("chosen", _sources(repo), [o.input_line for o in groups], sorted(options.items()))
    choose = partial(_choose, repo=repo, overrides_list=groups, **options)
    defaults = cached(key, choose, keep=_is_ours(repo))
    defaults.config_overrides = values
    return defaults


def _compose_config(self: ConfigLoaderImpl, defaults: Any, repo: Any) -> Any:
    """Hydra's `_compose_config_from_defaults_list`, cached: the merged files."""
    key = ("merged", _sources(repo), defaults)
    return cached(key, partial(_merge, self, defaults=defaults, repo=repo), keep=_is_ours(repo))


def _load_configuration(
    self: ConfigLoaderImpl,
    config_name: str | None,
    overrides: list[str],
    *args: Any,
    **options: Any,
) -> Any:
    """Hydra's `load_configuration`, cached: the whole configuration of a command."""
    contents = [_content(path) for path in SEARCHED.findall(" ".join(overrides))]
    job = JobRuntime.instance().conf
    call = (config_name, overrides, args, sorted(options.items()), job, getbase())
    configure = partial(_configure, self, config_name, overrides, *args, **options)
    config = cached((_sources(self.repository), contents, call), configure, keep=False)
    config.hydra.runtime.cwd = os.getcwd()
    return config


def _parse_tree(text: str, vocabulary: Vocabulary, *, name: str) -> Node:
    """`parse`, cached, for library trees; nodes are immutable."""
    key = (text, name, id(vocabulary))
    if key not in _trees:
        _trees[key] = (parse(text, vocabulary, name=name), vocabulary)
    return _trees[key][0]


def install() -> None:
    """Replaces functions of PyYAML, Hydra and the library by cached ones in this process."""
    yaml.load = _load
    ConfigStore.__deepcopy__ = lambda store, _: store  # type: ignore[attr-defined] # its nodes are copied when read
    ConfigRepository.load_config = _load_config
    ConfigLoaderImpl.load_configuration = _load_configuration
    config_loader_impl.create_defaults_list = _create_defaults_list
    ConfigLoaderImpl._compose_config_from_defaults_list = _compose_config
    library.parse = _parse_tree
