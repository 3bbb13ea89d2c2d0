"""The trees of a run's library, by its configuration."""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping
from functools import cache
from typing import Any

from pydantic import ValidationError

from islandgp.bt.core.language import parse, to_text
from islandgp.domain import Domain
from islandgp.errors import ConfigError, IslandError, RunError, brief
from islandgp.evaluation.base import Problem
from islandgp.supervision.library import LibrarySettings, library_folder
from islandgp.text_files import read_text_file


def domain_of(config: Mapping[str, Any]) -> Domain | None:
    """A run's domain; None if its class cannot be imported."""
    try:
        return Problem.recorded(config).domain
    except RunError:
        return None


def library_names(config: Mapping[str, Any]) -> Mapping[str, str]:
    """The names of the trees in a run's library folder, by their canonical text.

    {} if the run had no folder, or if the folder no longer exists.
    """
    keys = ("domain", "world", "rewards", "curriculum", "library")
    return _names(json.dumps({key: config[key] for key in keys}))


@cache
def _names(text: str) -> Mapping[str, str]:
    config = json.loads(text)
    settings, domain = _settings(config), domain_of(config)
    if settings.folder is None or domain is None:
        return {}
    names = {}
    try:
        files = sorted(library_folder(settings.folder, domain).glob("*.bt"))
    except ConfigError:
        return {}
    for file in files:
        try:
            tree = parse(read_text_file(file), domain.schema.vocabulary, name=str(file))
            names[to_text(tree)] = file.stem
        except IslandError:  # no tree of the run, or changed since
            continue
    return names


def reference_trees(config: Mapping[str, Any]) -> dict[str, str]:
    """Canonical texts of the library's reference trees, by name; without those not found."""
    return _texts(config, _settings(config).reference_trees)


def library_trees(config: Mapping[str, Any]) -> dict[str, str]:
    """The same for the reference trees, and then the trees for targets."""
    targets = _settings(config).trees.values()
    return reference_trees(config) | _texts(config, (name for names in targets for name in names))


def _settings(config: Mapping[str, Any]) -> LibrarySettings:
    """The recorded settings of the library. Raises RunError if this version cannot read them."""
    try:
        return LibrarySettings.model_validate(config["library"])
    except ValidationError as error:
        raise RunError(
            f"Expected settings of this version in a run's configuration, found {brief(error)};"
            " look at the run with the version that its about.json names, or repeat its command."
        ) from None


def _texts(config: Mapping[str, Any], names: Iterable[str]) -> dict[str, str]:
    texts = {name: text for text, name in library_names(config).items()}
    return {name: texts[name] for name in names if name in texts}
