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
from islandgp.records.parameters import flatten
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

    folder: Path  # absolute; of --config-path, else the package's
    name: str  # of the primary file
    user_folder: Path | None  # absolute; of --config-dir

    @classmethod
    def of(cls, args: argparse.Namespace) -> Self:
        """The source for a command's options. Raises ConfigError if a folder does not exist."""
        folder = Path(args.config_path or resource("conf")).resolve()
        user_folder = Path(args.config_dir).resolve() if args.config_dir else None
        for option, path in (("--config-path", folder), ("--config-dir", user_folder)):
            if path is not None and not path.is_dir():
                raise ConfigError(
                    f"{option}: expected a folder of configuration, found none at {path};"
                    " give the path of one that is there."
                )
        if user_folder is not None and user_folder != folder:
            _must_have_own_names(user_folder, folder)
            set_user_folder(user_folder)
        return cls(folder, args.config_name or "config", user_folder)

    def compose(self, overrides: Sequence[str]) -> DictConfig:
        """The configuration, including Hydra's part. Raises Hydra's exceptions."""
        first, other = self.folder, self.user_folder
        if other is not None and not (first / f"{self.name}.yaml").exists():
            first, other = other, first  # Hydra looks for the primary file in one folder only
        search = [f"hydra.searchpath=[file://{other}]"] if other else []
        with _alone(), initialize_config_dir(str(first), version_base="1.3"):
            return compose(self.name, [*overrides, *search], return_hydra_config=True)

    def folders(self) -> list[Path]:
        """All folders of configuration, those of installed distributions last."""
        return [self.folder, *filter(None, [self.user_folder]), *conf_folders()]

    def loader(self) -> ConfigLoader:
        """Hydra's loader, for the options of groups."""
        path = create_config_search_path(str(self.folder))
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
        package = resource("conf").resolve()
        folders = {self.folder, self.user_folder or package} - {package}
        if not folders:
            return
        usual = _flat(ConfigSource(package, "config", None).compose([]))
        own = flatten(values)
        entries = self.loader().compute_defaults_list(self.name, list(overrides), RunMode.RUN)
        for entry in entries.defaults:
            for file in (folder / f"{entry.config_path}.yaml" for folder in folders):
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


def _must_have_own_names(user_folder: Path, folder: Path) -> None:
    """Raises ConfigError if a file of the user has the name of one in another folder."""
    if found := hidden(user_folder, (folder, *conf_folders())):
        raise ConfigError(
            f"--config-dir: expected files with names of their own, found {found}; rename it, or"
            " give a whole folder of configuration by --config-path."
        )


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
