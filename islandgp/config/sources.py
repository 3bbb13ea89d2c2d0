"""The folders of configuration files: the project's and, optionally, one of the user."""

from __future__ import annotations

import argparse
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from threading import Lock
from typing import Final, Self

from hydra import compose, initialize_config_dir
from hydra._internal.config_loader_impl import ConfigLoaderImpl
from hydra._internal.utils import create_config_search_path
from hydra.core.config_loader import ConfigLoader
from hydra.core.global_hydra import GlobalHydra
from hydra.core.object_type import ObjectType
from omegaconf import DictConfig

from islandgp.errors import ConfigError
from islandgp.resources import resource
from islandgp.trust import trust_folder

COMPOSING: Final = Lock()  # Hydra composes one configuration at a time in a process


@dataclass(frozen=True, slots=True)
class ConfigSource:
    """The folders of a command, and its first file."""

    folder: Path  # absolute; that of --config-path, else the project's
    name: str  # of the first file
    own: Path | None  # absolute; the user's groups, by --config-dir

    @classmethod
    def of(cls, args: argparse.Namespace) -> Self:
        """The source by the command's options. Raises ConfigError if a folder does not exist."""
        folder = Path(args.config_path or resource("conf")).resolve()
        user_folder = Path(args.config_dir).resolve() if args.config_dir else None
        for option, path in (("--config-path", folder), ("--config-dir", user_folder)):
            if path is not None and not path.is_dir():
                raise ConfigError(
                    f"{option}: expected a folder of configuration, found none at {path};"
                    " give the path of one that is there."
                )
        if user_folder is not None and user_folder != folder:
            _must_hide_nothing(user_folder, folder)
            trust_folder(user_folder)
        return cls(folder, args.config_name or "config", user_folder)

    def compose(self, overrides: Sequence[str]) -> DictConfig:
        """The configuration, with Hydra's own part. Raises what Hydra raises."""
        first, other = self.folder, self.own
        if other is not None and not (first / f"{self.name}.yaml").exists():
            first, other = other, first  # Hydra looks for the first file in one folder only
        search = [f"hydra.searchpath=[file://{other}]"] if other else []
        with _alone(), initialize_config_dir(str(first), version_base="1.3"):
            return compose(self.name, [*overrides, *search], return_hydra_config=True)

    def loader(self) -> ConfigLoader:
        """Hydra's loader, for the options of groups."""
        path = create_config_search_path(str(self.folder))
        if self.own is not None:
            path.append("command-line", f"file://{self.own}")
        return ConfigLoaderImpl(path)

    def options(self, group: str) -> list[str]:
        """The names of a group's files; none where there is no such group."""
        return sorted(self.loader().get_group_options(group, ObjectType.CONFIG))

    def files(self, option: str) -> list[Path]:
        """The files of an option such as `domain/island` that there are."""
        folders = [self.folder, *([self.own] if self.own else [])]
        return [file for folder in folders if (file := folder / f"{option}.yaml").is_file()]


def _must_hide_nothing(own: Path, folder: Path) -> None:
    """Raises ConfigError for a file of the user's that has the name of one that is read first."""
    for path in sorted(folder.rglob("*.yaml")):
        name = path.relative_to(folder)
        if (own / name).exists():
            raise ConfigError(
                f"--config-dir: expected files with names of their own, found {own / name}, in"
                f" whose place the package's {name} is read; give it another name, or give a whole"
                " folder of configuration by --config-path."
            )


@contextmanager
def _alone() -> Iterator[None]:
    """Hydra for this thread, also where another part of the program has initialised it."""
    with COMPOSING:
        others = GlobalHydra.instance().hydra
        GlobalHydra.instance().clear()
        try:
            yield
        finally:
            GlobalHydra.instance().hydra = others
