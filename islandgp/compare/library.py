"""The trees of a run's library, by its configuration."""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping
from functools import cache
from pathlib import Path
from typing import Any

from pydantic import ValidationError

from islandgp.bt.core.language import parse, to_text
from islandgp.bt.core.vocabulary import Vocabulary
from islandgp.domain import Domain
from islandgp.errors import ConfigError, IslandError, RunError
from islandgp.evaluation.base import Problem
from islandgp.supervision.library import LibrarySettings, library_folder
from islandgp.text_files import read_text_file


def domain_of(config: Mapping[str, Any]) -> Domain | None:
    """A run's domain; None if its class cannot be imported."""
    keys = ("domain", "world", "rewards", "curriculum")
    return _domain(json.dumps({key: config[key] for key in keys}))


@cache
def _domain(config: str) -> Domain | None:
    try:
        return Problem.recorded(json.loads(config)).domain
    except RunError:
        return None


def library_names(config: Mapping[str, Any]) -> Mapping[str, str]:
    """The names of the trees in a run's library folder, by their canonical text.

    {} if the run had no folder, or if the folder no longer exists.
    """
    settings, domain = _settings(config), domain_of(config)
    if settings.folder is None or domain is None:
        return {}
    try:
        folder = library_folder(settings.folder, domain)
        return _names(folder, domain.schema.vocabulary)
    except ConfigError:
        return {}


@cache
def _names(folder: Path, vocabulary: Vocabulary) -> Mapping[str, str]:
    names = {}
    for file in sorted(folder.glob("*.bt")):
        try:
            tree = parse(read_text_file(file), vocabulary, name=str(file))
            names[to_text(tree)] = file.stem
        except IslandError:  # no tree of the run, or changed since
            continue
    return names


def trees_for_targets(config: Mapping[str, Any]) -> dict[str, str]:
    """The canonical texts of the library's trees for targets, by name; {} as above."""
    targets = _settings(config).trees
    return _texts(config, dict.fromkeys(name for names in targets.values() for name in names))


def reference_trees(config: Mapping[str, Any]) -> dict[str, str]:
    """Canonical texts of the library's reference trees, by name; without those not found."""
    return _texts(config, _settings(config).reference_trees)


def _settings(config: Mapping[str, Any]) -> LibrarySettings:
    """The recorded settings of the library. Raises RunError if this version cannot read them."""
    try:
        return LibrarySettings.model_validate(config["library"])
    except ValidationError as error:
        first = error.errors()[0]
        key = ".".join(map(str, ("library", *first["loc"])))
        raise RunError(
            f"Expected settings of this version in a run's configuration, found {key}:"
            f" {first['msg'].lower()}; look at the run with the version that its about.json names,"
            " or run its command again."
        ) from None


def _texts(config: Mapping[str, Any], names: Iterable[str]) -> dict[str, str]:
    texts = {name: text for text, name in library_names(config).items()}
    return {name: texts[name] for name in names if name in texts}
