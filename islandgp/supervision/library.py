"""The trees that supervisors inject: a folder of files, by what each tree is for (Table 7)."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from inspect import getfile
from pathlib import Path

from pydantic import BaseModel, Field

from islandgp.bt.core.language import parse
from islandgp.bt.core.node import Node
from islandgp.bt.core.vocabulary import Vocabulary
from islandgp.domain import Domain
from islandgp.errors import ConfigError
from islandgp.resources import resource
from islandgp.scoring.classes import Classes


class LibrarySettings(BaseModel, frozen=True, extra="forbid"):
    """The group `library`."""

    folder: str | None = None  # of .bt files; None: a tree for each behaviour is searched for
    trees: dict[str, tuple[str, ...]] = Field(default_factory=dict)
    """By target the names of trees; one of them is drawn. Each behaviour needs one."""
    shown: dict[str, tuple[str, ...]] = Field(default_factory=dict)
    """By prompt (explore, exploit, poor) the trees that a language model is shown."""
    yardsticks: tuple[str, ...] = ()
    """Trees that `islandgp compare` sets beside the champions in unseen worlds."""


@dataclass(frozen=True, slots=True)
class Library:
    """Trees by name, and what they are for."""

    trees: Mapping[str, Node]
    texts: Mapping[str, str]  # the same as written, comments included
    targets: Mapping[str, tuple[str, ...]]  # names of trees by target
    shown: Mapping[str, tuple[str, ...]]  # names of trees by prompt
    episodes: int = 0  # in which it was searched for


def library_folder(name: str, domain: Domain) -> Path:
    """A folder of trees: beside the domain's module, here, or among the project's own.

    Raises ConfigError where there is none.
    """
    module = getfile(type(domain))
    for folder in (Path(module).parent / name, Path(name), resource("grammar").parent / name):
        if folder.is_dir():
            return folder
    raise ConfigError(
        f"library.folder: expected a folder of trees beside {Path(module).name} or here, found no"
        f" {name!r}; give its path, or library=automatic."
    )


def read_library(
    settings: LibrarySettings, folder: Path, vocabulary: Vocabulary, classes: Classes
) -> Library:
    """The library in a folder.

    Raises:
        ConfigError: a file or a target is missing, or a target does not exist.
        TreeError: a file is not a tree in the words of the vocabulary.
    """
    for target in settings.trees:
        if target not in classes.targets:
            known = ", ".join(classes.targets)
            raise ConfigError(f"library.trees: expected targets ({known}), found {target!r}")
    if missing := [name for name in classes.behaviours if not settings.trees.get(name)]:
        raise ConfigError(
            f"library.trees: expected a tree for each behaviour, missing {', '.join(missing)}"
        )
    named = [*settings.trees.values(), *settings.shown.values(), settings.yardsticks]
    texts = {
        name: read_tree(folder, name) for name in sorted({n for names in named for n in names})
    }
    trees = {
        name: parse(text, vocabulary, name=str(folder / f"{name}.bt"))
        for name, text in texts.items()
    }
    return Library(trees, texts, settings.trees, settings.shown)


def read_tree(folder: Path, name: str) -> str:
    """The text of a tree of a folder. Raises ConfigError where there is none."""
    path = folder / f"{name}.bt"
    try:
        return path.read_text(encoding="utf-8")
    except UnicodeDecodeError as error:
        raise ConfigError(
            f"library: expected UTF-8 text in {path}, found {error.reason}."
        ) from None
    except OSError as error:
        known = ", ".join(sorted(p.stem for p in folder.glob("*.bt"))) or "none"
        raise ConfigError(
            f"library: expected a tree in {path}, found none ({error.strerror}); there are {known}."
        ) from None
