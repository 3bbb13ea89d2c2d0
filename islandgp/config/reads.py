"""The configuration keys that a run reads, and errors for overrides of keys that nothing reads.

A search and a supervisor declare keys of other groups in `Settings.reads`, and get only those:
`declared` removes the others from the settings that they are made with.
"""

from __future__ import annotations

import sys
from collections.abc import Collection, Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final, cast

from omegaconf import OmegaConf

from islandgp.config.errors import USER_ERRORS
from islandgp.config.settings import Settings, read_settings
from islandgp.config.sources import ConfigSource
from islandgp.errors import ConfigError, IslandError
from islandgp.gp.plan import RUN_READS, is_read
from islandgp.records.parameters import key_of

if TYPE_CHECKING:
    from islandgp.config.compose import Planned

SELECTIVE: Final = ("gp", "allocation", "curriculum", "library", "supervisor")
"""Groups of which a run may leave keys unread; those of all others act in every run."""

OF_DOMAINS: Final = ("curriculum", "library", "gp.generations")
"""Keys that describe a robot in its file `domain/NAME.yaml`, for any search and budget."""

SWITCHES: Final = {
    "rate": "supervisor.adapt_mutation",
    "tree": "supervisor.inject",
    "edits": "supervisor.edits",
}
"""The switch of each part of a supervisor's guidance."""


def keys_read(settings: Settings) -> frozenset[str]:
    """The keys of SELECTIVE groups that a run reads; a key includes all below it."""
    switches, gives = settings.supervisor, settings.supervisor.reads()
    parts = settings.search.factory.uses & gives.keys()
    on = {"rate": switches.adapt_mutation, "tree": switches.inject, "edits": switches.edits > 0}
    keys = {*settings.search.reads(), *(SWITCHES[part] for part in parts)}
    for part in parts:
        if on[part]:
            keys |= {*gives[part]}
    if settings.allocation is not None:
        keys |= {f"allocation.{slot}" for slot in type(settings.allocation).model_fields}
    if not (on["tree"] and "tree" in parts):
        keys.discard("allocation.injected")
    if settings.search.factory.uses:
        keys |= {"supervisor.name", "supervisor.factory"}
    if "rate" in settings.search.factory.uses:
        keys.add("gp.crisis")  # the run overrides the rate in a crisis
    if settings.gp.founders:
        keys.add("library")
    if "library" in keys and settings.library.folder is None:
        keys |= {"gp.mutation", "gp.trees", "curriculum.stages"}  # of the search for a library
    given = {"gp.generations"} if settings.budget.episodes else set()
    curriculum = _of_curriculum(settings, crisis="gp.crisis" in keys)
    return frozenset({*keys, *RUN_READS, *curriculum}) - given


def _of_curriculum(settings: Settings, *, crisis: bool) -> Iterator[str]:
    curriculum = settings.curriculum
    last = len(curriculum.stages) - 1
    yield "curriculum.last_only"
    yield f"curriculum.stages.{last}" if curriculum.last_only else "curriculum.stages"
    if crisis or settings.gp.reseed_every == "epoch" or (last and not curriculum.last_only):
        yield "curriculum.generations_per_epoch"


def acts(key: str, keys: Collection[str]) -> bool:
    """True if a key or group changes a run that reads `keys`, or parts of it."""
    key = key.replace("/", ".")
    return key.partition(".")[0] not in SELECTIVE or is_read(key, keys)


def must_be_read(jobs: Sequence[Planned], source: ConfigSource) -> None:
    """Checks that the jobs of a command read what it sets; warns of keys in the user's files.

    Raises:
        ConfigError: a job does not read a key that is swept over, or no job reads a fixed one.
    """
    keys = [keys_read(job.settings) for job in jobs]
    given = [{key_of(override): override for override in job.overrides} for job in jobs]
    fixed = set.intersection(*({*overrides.values()} for overrides in given))
    for job, own, overrides in zip(jobs, keys, given, strict=True):
        for key, override in overrides.items():
            among = keys if override in fixed else [own]
            if any(acts(key, each) for each in among) or (key == "supervisor" and among is keys):
                continue  # a fixed supervisor names the run
            raise ConfigError(f"{override}: {_unread(job.settings, [key], source)}")
    dead: dict[Path, list[str]] = {}
    for file, key in source.keys_of_user(jobs[0].overrides, jobs[0].config):
        of_robot = file.parent.name == "domain" and key.startswith(OF_DOMAINS)
        if not of_robot and not any(acts(key, each) for each in keys):
            dead.setdefault(file, []).append(key)
    for file, names in dead.items():
        print(f"islandgp: {file}: {_unread(jobs[0].settings, names, source)}", file=sys.stderr)


def _unread(settings: Settings, dead: Sequence[str], source: ConfigSource) -> str:
    """The sentence that a configuration does not read keys, with a choice that does."""
    names = ", ".join(dead)
    if "gp.generations" in dead:
        return f"budget.episodes={settings.budget.episodes} sets gp.generations; leave one out."
    choice = f"search={settings.search.name}"
    if dead[0].startswith(("library", "supervisor", "allocation")):
        choice += f" with supervisor={settings.supervisor.name}"
    other = next(_choices(settings, dead, source), "")
    remedy = f"{other} does; choose it, or leave the key out." if other else "leave it out."
    return f"{choice} does not read {names}; {remedy}"


def _choices(settings: Settings, dead: Sequence[str], source: ConfigSource) -> Iterator[str]:
    """The switch, or the options of `search`, then of `supervisor`, with which these keys act."""
    for part, switch in SWITCHES.items():
        value = 1 if part == "edits" else True
        on = {switch.removeprefix("supervisor."): value}
        supervisor = settings.supervisor.model_copy(update=on)
        keys = keys_read(settings.model_copy(update={"supervisor": supervisor}))
        if all(acts(key, keys) for key in dead):
            yield f"{switch}={str(value).lower()}"
    for group in ("search", "supervisor"):
        for option in source.options(group):
            try:
                composed = source.compose([f"{group}={option}"])
                OmegaConf.set_struct(composed, value=False)
                del composed["hydra"]  # its values are resolved only when Hydra runs
                other = read_settings(cast(Any, OmegaConf.to_container(composed, resolve=True)))
            except (*USER_ERRORS, IslandError):  # it needs more than this choice
                continue
            chosen = ("search", "allocation", "curriculum") if group == "search" else (group,)
            update = {each: getattr(other, each) for each in chosen}
            keys = keys_read(settings.model_copy(update=update))
            if all(acts(key, keys) for key in dead):
                yield f"{group}={option}"
