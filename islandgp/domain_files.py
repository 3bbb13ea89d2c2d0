"""The configured domains, and the vocabularies of their classes."""

from __future__ import annotations

from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Any

from islandgp.installed import conf_folders
from islandgp.resources import resource

if TYPE_CHECKING:
    from islandgp.bt.core.vocabulary import Vocabulary


def domain_files(config_dir: str | None = None) -> dict[str, Path]:
    """The configuration files of domains, by name.

    `config_dir` is the user's folder of configuration; of two files with the same name, the result
    has the one that Hydra uses.
    """
    folders = [*([Path(config_dir)] if config_dir else []), *conf_folders(), resource("conf")]
    return {file.stem: file for folder in folders for file in folder.glob("domain/*.yaml")}


def class_vocabulary(domain: str, config_dir: str | None = None) -> Vocabulary:
    """The vocabulary of a domain's class, without composing a configuration.

    Raises:
        KeyError: there is no such domain.
        AttributeError: its schema depends on settings.
    """
    vocabulary: Vocabulary = domain_class(domain, config_dir).schema.vocabulary
    return vocabulary


def domain_class(domain: str, config_dir: str | None = None) -> Any:
    """The class of a domain. Raises KeyError if there is no such domain."""
    module, _, attribute = _factory(domain, config_dir).partition(":")
    return getattr(import_module(module), attribute)


def _factory(domain: str, config_dir: str | None = None) -> str:
    """The path of a domain's class, "module:Class"."""
    import yaml

    config = yaml.safe_load(domain_files(config_dir)[domain].read_text(encoding="utf-8"))
    return str(config.get("domain", config)["factory"])
