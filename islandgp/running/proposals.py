"""Installed searches that suit a run's domain better than the one it used."""

from __future__ import annotations

from collections.abc import Iterator

import yaml

from islandgp.config.settings import Settings
from islandgp.installed import conf_folders
from islandgp.plugin import imported


def proposals(settings: Settings, *, stuck: bool) -> Iterator[str]:
    """A line for each installed search that says it suits the run, and on a tree to start from.

    A search says so by a static method `suits(vocabulary, stuck)`, which returns the reason, or ""
    if it does not suit. After such a search, no other is proposed.

    Args:
        settings: of the run.
        stuck: no individual has reached a milestone or shown the behaviours.
    """
    vocabulary = settings.make_domain().schema.vocabulary
    if stuck and not settings.start:
        yield "Perhaps `start=FILE.bt`: your own tree in generation 0, which evolution improves."
    if hasattr(settings.search.factory, "suits"):
        return
    for folder in conf_folders():
        for file in sorted(folder.glob("search/*.yaml")):
            kind = imported(yaml.safe_load(file.read_text("utf-8"))["search"]["factory"])
            if reason := getattr(kind, "suits", lambda *_: "")(vocabulary, stuck):
                yield f"Perhaps `search={file.stem}`: {reason}."
