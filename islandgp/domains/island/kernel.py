"""The loop between two changes of the sensors, and the search for garbage, compiled by numba.

The loop does the same as `episode.advance` until a sensor changes: it steps Chipmunk, turns
humanoids, and looks around when a look is due. It stops before a look that earns points or shows
another humanoid, which Python then repeats. Outcomes are equal to the last bit.

`ints` and `floats` are the two arrays of an episode; layout.py names their indices.

While no body can touch anything, the bodies coast: each moves on a straight line. Then the
positions are added up here, in the same order and with the same rounding as in Chipmunk. Bodies
only coast SETTLE steps after a contact, when Chipmunk no longer stores it. The order in which
Chipmunk solves several contacts of one body depends on earlier steps, so a body with two contacts
at once sets CROWDED, and the episode is repeated without coasting.
"""

from __future__ import annotations

from functools import partial
from math import ceil, hypot, inf, sqrt

from numba import njit, types

from islandgp.domains.island import layout
from islandgp.domains.island.chipmunk import (
    flag_array,
    float_array,
    int_array,
    place,
    position,
    steer,
    step_space,
    velocity,
)
from islandgp.domains.island.robot import TOLERANCE
from islandgp.domains.island.sensing import TOGETHER
from islandgp.domains.island.world import FAR

SETTLE = 4  # steps of Chipmunk after a contact, which it stores for three


@njit
def look_for_garbage(ints, floats, step, x, y, discover):
    """Looks for garbage as `sensing.look_for_garbage` does, and returns the step of the next look.

    With `discover`, new items are marked as discovered; without, the result is -1 if there are any.
    """
    xs, ys, present, discovered = (
        float_array(ints[layout.ITEM_X]),
        float_array(ints[layout.ITEM_Y]),
        flag_array(ints[layout.PRESENT]),
        flag_array(ints[layout.DISCOVERED]),
    )
    cell_starts, cell_items = (
        int_array(ints[layout.CELL_STARTS]),
        int_array(ints[layout.CELL_ITEMS]),
    )
    ux, uy, width, stride = (
        floats[layout.HEADING_X],
        floats[layout.HEADING_Y],
        floats[layout.CELL_WIDTH],
        floats[layout.STRIDE],
    )
    column, row, east, north = x // width, y // width, x % width, y % width
    border_x = (width - east) / ux if ux > 0 else east / -ux if ux < 0 else inf
    border_y = (width - north) / uy if uy > 0 else north / -uy if uy < 0 else inf
    # Metres until the last visible item is out of sight, a new item comes into sight, and a
    # discovered one does so again.
    end, change, again = 0.0, min(border_x, border_y) + stride, inf
    in_sight, discoveries = 0, 0
    cell = (int(row) + 1) * ints[layout.COLUMNS] + int(column) + 1
    for m in range(cell_starts[cell], cell_starts[cell + 1]):
        i = cell_items[m]
        if not present[i]:
            continue
        dx, dy = xs[i] - x, ys[i] - y
        gap = dx * dx + dy * dy
        if gap <= floats[layout.SIGHT_SQUARED]:
            in_sight = 1
            if not discovered[i]:
                if not discover:
                    return -1
                discovered[i] = 1
                discoveries += 1
        along = dx * ux + dy * uy
        half = floats[layout.SIGHT_SQUARED] - gap + along * along
        if half < -TOLERANCE:
            continue
        half = sqrt(half) if half > 0 else 0.0
        if along <= half:
            end = max(end, along + half)
        elif discovered[i]:
            again = min(again, along - half)
        else:
            change = min(change, along - half)
    ints[layout.GARBAGE_IN_SIGHT], ints[layout.DISCOVERIES] = in_sight, discoveries
    change = min(change, end if in_sight else again)
    return step + _steps_to(change - TOLERANCE, stride) if ints[layout.DRIVING] else FAR


@njit
def _steps_to(distance, stride):
    return int(max(1.0, ceil(distance / stride)))


@njit
def humanoids_due(ints, floats, step, x, y):
    """The step of the next look at a humanoid; -1: something new is seen now."""
    motion, carried, look_steps = (
        float_array(ints[layout.MOTION]),
        int_array(ints[layout.CARRIED]),
        int_array(ints[layout.LOOK_STEPS]),
    )
    unseen, asking_near = flag_array(ints[layout.UNSEEN]), flag_array(ints[layout.ASKING_NEAR])
    earliest = FAR
    for h in range(ints[layout.HUMANOIDS]):
        if look_steps[h] <= step + TOGETHER:
            asks, inside, due = carried[h] >= ints[layout.ASK_FROM], False, FAR
            if asks or unseen[h]:
                hx, hy = motion[4 * h + 4], motion[4 * h + 5]
                beyond = hypot(hx - x, hy - y) - floats[layout.PERCEPTION]
                inside = beyond <= TOLERANCE
                due = step + _steps_to(
                    abs(beyond) - TOLERANCE, floats[layout.STRIDE] + floats[layout.HUMANOID_STRIDE]
                )
            if (inside and unseen[h]) or (inside and asks) != (asking_near[h] != 0):
                look_steps[h] = step
                return -1
            look_steps[h] = due
        earliest = min(earliest, look_steps[h])
    return earliest


@njit
def turn_humanoids(ints, step, turn):
    """The humanoids of this step's turns turn; returns the index of the next turn."""
    turn_steps, turn_humanoids, velocities = (
        int_array(ints[layout.TURN_STEPS]),
        int_array(ints[layout.TURN_HUMANOIDS]),
        float_array(ints[layout.TURN_VELOCITIES]),
    )
    bodies, motion = int_array(ints[layout.BODIES]), float_array(ints[layout.MOTION])
    carried, look_steps = int_array(ints[layout.CARRIED]), int_array(ints[layout.LOOK_STEPS])
    while turn_steps[turn] == step:
        h = turn_humanoids[turn]
        vx, vy = velocities[2 * turn], velocities[2 * turn + 1]
        steer(bodies[h + 1], vx, vy)
        motion[4 * h + 6], motion[4 * h + 7] = vx, vy
        if carried[h] < ints[layout.MAX_ITEMS]:
            carried[h] += 1
            if carried[h] == ints[layout.ASK_FROM]:
                look_steps[h] = step
                ints[layout.NEXT_HUMANOID_LOOK] = min(ints[layout.NEXT_HUMANOID_LOOK], step)
        turn += 1
    return turn


@njit
def fixed_gap(ints, floats, x, y, radius):
    """Metres from a body to the nearest wall or rock, and how many of them it touches."""
    side, rocks, slack = floats[layout.SIDE], float_array(ints[layout.ROCKS]), TOLERANCE
    nearest, touched = inf, 0
    for gap in (x - radius, y - radius, side - x - radius, side - y - radius):
        nearest = min(nearest, gap)
        touched += gap <= slack
    for i in range(ints[layout.ROCK_COUNT]):
        dx, dy, reach = rocks[3 * i] - x, rocks[3 * i + 1] - y, rocks[3 * i + 2] + radius
        square, limit = dx * dx + dy * dy, max(nearest, slack) + reach
        if square <= limit * limit:
            gap = sqrt(square) - reach
            nearest = min(nearest, gap)
            touched += gap <= slack
    return nearest, touched


@njit
def too_fast(vx, vy, dt, stride):
    """True if a contact has made a body faster than it moves by itself."""
    return hypot(vx, vy) * dt > stride + 1e-9


@njit
def clear_steps(ints, floats):
    """Steps in which no body can touch anything; -1: one touches two things.

    A contact now sets SINCE_CONTACT to 0.
    """
    motion, slack, touches = float_array(ints[layout.MOTION]), TOLERANCE, 0
    x, y = motion[0], motion[1]
    nearest, touched = fixed_gap(ints, floats, x, y, floats[layout.ROBOT_RADIUS])
    steps = (nearest - slack) / floats[layout.STRIDE]
    fast = too_fast(motion[2], motion[3], floats[layout.DT], floats[layout.STRIDE])
    for at in range(4, 4 * ints[layout.HUMANOIDS] + 4, 4):
        hx, hy = motion[at], motion[at + 1]
        nearest, fixed = fixed_gap(ints, floats, hx, hy, floats[layout.HUMANOID_RADIUS])
        gap = hypot(hx - x, hy - y) - floats[layout.ROBOT_RADIUS] - floats[layout.HUMANOID_RADIUS]
        if gap <= slack:
            touched += 1
            fixed += 1
        if fixed > 1:
            return -1
        touches += fixed
        steps = min(
            steps,
            (nearest - slack) / floats[layout.HUMANOID_STRIDE],
            (gap - slack) / (floats[layout.STRIDE] + floats[layout.HUMANOID_STRIDE]),
        )
        fast = fast or too_fast(
            motion[at + 2], motion[at + 3], floats[layout.DT], floats[layout.HUMANOID_STRIDE]
        )
    if touched > 1:
        return -1
    if touched or touches:
        ints[layout.SINCE_CONTACT] = 0
    return 0 if fast else max(0, int(min(steps, FAR)))


@njit
def read_bodies(ints):
    """Copies positions and velocities from Chipmunk."""
    bodies, motion = int_array(ints[layout.BODIES]), float_array(ints[layout.MOTION])
    for i in range(ints[layout.HUMANOIDS] + 1):
        motion[4 * i], motion[4 * i + 1] = position(bodies[i])
        motion[4 * i + 2], motion[4 * i + 3] = velocity(bodies[i])


@njit
def place_bodies(ints):
    """Passes the positions of bodies that have coasted to Chipmunk."""
    bodies, motion = int_array(ints[layout.BODIES]), float_array(ints[layout.MOTION])
    if ints[layout.COASTED]:
        ints[layout.COASTED] = 0
        for i in range(ints[layout.HUMANOIDS] + 1):
            place(bodies[i], motion[4 * i], motion[4 * i + 1])


@njit
def coasted(x, y, vx, vy, dt, steps):
    """The position, after `steps` steps, of a body that touches nothing."""
    dx, dy = vx * dt, vy * dt
    for _ in range(steps):
        x += dx
        y += dy
    return x, y


def coast(body, dt, steps):
    """Moves a body that touches nothing by `steps` steps."""
    x, y = position(body)
    vx, vy = velocity(body)
    x, y = coasted(x, y, vx, vy, dt, steps)
    place(body, x, y)


@njit
def coast_all(ints, dt, steps):
    """Moves all bodies by `steps` steps, in the array only."""
    motion = float_array(ints[layout.MOTION])
    for at in range(0, 4 * ints[layout.HUMANOIDS] + 4, 4):
        x, y, vx, vy = motion[at], motion[at + 1], motion[at + 2], motion[at + 3]
        motion[at], motion[at + 1] = coasted(x, y, vx, vy, dt, steps)
    ints[layout.COASTED] = 1


@njit
def move(ints, floats, step, stop):
    """Steps to `stop`, or to the first contact of the robot; returns the step."""
    touching = flag_array(ints[layout.TOUCHING])
    while step < stop:
        if (
            ints[layout.MAY_COAST]
            and ints[layout.CLEAR_UNTIL] <= step
            and ints[layout.CLEAR_CHECKED] != step
        ):
            ints[layout.CLEAR_UNTIL] = step + clear_steps(ints, floats)
            ints[layout.CLEAR_CHECKED] = step
        if step < ints[layout.CLEAR_UNTIL] and ints[layout.SINCE_CONTACT] >= SETTLE:
            steps = min(stop, ints[layout.CLEAR_UNTIL]) - step
            coast_all(ints, floats[layout.DT], steps)
            step += steps
            continue
        place_bodies(ints)
        step_space(ints[layout.SPACE], floats[layout.DT])
        read_bodies(ints)
        step += 1
        ints[layout.SINCE_CONTACT] += 1
        if ints[layout.MAY_COAST]:
            clear = clear_steps(ints, floats)
            ints[layout.CLEAR_UNTIL], ints[layout.CLEAR_CHECKED] = step + clear, step
            if clear < 0:
                ints[layout.CROWDED] = 1
                break
        if touching[0]:
            break
    return step


@njit
def look_around(ints, floats, step):
    """Looks around if a look is due; True if garbage came or left, or if Python has to look."""
    if step < ints[layout.NEXT_GARBAGE_LOOK] and step < ints[layout.NEXT_HUMANOID_LOOK]:
        return False
    motion, in_sight = float_array(ints[layout.MOTION]), ints[layout.GARBAGE_IN_SIGHT]
    x, y = motion[0], motion[1]
    if step >= ints[layout.NEXT_GARBAGE_LOOK]:
        due = look_for_garbage(ints, floats, step, x, y, not ints[layout.PATROLLING])
        if due < 0:  # new items earn points on patrol
            return True
        ints[layout.NEXT_GARBAGE_LOOK] = due
    if step >= ints[layout.NEXT_HUMANOID_LOOK]:
        due = humanoids_due(ints, floats, step, x, y)
        ints[layout.NEXT_HUMANOID_LOOK] = max(due, step)
        if due < 0:
            return True
    return ints[layout.GARBAGE_IN_SIGHT] != in_sight


def run(ints_at, floats_at, end):
    """Simulates until step `end`, a contact, or a look that changes something."""
    ints, floats = int_array(ints_at), float_array(floats_at)
    touching, turn_steps = flag_array(ints[layout.TOUCHING]), int_array(ints[layout.TURN_STEPS])
    motion, step, turn = float_array(ints[layout.MOTION]), ints[layout.STEP], ints[layout.TURN]
    read_bodies(ints)
    if ints[layout.NEXT_GARBAGE_LOOK] == layout.BEFORE_MOVING:
        ints[layout.NEXT_GARBAGE_LOOK] = look_for_garbage(
            ints, floats, step, motion[0], motion[1], True
        )
    while step < end:
        look = min(ints[layout.NEXT_GARBAGE_LOOK], ints[layout.NEXT_HUMANOID_LOOK])
        stop = min(turn_steps[turn], end, max(look, step + 1))
        step = move(ints, floats, step, stop)
        if touching[0] or ints[layout.CROWDED]:
            break
        turn = turn_humanoids(ints, step, turn)
        if look_around(ints, floats, step):
            break
    place_bodies(ints)
    ints[layout.STEP], ints[layout.TURN] = step, turn


def look(ints_at, floats_at):
    """Looks for garbage from the position of the robot."""
    ints, floats = int_array(ints_at), float_array(floats_at)
    x, y = position(int_array(ints[layout.BODIES])[0])
    ints[layout.NEXT_GARBAGE_LOOK] = look_for_garbage(ints, floats, ints[layout.STEP], x, y, True)


_INT, _REAL = types.int64, types.float64
_compiled = partial(njit, no_cpython_wrapper=True, no_cfunc_wrapper=True, error_model="numpy")
FUNCTIONS = {
    "run": _compiled(types.void(_INT, _INT, _INT))(run),
    "look": _compiled(types.void(_INT, _INT))(look),
    "coast": _compiled(types.void(_INT, _REAL, _INT))(coast),
}
"""The functions that Python calls, by name; compiled when this module is imported."""
