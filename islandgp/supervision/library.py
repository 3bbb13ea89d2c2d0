"""The library of trees to inject: a folder of files, grouped by target (Table 7)."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from inspect import getfile
from pathlib import Path

from pydantic import BaseModel, Field

from islandgp.bt.analysis.conflicts import conflict_in_words
from islandgp.bt.core.language import parse
from islandgp.bt.core.node import Node
from islandgp.bt.core.vocabulary import Vocabulary
from islandgp.domain import Domain
from islandgp.errors import ConfigError
from islandgp.resources import resource
from islandgp.scoring.classes import Classes
from islandgp.text_files import read_text_file


class LibrarySettings(BaseModel, frozen=True, extra="forbid"):
    """The group `library`."""

    folder: str | None = None  # of .bt files; None: a search finds a tree for each behaviour
    trees: dict[str, tuple[str, ...]] = Field(default_factory=dict)
    """Names of trees by target; one of them is drawn. Each behaviour needs at least one."""
    examples: dict[str, tuple[str, ...]] = Field(default_factory=dict)
    """Names of the example trees in each prompt (explore, exploit, poor)."""
    reference_trees: tuple[str, ...] = ()
    """Reference trees that `islandgp compare` evaluates, with the best robots, in unseen worlds."""


@dataclass(frozen=True, slots=True)
class Library:
    """Trees by name, with their targets and prompts."""

    trees: Mapping[str, Node]
    texts: Mapping[str, str]  # as in the files, with comments
    targets: Mapping[str, tuple[str, ...]]  # names of trees by target
    examples: Mapping[str, tuple[str, ...]]  # names of trees by prompt
    episodes: int = 0  # simulated in the search for it


def library_folder(name: str, domain: Domain) -> Path:
    """Finds a folder of trees next to the domain's module, here, or in the project's `grammar`.

    Raises ConfigError if there is none.
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
    """Reads the library in a folder.

    Raises:
        ConfigError: a file or a target is missing, or a target does not exist.
        TreeError: a file is not a tree of the vocabulary.
    """
    for target in settings.trees:
        if target not in classes.targets:
            names = ", ".join(classes.targets)
            raise ConfigError(f"library.trees: expected targets ({names}), found {target!r}")
    if missing := [name for name in classes.behaviours if not settings.trees.get(name)]:
        raise ConfigError(
            f"library.trees: expected a tree for each behaviour, missing {', '.join(missing)}"
        )
    named = [*settings.trees.values(), *settings.examples.values(), settings.reference_trees]
    texts = {
        name: read_tree(folder, name) for name in sorted({n for names in named for n in names})
    }
    trees = {
        name: _parsed(text, vocabulary, str(folder / f"{name}.bt")) for name, text in texts.items()
    }
    return Library(trees, texts, settings.trees, settings.examples)


def _parsed(text: str, vocabulary: Vocabulary, name: str) -> Node:
    """The tree of a file's text. Raises as `parse`, and ConfigError if actions share a resource."""
    tree = parse(text, vocabulary, name=name)
    if shared := conflict_in_words(tree, vocabulary):
        raise ConfigError(
            f"{name}: expected actions that never share a resource, found that {shared};"
            f" `islandgp check {name}` shows where."
        )
    return tree


def read_tree(folder: Path, name: str) -> str:
    """The text of a tree in a folder. Raises ConfigError or IslandError if it cannot be read."""
    path = folder / f"{name}.bt"
    if not path.is_file():
        names = ", ".join(sorted(p.stem for p in folder.glob("*.bt"))) or "none"
        raise ConfigError(f"library: expected a tree in {path}, found none; there are {names}.")
    return read_text_file(path)
