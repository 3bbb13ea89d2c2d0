"""The trees that come with a domain: of its library, and of the files beside its module."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from inspect import getfile
from pathlib import Path
from typing import TYPE_CHECKING, Final

from islandgp.bt.core.language import domain_of, parse
from islandgp.bt.core.node import Node
from islandgp.commands.files import read_text, read_tree
from islandgp.commands.setting import default_domain
from islandgp.errors import IslandError
from islandgp.resources import resource

if TYPE_CHECKING:
    from islandgp.config.settings import Settings
    from islandgp.domain import Domain

MOST: Final = 100
"""Files of trees that are looked at."""


@dataclass(frozen=True, slots=True)
class OwnTrees:
    """What was found."""

    trees: tuple[Node, ...]
    left_out: tuple[str, ...]  # a line for each file, and for a library, that cannot be read


def own_trees(settings: Settings, domain: Domain) -> OwnTrees:
    """The trees of a domain's library, and those of .bt files that are for it."""
    trees: list[Node] = []
    left_out: list[str] = []
    try:
        trees += _library(settings, domain)
    except IslandError as error:
        left_out.append(str(error).splitlines()[0])
    for file in _files(domain):
        try:
            text = read_text(str(file))
            if (domain_of(text) or default_domain()) == domain.schema.vocabulary.domain:
                trees.append(read_tree(str(file), domain.schema.vocabulary))
        except IslandError as error:
            left_out.append(str(error).splitlines()[0])
    return OwnTrees(tuple(dict.fromkeys(trees)), tuple(dict.fromkeys(left_out)))


def _library(settings: Settings, domain: Domain) -> Iterator[Node]:
    """The trees of a folder, or those that an earlier run has searched for."""
    from islandgp.running.automatic_library import kept_texts, library_file
    from islandgp.running.run import make_library

    if settings.library.folder is not None:
        yield from make_library(settings, domain).trees.values()
    elif (file := library_file(settings, domain)).exists():
        for name, text in kept_texts(file).items():
            yield parse(text, domain.schema.vocabulary, name=f"{file}: {name}")


def _files(domain: Domain) -> list[Path]:
    """Files of trees beside the domain's module, in its folder `trees`, and among the examples."""
    beside = Path(getfile(type(domain))).parent
    folders = (beside, beside / "trees", resource("grammar") / "examples")
    return [file for folder in folders for file in sorted(folder.glob("*.bt"))][:MOST]
