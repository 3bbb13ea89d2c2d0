"""The folders of configuration files: the package's, those of distributions, and the user's."""

from __future__ import annotations

import argparse
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from threading import Lock
from typing import Any, Final, Self

from hydra import compose, initialize_config_dir
from hydra._internal.config_loader_impl import ConfigLoaderImpl
from hydra._internal.utils import create_config_search_path
from hydra.core.config_loader import ConfigLoader
from hydra.core.config_search_path import ConfigSearchPath
from hydra.core.global_hydra import GlobalHydra
from hydra.core.object_type import ObjectType
from hydra.core.plugins import Plugins
from hydra.plugins.search_path_plugin import SearchPathPlugin
from hydra.types import RunMode
from omegaconf import Container, DictConfig, OmegaConf

from islandgp.errors import ConfigError
from islandgp.gate import set_user_folder
from islandgp.installed import CONF, conf_folders, hidden
from islandgp.plain import flatten
from islandgp.resources import resource

COMPOSE_LOCK: Final = Lock()  # Hydra composes one configuration at a time in a process


class InstalledFolders(SearchPathPlugin):
    """Adds the folders of installed distributions to Hydra's search path."""

    def manipulate_search_path(self, search_path: ConfigSearchPath) -> None:
        """See `SearchPathPlugin`."""
        for folder in conf_folders():
            search_path.append(CONF, f"file://{folder}")


Plugins.instance().register(InstalledFolders)


@dataclass(frozen=True, slots=True)
class ConfigSource:
    """The folders and the primary file of a command's configuration."""

    name: str  # of the primary file
    user_folder: Path | None  # absolute; of --config-dir

    @classmethod
    def of(cls, args: argparse.Namespace) -> Self:
        """The source for a command's options. Raises ConfigError if it cannot be used."""
        if args.config_path:
            raise ConfigError(
                "--config-path: expected --config-dir FOLDER, which adds your files to those of the"
                " package, found a folder in place of the package's."
            )
        folder = Path(args.config_dir).resolve() if args.config_dir else None
        if folder is not None:
            if not folder.is_dir():
                raise ConfigError(
                    f"--config-dir: expected a folder of configuration, found none at {folder};"
                    " give the path of one that is there."
                )
            if found := hidden(folder, (resource("conf"), *conf_folders())):
                raise ConfigError(
                    f"--config-dir: expected files with names of their own, found {found};"
                    " rename it."
                )
            set_user_folder(folder)
        return cls(args.config_name or "config", folder)

    def compose(self, overrides: Sequence[str]) -> DictConfig:
        """The configuration, including Hydra's part. Raises Hydra's exceptions."""
        first, *others = self.folders()[: 1 + (self.user_folder is not None)]
        if others and not (first / f"{self.name}.yaml").exists():
            first, others = others[0], [first]  # Hydra looks for the primary file in one folder
        quoted = (str(other).replace('"', '\\"') for other in others)
        search = [f'hydra.searchpath=["file://{other}"]' for other in quoted]
        with _alone(), initialize_config_dir(str(first), version_base="1.3"):
            return compose(self.name, [*overrides, *search], return_hydra_config=True)

    def folders(self) -> list[Path]:
        """All folders of configuration, those of installed distributions last."""
        return [*filter(None, [resource("conf").resolve(), self.user_folder]), *conf_folders()]

    def loader(self) -> ConfigLoader:
        """Hydra's loader, for the options of groups."""
        path = create_config_search_path(str(resource("conf")))
        if self.user_folder is not None:
            path.append("command-line", f"file://{self.user_folder}")
        return ConfigLoaderImpl(path)

    def keys_of_user(
        self, overrides: Sequence[str], values: Mapping[str, Any]
    ) -> Iterator[tuple[Path, str]]:
        """The keys that files of the user set to other values than the package does by default.

        Args:
            overrides: of a job.
            values: the plain configuration of the job.

        Yields:
            A file and a dotted key.
        """
        if self.user_folder is None:
            return
        usual = _flat(ConfigSource("config", None).compose([]))
        own = flatten(values)
        entries = self.loader().compute_defaults_list(self.name, list(overrides), RunMode.RUN)
        for entry in entries.defaults:
            file = self.user_folder / f"{entry.config_path}.yaml"
            for inner in _flat(OmegaConf.load(file)) if file.is_file() else ():
                key = f"{entry.package or ''}.{inner}".lstrip(".")
                if key in own and own[key] != usual.get(key):
                    yield file, key

    def options(self, group: str) -> list[str]:
        """The options of a group: the names of its files."""
        return sorted(self.loader().get_group_options(group, ObjectType.CONFIG))


def _flat(config: Container) -> dict[str, Any]:
    """The values by dotted keys."""
    plain = OmegaConf.to_container(config)
    return flatten({str(k): v for k, v in plain.items()}) if isinstance(plain, dict) else {}


@contextmanager
def _alone() -> Iterator[None]:
    """Context with its own Hydra instance, also if Hydra is initialised already."""
    with COMPOSE_LOCK:
        others = GlobalHydra.instance().hydra
        GlobalHydra.instance().clear()
        try:
            yield
        finally:
            GlobalHydra.instance().hydra = others
