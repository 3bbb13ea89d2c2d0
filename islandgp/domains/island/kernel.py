"""The loop between two changes of the sensors, and the look for garbage, compiled by numba.

It does what `episode.advance` does until a sensor changes: Chipmunk steps, humanoids turn, and
looks that are due are made. It stops before a look that earns points or shows another humanoid,
and Python repeats that look. Outcomes are the same to the last bit.

`n` is the array of whole numbers of an episode, `f` that of floats; layout.py names their indices.

While no body can touch anything, each moves on a straight line. In such steps positions are added
up directly, in the same order and with the same rounding as in Chipmunk. Chipmunk makes at least
SETTLE steps after each contact, and has forgotten it by then. The order in which it solves several
contacts of one body depends on the steps before. So a body with two contacts at once sets CROWDED,
and the episode is repeated with every step.
"""

from __future__ import annotations

from functools import partial
from math import ceil, hypot, inf, sqrt

from llvmlite import ir
from numba import njit, types
from numba.core import cgutils
from numba.extending import intrinsic

from islandgp.domains.island import layout as k
from islandgp.domains.island.robot import TOLERANCE
from islandgp.domains.island.sensing import TOGETHER
from islandgp.domains.island.world import FAR

SETTLE = 4  # steps of Chipmunk after a contact, which it forgets after three
DOUBLE, ADDRESS = ir.DoubleType(), ir.IntType(8).as_pointer()


def _pointer(item):
    """A function that makes an address a pointer to items."""

    @intrinsic
    def pointer(_typing, _address):
        def code(context, builder, signature, args):
            return builder.inttoptr(args[0], context.get_value_type(signature.return_type))

        return types.CPointer(item)(types.int64), code

    return pointer


floats, ints, flags = map(_pointer, (types.float64, types.int64, types.uint8))


def _call(builder, result, name, values):
    """A call of a function of Chipmunk."""
    values = [builder.inttoptr(values[0], ADDRESS), *values[1:]]
    kind = ir.FunctionType(result, [value.type for value in values])
    return builder.call(cgutils.get_or_insert_function(builder.module, kind, name), values)


@intrinsic
def step_space(_typing, _space, _dt):
    """cpSpaceStep(space, dt)."""

    def code(context, builder, _signature, args):
        _call(builder, ir.VoidType(), "cpSpaceStep", args)
        return context.get_dummy_value()

    return types.void(types.int64, types.float64), code


@intrinsic
def steer(_typing, _body, _x, _y):
    """cpBodySetVelocity(body, {x, y}): a pair goes as two numbers outside of Windows."""

    def code(context, builder, _signature, args):
        _call(builder, ir.VoidType(), "cpBodySetVelocity", args)
        return context.get_dummy_value()

    return types.void(types.int64, types.float64, types.float64), code


@intrinsic
def place(_typing, _body, _x, _y):
    """cpBodySetPosition(body, {x, y})."""

    def code(context, builder, _signature, args):
        _call(builder, ir.VoidType(), "cpBodySetPosition", args)
        return context.get_dummy_value()

    return types.void(types.int64, types.float64, types.float64), code


def _pair(name):
    """A function of Chipmunk that returns a vector of a body."""

    @intrinsic
    def pair(_typing, _body):
        def code(context, builder, signature, args):
            at = _call(builder, ir.LiteralStructType([DOUBLE, DOUBLE]), name, args)
            values = [builder.extract_value(at, i) for i in range(2)]
            return context.make_tuple(builder, signature.return_type, values)

        return types.UniTuple(types.float64, 2)(types.int64), code

    return pair


position, velocity = _pair("cpBodyGetPosition"), _pair("cpBodyGetVelocity")


@njit
def look_for_garbage(n, f, step, x, y, discover):
    """Looks for garbage as `sensing.look_for_garbage` does, and returns the step of the next look.

    With `discover`, new items are marked as seen. Without, the result is -1 if there are any.
    """
    xs, ys, there, seen = floats(n[k.X]), floats(n[k.Y]), flags(n[k.THERE]), flags(n[k.SEEN])
    first, members = ints(n[k.FIRST]), ints(n[k.MEMBERS])
    ux, uy, cell, stride = f[k.HEADING_X], f[k.HEADING_Y], f[k.CELL], f[k.STRIDE]
    column, row, east, north = x // cell, y // cell, x % cell, y % cell
    border_x = (cell - east) / ux if ux > 0 else east / -ux if ux < 0 else inf
    border_y = (cell - north) / uy if uy > 0 else north / -uy if uy < 0 else inf
    last, change, back = 0.0, min(border_x, border_y) + stride, inf
    in_sight, new = 0, 0
    at = (int(row) + 1) * n[k.COLUMNS] + int(column) + 1
    for m in range(first[at], first[at + 1]):
        i = members[m]
        if not there[i]:
            continue
        dx, dy = xs[i] - x, ys[i] - y
        gap = dx * dx + dy * dy
        if gap <= f[k.SIGHT]:
            in_sight = 1
            if not seen[i]:
                if not discover:
                    return -1
                seen[i] = 1
                new += 1
        along = dx * ux + dy * uy
        half = f[k.SIGHT] - gap + along * along
        if half < -TOLERANCE:
            continue
        half = sqrt(half) if half > 0 else 0.0
        if along <= half:
            last = max(last, along + half)
        elif seen[i]:
            back = min(back, along - half)
        else:
            change = min(change, along - half)
    n[k.FOUND], n[k.NEW] = in_sight, new
    change = min(change, last if in_sight else back)
    return step + _steps_to(change - TOLERANCE, stride) if n[k.DRIVING] else FAR


@njit
def _steps_to(distance, stride):
    return int(max(1.0, ceil(distance / stride)))


@njit
def people_due(n, f, step, x, y):
    """The step of the next look at a humanoid; -1: something new is seen now."""
    motion, items, dues = floats(n[k.MOTION]), ints(n[k.ITEMS]), ints(n[k.DUES])
    unseen, near = flags(n[k.UNSEEN]), flags(n[k.NEAR])
    least = FAR
    for h in range(n[k.PEOPLE]):
        if dues[h] <= step + TOGETHER:
            asks, inside, due = items[h] >= n[k.ASK_FROM], False, FAR
            if asks or unseen[h]:
                hx, hy = motion[4 * h + 4], motion[4 * h + 5]
                beyond = hypot(hx - x, hy - y) - f[k.PERCEPTION]
                inside = beyond <= TOLERANCE
                due = step + _steps_to(abs(beyond) - TOLERANCE, f[k.STRIDE] + f[k.WALK])
            if (inside and unseen[h]) or (inside and asks) != (near[h] != 0):
                dues[h] = step
                return -1
            dues[h] = due
        least = min(least, dues[h])
    return least


@njit
def turn_people(n, step, turn):
    """The humanoids of this step's turns turn; returns the index of the next turn."""
    turn_step, turn_who, velocity = (
        ints(n[k.TURN_STEP]),
        ints(n[k.TURN_WHO]),
        floats(n[k.TURN_VELOCITY]),
    )
    bodies, motion = ints(n[k.BODIES]), floats(n[k.MOTION])
    items, dues = ints(n[k.ITEMS]), ints(n[k.DUES])
    while turn_step[turn] == step:
        h = turn_who[turn]
        vx, vy = velocity[2 * turn], velocity[2 * turn + 1]
        steer(bodies[h + 1], vx, vy)
        motion[4 * h + 6], motion[4 * h + 7] = vx, vy
        if items[h] < n[k.MOST_ITEMS]:
            items[h] += 1
            if items[h] == n[k.ASK_FROM]:
                dues[h] = step
                n[k.PEOPLE_DUE] = min(n[k.PEOPLE_DUE], step)
        turn += 1
    return turn


@njit
def fixed_gap(n, f, x, y, radius):
    """Metres from a body to the nearest wall or rock, and how many of them it touches."""
    side, rocks, slack = f[k.SIDE], floats(n[k.ROCK]), TOLERANCE
    least, touched = inf, 0
    for gap in (x - radius, y - radius, side - x - radius, side - y - radius):
        least = min(least, gap)
        touched += gap <= slack
    for i in range(n[k.ROCKS]):
        dx, dy, reach = rocks[3 * i] - x, rocks[3 * i + 1] - y, rocks[3 * i + 2] + radius
        square, limit = dx * dx + dy * dy, max(least, slack) + reach
        if square <= limit * limit:
            gap = sqrt(square) - reach
            least = min(least, gap)
            touched += gap <= slack
    return least, touched


@njit
def too_fast(vx, vy, dt, stride):
    """True if a contact has made a body faster than it moves by itself."""
    return hypot(vx, vy) * dt > stride + 1e-9


@njit
def clear_steps(n, f):
    """Steps in which no body can touch anything; -1: one touches two things.

    A contact now sets QUIET, the number of steps since the last one, to 0.
    """
    motion, slack, touches = floats(n[k.MOTION]), TOLERANCE, 0
    x, y = motion[0], motion[1]
    least, touched = fixed_gap(n, f, x, y, f[k.ROBOT_RADIUS])
    steps = (least - slack) / f[k.STRIDE]
    fast = too_fast(motion[2], motion[3], f[k.DT], f[k.STRIDE])
    for at in range(4, 4 * n[k.PEOPLE] + 4, 4):
        hx, hy = motion[at], motion[at + 1]
        least, fixed = fixed_gap(n, f, hx, hy, f[k.HUMANOID_RADIUS])
        gap = hypot(hx - x, hy - y) - f[k.ROBOT_RADIUS] - f[k.HUMANOID_RADIUS]
        if gap <= slack:
            touched += 1
            fixed += 1
        if fixed > 1:
            return -1
        touches += fixed
        steps = min(steps, (least - slack) / f[k.WALK], (gap - slack) / (f[k.STRIDE] + f[k.WALK]))
        fast = fast or too_fast(motion[at + 2], motion[at + 3], f[k.DT], f[k.WALK])
    if touched > 1:
        return -1
    if touched or touches:
        n[k.QUIET] = 0
    return 0 if fast else max(0, int(min(steps, FAR)))


@njit
def read_bodies(n):
    """Copies positions and velocities from Chipmunk."""
    bodies, motion = ints(n[k.BODIES]), floats(n[k.MOTION])
    for i in range(n[k.PEOPLE] + 1):
        motion[4 * i], motion[4 * i + 1] = position(bodies[i])
        motion[4 * i + 2], motion[4 * i + 3] = velocity(bodies[i])


@njit
def place_bodies(n):
    """Gives Chipmunk the positions of bodies that have flown."""
    bodies, motion = ints(n[k.BODIES]), floats(n[k.MOTION])
    if n[k.FLOWN]:
        n[k.FLOWN] = 0
        for i in range(n[k.PEOPLE] + 1):
            place(bodies[i], motion[4 * i], motion[4 * i + 1])


@njit
def flown(x, y, vx, vy, dt, steps):
    """The position after some steps of a body that touches nothing."""
    dx, dy = vx * dt, vy * dt
    for _ in range(steps):
        x += dx
        y += dy
    return x, y


def fly(body, dt, steps):
    """Moves a body that touches nothing by some steps."""
    x, y = position(body)
    vx, vy = velocity(body)
    x, y = flown(x, y, vx, vy, dt, steps)
    place(body, x, y)


@njit
def fly_all(n, dt, steps):
    """Moves all bodies, but in Chipmunk."""
    motion = floats(n[k.MOTION])
    for at in range(0, 4 * n[k.PEOPLE] + 4, 4):
        x, y, vx, vy = motion[at], motion[at + 1], motion[at + 2], motion[at + 3]
        motion[at], motion[at + 1] = flown(x, y, vx, vy, dt, steps)
    n[k.FLOWN] = 1


@njit
def move(n, f, step, stop):
    """Steps to `stop`, or to the first contact of the robot; returns the step."""
    touching = flags(n[k.TOUCHING])
    while step < stop:
        if n[k.FLIES] and n[k.CLEAR] <= step and n[k.CHECKED] != step:
            n[k.CLEAR] = step + clear_steps(n, f)
            n[k.CHECKED] = step
        if step < n[k.CLEAR] and n[k.QUIET] >= SETTLE:
            steps = min(stop, n[k.CLEAR]) - step
            fly_all(n, f[k.DT], steps)
            step += steps
            continue
        place_bodies(n)
        step_space(n[k.SPACE], f[k.DT])
        read_bodies(n)
        step += 1
        n[k.QUIET] += 1
        if n[k.FLIES]:
            clear = clear_steps(n, f)
            n[k.CLEAR], n[k.CHECKED] = step + clear, step
            if clear < 0:
                n[k.CROWDED] = 1
                break
        if touching[0]:
            break
    return step


@njit
def look_around(n, f, step):
    """Makes the looks that are due; True if garbage came or left, or if Python has to look."""
    if step < n[k.GROUND_DUE] and step < n[k.PEOPLE_DUE]:
        return False
    motion, found = floats(n[k.MOTION]), n[k.FOUND]
    x, y = motion[0], motion[1]
    if step >= n[k.GROUND_DUE]:
        due = look_for_garbage(n, f, step, x, y, not n[k.PATROLLING])
        if due < 0:  # new items earn points on patrol
            return True
        n[k.GROUND_DUE] = due
    if step >= n[k.PEOPLE_DUE]:
        due = people_due(n, f, step, x, y)
        n[k.PEOPLE_DUE] = max(due, step)
        if due < 0:
            return True
    return n[k.FOUND] != found


def run(ints_at, floats_at, until):
    """Goes on to the step `until`, to a contact, or to a look that changes something."""
    n, f = ints(ints_at), floats(floats_at)
    touching, turn_step = flags(n[k.TOUCHING]), ints(n[k.TURN_STEP])
    motion, step, turn = floats(n[k.MOTION]), n[k.STEP], n[k.TURN]
    read_bodies(n)
    if n[k.GROUND_DUE] == k.BEFORE_MOVING:
        n[k.GROUND_DUE] = look_for_garbage(n, f, step, motion[0], motion[1], True)
    while step < until:
        stop = min(turn_step[turn], until)
        stop = min(stop, max(min(n[k.GROUND_DUE], n[k.PEOPLE_DUE]), step + 1))
        step = move(n, f, step, stop)
        if touching[0] or n[k.CROWDED]:
            break
        turn = turn_people(n, step, turn)
        if look_around(n, f, step):
            break
    place_bodies(n)
    n[k.STEP], n[k.TURN] = step, turn


def look(ints_at, floats_at):
    """A look for garbage from where the robot is."""
    n, f = ints(ints_at), floats(floats_at)
    x, y = position(ints(n[k.BODIES])[0])
    n[k.GROUND_DUE] = look_for_garbage(n, f, n[k.STEP], x, y, True)


_INT, _REAL = types.int64, types.float64
_compiled = partial(njit, no_cpython_wrapper=True, no_cfunc_wrapper=True, error_model="numpy")
FUNCTIONS = {
    "run": _compiled(types.void(_INT, _INT, _INT))(run),
    "look": _compiled(types.void(_INT, _INT))(look),
    "fly": _compiled(types.void(_INT, _REAL, _INT))(fly),
}
"""The functions that Python calls, by name; compiled when this module is imported."""
