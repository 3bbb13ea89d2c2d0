"""The memory of an episode, which Python and the compiled functions share.

It is a record of numbers of eight bytes, with the addresses of its tables: garbage, humanoids,
stations, rocks, and the events of the schedule. Distances are in metres, times in steps, charge in
millionths of a percent; flags are whole numbers.
"""

from __future__ import annotations

from typing import Final

import numpy as np


def _record(whole: tuple[str, ...], real: tuple[str, ...]) -> np.dtype[np.void]:
    """A record of whole numbers and real numbers; each text has the names of several."""
    fields = [(name, np.int64) for names in whole for name in names.split()]
    return np.dtype(fields + [(name, np.float64) for names in real for name in names.split()])


HUMANOID: Final = _record(("body carried unseen asking_near look",), ("x y vx vy",))  # look: step
ITEM: Final = _record(("present discovered",), ("x y",))  # of garbage
TURN: Final = _record(("step humanoid",), ("vx vy",))
ROCK: Final = _record((), ("x y radius",))
STATION: Final = _record((), ("x y",))
EVENT: Final = _record(("step kind",), ("amount",))  # kind: index in events.EVENTS

EPISODE: Final = _record(
    whole=(
        "step phase end due wake",  # end of the episode; due, wake: steps of the next tick
        "stepwise timed may_coast",  # how it is simulated, see `episode.run_episode`
        "status resumed restarted ticks",  # of the tree; restarted: a leaf of a shared action
        "changed world_changed acted",  # by this tick: a flag, something that the next one may read
        "patrolling driving charging idle last_action",
        "battery spent drain_moving drain_standing charge",  # changes in a step
        "low_battery charge_below charge_again",
        "load capacity laps waypoint charger clearing_point fined_at item humanoid aim_end",
        "leg_end odometer rolling",  # step of the next leg, steps driven, whether the wheels turn
        "next_look next_humanoid_look",  # steps
        "spawn turn first_item room",  # next of the schedule; items that can still appear
        "accounted_until patrol_steps rewarded_segment event_count best_step negative_since",
        "length stagnation stagnation_low_battery negative second ask_from most_items",
        "clear_until clear_checked since_contact coasted shaken crowded",  # see `motion`
        "space body contacts_at board_at events_at columns cell_starts_at cell_items_at",
        "items_at items humanoids_at humanoids rocks_at rocks marks_at marks",  # and their counts
        "spawns_at spawns turns_at turns chargers_at chargers points_at points",
        "waypoints_at waypoints",
    ),
    real=(
        "x y vx vy heading_x heading_y",  # of the robot
        "wish_x wish_y wish_reach goal_x goal_y goal_reach",  # of this tick, of the present leg
        "lead free_distance aim_x aim_y",
        "dt stride humanoid_stride speed humanoid_speed radius humanoid_radius",
        "perception pickup_reach station_reach hand_over_reach patrol_segment side cell",
    ),
)
