"""The island's schema: actions, keys, counters and rewarded events; the functions of its actions.

Sections 2.2.2 and 2.2.3, Table 3.
"""

from __future__ import annotations

from typing import Final

from islandgp.domain import (
    FAILURE,
    RUNNING,
    SUCCESS,
    Action,
    Condition,
    Counter,
    Event,
    Schema,
    ShapeStyle,
    Vocabulary,
    flag,
    integer,
    number,
)

_ROOM: Final = Condition("robotCurrentExtraCapacity", ">=", 1)
_LOAD: Final = Condition("robotCurrentExtraCapacity", "<=", 29)
_GARBAGE: Final = Condition("foundGarbage", "is", 0)
_ASKED: Final = Condition("isHumanoidWantToClear", "is", 0)
_FULL: Final = Condition("batteryLevel", ">=", 100)
_NOT_FULL: Final = Condition("batteryLevel", "<", 95)
_ARRIVES: Final = frozenset({SUCCESS, RUNNING})
_BASE: Final = ("base",)
_BOTH: Final = ("base", "arm")
_LESS_ROOM: Final = {"robotCurrentExtraCapacity": -1}

VOCABULARY: Final = Vocabulary(
    domain="island",
    actions={
        "MoveToGarbage": Action(
            "drives to the nearest garbage in sight; succeeds within reach of it,"
            " fails when none is in sight",
            to_start=(_GARBAGE,),
            to_succeed=(_GARBAGE,),
            uses=_BASE,
        ),
        "PickupGarbage": Action(
            "picks up one item within reach; succeeds at once,"
            " fails when nothing is in reach or there is no room",
            statuses=frozenset({FAILURE, SUCCESS}),
            to_start=(_GARBAGE, _ROOM),
            changes=_LESS_ROOM,
            after=("MoveToGarbage",),
            uses=("arm",),
        ),
        "SeekCharger": Action(
            "drives to the nearest charger; succeeds on arrival",
            statuses=_ARRIVES,
            uses=_BASE,
        ),
        "ExecuteCharge": Action(
            "charges; succeeds when the battery is full,"
            " fails away from a charger or at 50 % and above",
            to_start=(_NOT_FULL,),
            to_succeed=(_FULL,),
            after=("SeekCharger",),
            uses=_BASE,
        ),
        "MoveToHumanoid": Action(
            "drives to the nearest humanoid in sight that asks for clearing and takes over its"
            " garbage; fails when none asks or there is no room",
            to_start=(_ASKED, _ROOM),
            to_succeed=(_ASKED,),
            changes=_LESS_ROOM,
            uses=_BOTH,
        ),
        "DeliverToClearingPoint": Action(
            "drives to the nearest clearing point and unloads; succeeds when something was"
            " unloaded, fails with a penalty when the robot is empty",
            to_succeed=(_LOAD,),
            changes={"robotCurrentExtraCapacity": 1},
            after=("MoveToHumanoid", "PickupGarbage"),
            uses=_BOTH,
        ),
        "PatrolWaypoint": Action(
            "drives to the next patrol waypoint; succeeds on arrival",
            statuses=_ARRIVES,
            uses=_BASE,
        ),
    },
    keys={
        "batteryLevel": number(
            "charge of the battery in percent, 0 to 100", 0, 100, step=5, most=100, noise=2
        ),
        "robotCurrentExtraCapacity": integer(
            "room left for garbage in items, 0 to 30", 0, 30, noise=1
        ),
        "lap": integer("patrol rounds finished, from 0", 0, 5, noise=0.1),
        "foundGarbage": flag("garbage is in sight"),
        "isHumanoidWantToClear": flag("a humanoid in sight asks for clearing"),
    },
)

SCHEMA: Final = Schema(
    vocabulary=VOCABULARY,
    components={
        "garbage": "picking up garbage from the ground",
        "battery": "charging, and the penalty for an empty battery",
        "humanoid": "taking over garbage from humanoids",
        "delivery": "deliveries, and the penalty for empty ones",
        "leftover": "the penalty for garbage left lying at the end",
        "patrol": "patrolling and discovering",
        "idle": "the penalty for idleness",
        "collision": "the penalty for touching humanoids",
    },
    events={
        "pickup": Event("an item is picked up from the ground", "items"),
        "interaction": Event("garbage is taken over from a humanoid", "items"),
        "charge": Event("a charging attempt begins", "battery level in percent"),
        "shutdown": Event("the battery is empty"),
        "delivery": Event("the load is delivered", "items"),
        "empty_delivery": Event("there is nothing to deliver"),
        "patrol": Event("a stretch of patrol holds a discovery"),
        "discovery": Event("things are seen for the first time while on patrol", "things"),
        "idle": Event("a second of idleness passes", "seconds of idleness so far"),
        "collision": Event("a humanoid is touched"),
        "leftover": Event("the episode ends with garbage on the ground", "items"),
    },
    counters={
        "pickups": Counter("items picked up from the ground"),
        "interactions": Counter("times that garbage was taken over"),
        "deliveries": Counter("deliveries of something"),
        "charges": Counter("charging attempts"),
        "gathered": Counter("items picked up or taken over"),
        "delivered": Counter("items delivered"),
        "collisions": Counter("humanoids touched"),
        "distance": Counter("distance driven", "m"),
        "inactive": Counter("time since the last action other than moving", "s"),
        "laps": Counter("patrol rounds"),
        "battery": Counter("charge of the battery at the end", "%"),
    },
    task=(
        "Each tree drives a robot on an island for one episode. The robot can pick up garbage from"
        " the ground, take garbage from humanoids that ask for it, deliver garbage at clearing"
        " points, and charge its battery. A robot whose battery is empty, or which stands still,"
        " earns nothing."
    ),
    habits=(
        "Children of a selector stand in order of urgency.",
        "A guard that starts an activity which ends its own condition, such as charging or"
        " unloading, needs `abort lower`. With the default it would stop itself at once.",
        "SeekCharger comes before ExecuteCharge, MoveToGarbage before PickupGarbage.",
        "DeliverToClearingPoint needs a guard on robotCurrentExtraCapacity: an empty delivery costs"
        " points.",
        "The last child of the outermost selector is PatrolWaypoint, or contains it.",
    ),
    endings={
        "time": "it had its full length",
        "stagnation": "its fitness had not risen for too long",
        "negative": "its fitness was negative for too long",
        "shutdown": "the battery was empty",
    },
    styles={
        "robot": ShapeStyle("robot", "R", "triangle", "#1a73e8"),
        "sight": ShapeStyle("what the robot perceives", " ", "ring", "#1a73e8"),
        "goal": ShapeStyle("where it drives to", "x", "cross", "#1a73e8"),
        "garbage": ShapeStyle("garbage", "\N{MIDDLE DOT}", "circle", "#c0392b"),
        "humanoid": ShapeStyle("humanoid, with its items", "h", "circle", "#8e44ad"),
        "asking": ShapeStyle("humanoid that asks for clearing", "H", "circle", "#d81b9c"),
        "charger": ShapeStyle("charger", "C", "square", "#d4a017"),
        "clearing": ShapeStyle("clearing point", "D", "diamond", "#2471a3"),
        "waypoint": ShapeStyle("patrol waypoint", "+", "cross", "#2e8b57"),
        "rock": ShapeStyle("rock or tree", "o", "circle", "#9a9a9a"),
    },
    delay=20,
)
