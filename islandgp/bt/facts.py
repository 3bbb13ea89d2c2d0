"""What is known of each action without running it: how it can end, and what it needs.

The statuses are part of what an action is, whatever the configuration; so they
may be used to rewrite trees. What an action needs holds on an island with the
default settings; it is used for warnings only. Tests compare both with what
actions do in episodes.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final, NamedTuple

from islandgp.bt.node import ACTIONS, FAILURE, KEYS, RUNNING, SUCCESS


class Condition(NamedTuple):
    """A `when` without its abort rule."""

    key: str
    operator: str
    number: float


@dataclass(frozen=True, slots=True)
class Fact:
    """What is known of an action."""

    statuses: frozenset[int]  # that it can return
    to_start: tuple[Condition, ...] = ()  # what it fails at once without
    to_succeed: tuple[Condition, ...] = ()  # true on the blackboard of the tick in which it does
    room: int = 0  # how it changes the room for garbage when it succeeds: -1 less, 1 more


_ANY: Final = frozenset({FAILURE, SUCCESS, RUNNING})
_ROOM: Final = Condition("robotCurrentExtraCapacity", ">=", 1)
_LOAD: Final = Condition("robotCurrentExtraCapacity", "<=", 29)
_GARBAGE: Final = Condition("foundGarbage", "is", 0)
_ASKED: Final = Condition("isHumanoidWantToClear", "is", 0)
_FULL: Final = Condition("batteryLevel", ">=", 100)
_NOT_FULL: Final = Condition("batteryLevel", "<", 95)

FACTS: Final[dict[str, Fact]] = {
    "MoveToGarbage": Fact(_ANY, (_GARBAGE,), (_GARBAGE,)),
    "PickupGarbage": Fact(frozenset({FAILURE, SUCCESS}), (_GARBAGE, _ROOM), room=-1),
    "SeekCharger": Fact(frozenset({SUCCESS, RUNNING})),
    "ExecuteCharge": Fact(_ANY, (_NOT_FULL,), (_FULL,)),
    "MoveToHumanoid": Fact(_ANY, (_ASKED, _ROOM), (_ASKED,), room=-1),
    "DeliverToClearingPoint": Fact(_ANY, (), (_LOAD,), room=1),
    "PatrolWaypoint": Fact(frozenset({SUCCESS, RUNNING})),
}
assert FACTS.keys() == ACTIONS.keys()

UNKNOWN: Final = Fact(_ANY)
"""Of an action that is not in the table."""

DOMAIN: Final[tuple[Condition, ...]] = (
    *(Condition(name, ">=", key.low) for name, key in KEYS.items() if not key.flag),
    Condition("batteryLevel", "<=", 100),
)
"""What is always true of the blackboard, whatever the configuration."""


def fact(action: str) -> Fact:
    """What is known of an action; of one that is not declared, nothing."""
    return FACTS.get(action, UNKNOWN)
