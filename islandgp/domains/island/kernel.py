"""The loop between two looks that show something new, and the look for garbage, compiled by numba.

It does what `episode.advance` does as long as nothing changes but positions: Chipmunk steps,
humanoids turn, and looks show nothing new. It stops before any other look, which Python repeats;
so it may look too early, but never too late, and outcomes are the same to the last bit.

While no body can touch anything, each moves on a straight line. Such steps are left to additions,
the same that Chipmunk makes. Chipmunk makes at least SETTLE steps after each contact, and has
forgotten it by then. The order in which it solves several contacts of one body depends on the
steps before. So a body with two contacts at once sets CROWDED, and the episode is repeated with
every step.
"""

from __future__ import annotations

from math import ceil, hypot, inf, sqrt

from llvmlite import ir
from numba import cfunc, njit, types
from numba.core import cgutils
from numba.extending import intrinsic

# What numba caches knows of no other module, so its settings come by these arrays.
# Places of whole numbers: the state of the loop, settings, and addresses. FOUND: garbage is in
# sight; NEW: items that the last look discovered.
STEP, TURN, GROUND_DUE, PEOPLE_DUE, FOUND, NEW, DRIVING = range(7)
PEOPLE, COLUMNS, ASK_FROM, MOST_ITEMS, TOGETHER, FAR = range(7, 13)
SPACE, ROBOT, BODIES, TOUCHING, TURN_STEP, TURN_WHO, TURN_VELOCITY = range(13, 20)
ITEMS, DUES, UNSEEN, NEAR, X, Y, THERE, SEEN, FIRST, MEMBERS = range(20, 30)
# FLIES: steps may be left out; CLEAR: no contact before this step, as of the step CHECKED; ROCKS:
# how many; ROCK: x, y, r of each; QUIET: steps of Chipmunk since the last contact.
FLIES, CLEAR, CHECKED, CROWDED, ROCKS, ROCK, QUIET = range(30, 37)
# Places of numbers: the robot's heading, and settings.
HEADING_X, HEADING_Y, DT, PERCEPTION, SIGHT, STRIDE, WALK, CELL, TOLERANCE = range(9)
SIDE, ROBOT_RADIUS, HUMANOID_RADIUS = range(9, 12)
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
    """Looks for garbage as `sensing.look_for_garbage` does, and sets the step of the next look.

    With `discover`, new items are marked as seen. Without, the look ends with the step -1 where it
    shows something new.
    """
    xs, ys, there, seen = floats(n[X]), floats(n[Y]), flags(n[THERE]), flags(n[SEEN])
    first, members = ints(n[FIRST]), ints(n[MEMBERS])
    ux, uy, cell, stride = f[HEADING_X], f[HEADING_Y], f[CELL], f[STRIDE]
    column, row, east, north = x // cell, y // cell, x % cell, y % cell
    border_x = (cell - east) / ux if ux > 0 else east / -ux if ux < 0 else inf
    border_y = (cell - north) / uy if uy > 0 else north / -uy if uy < 0 else inf
    last, change, back = 0.0, min(border_x, border_y) + stride, inf
    in_sight, new = 0, 0
    at = (int(row) + 1) * n[COLUMNS] + int(column) + 1
    for k in range(first[at], first[at + 1]):
        i = members[k]
        if not there[i]:
            continue
        dx, dy = xs[i] - x, ys[i] - y
        gap = dx * dx + dy * dy
        if gap <= f[SIGHT]:
            in_sight = 1
            if not seen[i]:
                if not discover:
                    return -1
                seen[i] = 1
                new += 1
        along = dx * ux + dy * uy
        half = f[SIGHT] - gap + along * along
        if half < -f[TOLERANCE]:
            continue
        half = sqrt(half) if half > 0 else 0.0
        if along <= half:
            last = max(last, along + half)
        elif seen[i]:
            back = min(back, along - half)
        else:
            change = min(change, along - half)
    if not discover and in_sight != n[FOUND]:
        return -1
    n[FOUND], n[NEW] = in_sight, new
    change = min(change, last if in_sight else back)
    return step + _steps_to(change - f[TOLERANCE], stride) if n[DRIVING] else n[FAR]


@njit
def _steps_to(distance, stride):
    return int(max(1.0, ceil(distance / stride)))


@njit
def people_due(n, f, step, x, y):
    """The step of the next look at a humanoid; -1: something new is seen now."""
    bodies, items, dues = ints(n[BODIES]), ints(n[ITEMS]), ints(n[DUES])
    unseen, near = flags(n[UNSEEN]), flags(n[NEAR])
    least = n[FAR]
    for h in range(n[PEOPLE]):
        if dues[h] <= step + n[TOGETHER]:
            asks, inside, due = items[h] >= n[ASK_FROM], False, n[FAR]
            if asks or unseen[h]:
                hx, hy = position(bodies[h])
                beyond = hypot(hx - x, hy - y) - f[PERCEPTION]
                inside = beyond <= f[TOLERANCE]
                due = step + _steps_to(abs(beyond) - f[TOLERANCE], f[STRIDE] + f[WALK])
            if (inside and unseen[h]) or (inside and asks) != (near[h] != 0):
                dues[h] = step
                return -1
            dues[h] = due
        least = min(least, dues[h])
    return least


@njit
def turn_people(n, step, turn):
    """The humanoids of this step's turns turn; returns the index of the next turn."""
    turn_step, turn_who, velocity = ints(n[TURN_STEP]), ints(n[TURN_WHO]), floats(n[TURN_VELOCITY])
    bodies, items, dues = ints(n[BODIES]), ints(n[ITEMS]), ints(n[DUES])
    while turn_step[turn] == step:
        h = turn_who[turn]
        steer(bodies[h], velocity[2 * turn], velocity[2 * turn + 1])
        if items[h] < n[MOST_ITEMS]:
            items[h] += 1
            if items[h] == n[ASK_FROM]:
                dues[h] = step
                n[PEOPLE_DUE] = min(n[PEOPLE_DUE], step)
        turn += 1
    return turn


@njit
def fixed_gap(n, f, x, y, radius):
    """Metres from a body to the nearest wall or rock, and how many of them it touches."""
    side, rocks, slack = f[SIDE], floats(n[ROCK]), f[TOLERANCE]
    least, touched = inf, 0
    for gap in (x - radius, y - radius, side - x - radius, side - y - radius):
        least = min(least, gap)
        touched += gap <= slack
    for i in range(n[ROCKS]):
        dx, dy, reach = rocks[3 * i] - x, rocks[3 * i + 1] - y, rocks[3 * i + 2] + radius
        square, limit = dx * dx + dy * dy, max(least, slack) + reach
        if square <= limit * limit:
            gap = sqrt(square) - reach
            least = min(least, gap)
            touched += gap <= slack
    return least, touched


@njit
def too_fast(body, dt, stride):
    """True if a contact has made a body faster than it moves by itself."""
    vx, vy = velocity(body)
    return hypot(vx, vy) * dt > stride + 1e-9


@njit
def clear_steps(n, f):
    """Steps in which no body can touch anything; -1: one touches two things.

    A contact now sets QUIET, the number of steps since the last one, to 0.
    """
    bodies, slack, touches = ints(n[BODIES]), f[TOLERANCE], 0
    x, y = position(n[ROBOT])
    least, touched = fixed_gap(n, f, x, y, f[ROBOT_RADIUS])
    steps = (least - slack) / f[STRIDE]
    fast = too_fast(n[ROBOT], f[DT], f[STRIDE])
    for h in range(n[PEOPLE]):
        hx, hy = position(bodies[h])
        least, fixed = fixed_gap(n, f, hx, hy, f[HUMANOID_RADIUS])
        gap = hypot(hx - x, hy - y) - f[ROBOT_RADIUS] - f[HUMANOID_RADIUS]
        if gap <= slack:
            touched += 1
            fixed += 1
        if fixed > 1:
            return -1
        touches += fixed
        steps = min(steps, (least - slack) / f[WALK], (gap - slack) / (f[STRIDE] + f[WALK]))
        fast = fast or too_fast(bodies[h], f[DT], f[WALK])
    if touched > 1:
        return -1
    if touched or touches:
        n[QUIET] = 0
    return 0 if fast else max(0, int(min(steps, n[FAR])))


@njit
def fly(body, dt, steps):
    """Moves a body that touches nothing by some steps."""
    x, y = position(body)
    vx, vy = velocity(body)
    dx, dy = vx * dt, vy * dt
    for _ in range(steps):
        x += dx
        y += dy
    place(body, x, y)


@njit
def move(n, f, step, stop):
    """Steps to `stop`, or to the first contact of the robot; returns the step."""
    touching, bodies = flags(n[TOUCHING]), ints(n[BODIES])
    while step < stop:
        if n[FLIES] and n[CLEAR] <= step and n[CHECKED] != step:
            n[CLEAR] = step + clear_steps(n, f)
            n[CHECKED] = step
        if step < n[CLEAR] and n[QUIET] >= SETTLE:
            steps = min(stop, n[CLEAR]) - step
            fly(n[ROBOT], f[DT], steps)
            for h in range(n[PEOPLE]):
                fly(bodies[h], f[DT], steps)
            step += steps
            continue
        step_space(n[SPACE], f[DT])
        step += 1
        n[QUIET] += 1
        if n[FLIES]:
            clear = clear_steps(n, f)
            n[CLEAR], n[CHECKED] = step + clear, step
            if clear < 0:
                n[CROWDED] = 1
                break
        if touching[0]:
            break
    return step


@cfunc(types.void(types.int64, types.int64, types.int64), cache=True)
def run(ints_at, floats_at, until):
    """Goes on to the step `until`, to a contact, or to a look that shows something new."""
    n, f = ints(ints_at), floats(floats_at)
    touching, turn_step = flags(n[TOUCHING]), ints(n[TURN_STEP])
    step, turn = n[STEP], n[TURN]
    while step < until:
        stop = min(turn_step[turn], until)
        stop = min(stop, max(min(n[GROUND_DUE], n[PEOPLE_DUE]), step + 1))
        step = move(n, f, step, stop)
        if touching[0] or step >= until or n[CROWDED]:
            break
        turn = turn_people(n, step, turn)
        if step < n[GROUND_DUE] and step < n[PEOPLE_DUE]:
            continue
        x, y = position(n[ROBOT])
        if step >= n[GROUND_DUE]:
            due = look_for_garbage(n, f, step, x, y, False)
            if due < 0:
                break
            n[GROUND_DUE] = due
        if step >= n[PEOPLE_DUE]:
            n[PEOPLE_DUE] = due = people_due(n, f, step, x, y)
            if due < 0:
                n[PEOPLE_DUE] = step
                break
    n[STEP], n[TURN] = step, turn


@cfunc(types.void(types.int64, types.float64, types.int64), cache=True)
def fly_alone(body, dt, steps):
    """See `fly`."""
    fly(body, dt, steps)


@cfunc(types.void(types.int64, types.int64), cache=True)
def look(ints_at, floats_at):
    """A look for garbage from where the robot is."""
    n, f = ints(ints_at), floats(floats_at)
    x, y = position(n[ROBOT])
    n[GROUND_DUE] = look_for_garbage(n, f, n[STEP], x, y, True)
