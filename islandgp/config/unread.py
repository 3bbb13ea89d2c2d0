"""The message for keys that a configuration does not read, with a choice that reads them."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING, Any, cast

from omegaconf import OmegaConf

from islandgp.config.errors import USER_ERRORS
from islandgp.config.reads import acts, keys_read
from islandgp.config.settings import Settings, read_settings
from islandgp.errors import IslandError

if TYPE_CHECKING:
    from islandgp.config.sources import ConfigSource


def unread(settings: Settings, dead: Sequence[str], source: ConfigSource) -> str:
    """The sentence that a configuration does not read keys, with a choice that does."""
    names = ", ".join(dead)
    if "gp.generations" in dead:
        return f"budget.episodes={settings.budget.episodes} sets gp.generations; leave one out."
    group = dead[0].partition(".")[0]
    choice = f"search={settings.search.name}"
    if group in ("library", "supervisor"):
        choice += f" with supervisor={settings.supervisor.name}"
    other = next(_choices(settings, dead, source), "")
    remedy = f"{other} does; choose it, or leave the key out." if other else "leave it out."
    return f"{choice} does not read {names}; {remedy}"


def _choices(settings: Settings, dead: Sequence[str], source: ConfigSource) -> Iterator[str]:
    """The options of `search`, then of `supervisor`, with which a run reads these keys."""
    for group in ("search", "supervisor"):
        for option in source.options(group):
            try:
                composed = source.compose([f"{group}={option}"])
                OmegaConf.set_struct(composed, value=False)
                del composed["hydra"]  # its values are resolved only when Hydra runs
                values = cast(dict[str, Any], OmegaConf.to_container(composed, resolve=True))
                other = read_settings(values)
            except (*USER_ERRORS, IslandError):  # it needs more than this choice
                continue
            keys = keys_read(settings.model_copy(update={group: getattr(other, group)}))
            if all(acts(key, keys) for key in dead):
                yield f"{group}={option}"
