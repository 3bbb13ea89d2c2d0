"""The actions of the island by name, as functions of an episode's state."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING, Final

if TYPE_CHECKING:
    from islandgp.domains.island.state import State

IslandAction = Callable[["State", bool], int]
"""(island, fresh) to a status; `docs/extending.md` shows how to write one."""


def _action(number: int) -> IslandAction:
    return lambda island, fresh: island.perform(number, fresh)


NAMES: Final = (
    "MoveToGarbage",
    "PickupGarbage",
    "SeekCharger",
    "ExecuteCharge",
    "MoveToHumanoid",
    "DeliverToClearingPoint",
    "PatrolWaypoint",
)
"""The actions of `behaviour`, in the order of their numbers."""

ACTIONS: Final[Mapping[str, IslandAction]] = {
    name: _action(number) for number, name in enumerate(NAMES)
}
