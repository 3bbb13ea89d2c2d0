"""The domains that are configured, and the words that their classes declare."""

from __future__ import annotations

import re
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Any

from islandgp.resources import resource

if TYPE_CHECKING:
    from islandgp.bt.core.vocabulary import Vocabulary


def domain_files(config_dir: str | None = None) -> dict[str, Path]:
    """The files of domains by name: of two, the one that Hydra finds first.

    `config_dir`: the user's own folder of configuration, beside the project's.
    """
    folders = [*([Path(config_dir)] if config_dir else []), resource("conf")]
    return {file.stem: file for folder in folders for file in folder.glob("domain/*.yaml")}


def class_vocabulary(domain: str, config_dir: str | None = None) -> Vocabulary:
    """The vocabulary that the class of a domain declares, without composing a configuration.

    Raises:
        KeyError: there is no such domain.
        AttributeError: its schema depends on settings.
    """
    vocabulary: Vocabulary = domain_class(domain, config_dir).schema.vocabulary
    return vocabulary


def domain_class(domain: str, config_dir: str | None = None) -> Any:
    """The class that the file of a domain names. Raises KeyError if there is no such domain."""
    module, _, attribute = _factory(domain, config_dir).partition(":")
    return getattr(import_module(module), attribute)


def default_domain_module() -> str:
    """The module of the domain that a run has unless another one is chosen."""
    text = (resource("conf") / "config.yaml").read_text(encoding="utf-8")
    (domain,) = re.findall(r"^  - domain: (\w+)", text, re.MULTILINE)
    return _factory(domain).partition(":")[0]


def _factory(domain: str, config_dir: str | None = None) -> str:
    """The class that the file of a domain names, as "module:Class"."""
    import yaml

    config = yaml.safe_load(domain_files(config_dir)[domain].read_text(encoding="utf-8"))
    return str(config.get("domain", config)["factory"])
