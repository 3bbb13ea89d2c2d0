"""The compiled parts of an episode, where numba is installed (`islandgp[fast]`)."""

from __future__ import annotations

import sys
from array import array
from collections.abc import Callable
from ctypes import PYFUNCTYPE, c_double, c_int64
from functools import cache, lru_cache
from importlib.util import find_spec
from itertools import chain, count
from typing import TYPE_CHECKING, Any, Final, NamedTuple, cast

import pymunk

from islandgp.domains.island import engine
from islandgp.domains.island.robot import TOLERANCE
from islandgp.domains.island.schedule import Schedule
from islandgp.domains.island.sensing import GARBAGE, TOGETHER
from islandgp.domains.island.world import FAR

if TYPE_CHECKING:
    from islandgp.domains.island.garbage import Places
    from islandgp.domains.island.state import State

WARM: Final = 20  # episodes of a process before numba, which takes half a second to import


class Crowded(Exception):
    """A body touched two others at once, so the episode is repeated with every step."""


class Functions(NamedTuple):
    """The compiled functions, by the addresses of their arguments."""

    run: Any
    look: Any
    flies: bool  # steps without contacts can be left out


class Compiled(NamedTuple):
    """The compiled functions of one island."""

    run: Callable[[int], int]
    """Moves to a step at most; returns the step at which something is to be done."""
    look: Callable[[], tuple[int, int]]
    """Looks for garbage; returns whether some is in sight, and how many items are new."""


_episodes = count()


def compiled_for(island: State, *, flies: bool = True) -> Compiled | None:
    """The compiled functions for an island; None: Python's are to be used.

    Args:
        island: at step 0.
        flies: leave out steps in which no bodies can touch. `run` can then raise Crowded.
    """
    functions = None if next(_episodes) < WARM else _functions()
    return None if functions is None else _bound(functions, island, flies)


@cache
def _functions() -> Functions | None:
    """The compiled functions, or None where numba or its cache is missing."""
    if sys.platform == "win32" or find_spec("numba") is None or not engine.addresses:
        return None
    try:
        from llvmlite.binding import add_symbol

        for name, address in engine.addresses.items():
            add_symbol(name, address)
        from islandgp.domains.island import kernel
    except (ImportError, OSError, RuntimeError):  # another NumPy, no room or folder for its cache
        return None
    run, look, fly = (cast(int, f.address) for f in (kernel.run, kernel.look, kernel.fly_alone))
    return Functions(
        PYFUNCTYPE(None, c_int64, c_int64, c_int64)(run),
        PYFUNCTYPE(None, c_int64, c_int64)(look),
        _adds_as_chipmunk(PYFUNCTYPE(None, c_int64, c_double, c_int64)(fly)),
    )


def _adds_as_chipmunk(fly: Callable[[int, float, int], None]) -> bool:
    """True if a compiled flight ends where Chipmunk's steps end, to the last bit.

    A compiler may round a product and a sum at once, which some processors can.
    """
    space, dt, steps = pymunk.Space(), 0.1, 100
    for i in range(20):
        body = pymunk.Body(50.0, float("inf"))
        body.position, body.velocity = (100 / (i + 3), 7.7 * i), (10 / (i + 7), -1.3 / (i + 1))
        space.add(body)
    starts = [body.position for body in space.bodies]
    for _ in range(steps):
        space.step(dt)
    ends = [body.position for body in space.bodies]
    for body, start in zip(space.bodies, starts, strict=True):
        body.position = start
        fly(engine.address(engine.handle(body)), dt, steps)
    return ends == [body.position for body in space.bodies]


@lru_cache(maxsize=16)
def _turns(schedule: Schedule) -> tuple[array[int], array[int], array[float]]:
    """Steps, humanoids and velocities of a day's turns."""
    steps, who, x, y = zip(*schedule.turns, strict=True)
    return array("q", steps), array("q", who), array("d", chain(*zip(x, y, strict=True)))


@lru_cache(maxsize=16)
def _cells(places: Places) -> tuple[array[float], array[float], array[int], array[int]]:
    """Positions of items, and the items near each cell, by cell."""
    first = array("q", [0])
    for near in places.near:
        first.append(first[-1] + len(near))
    return array("d", places.x), array("d", places.y), first, array("q", chain(*places.near))


def _bound(functions: Functions, island: State, flies: bool) -> Compiled:
    from islandgp.domains.island import kernel as k

    ground, people, robot, physics = island.ground, island.humanoids, island.robot, island.physics
    turn_step, turn_who, turn_velocity = _turns(island.schedule)
    x, y, first, members = _cells(ground.places)
    bodies = array("q", map(engine.address, people.bodies))
    rocks = array("d", chain(*island.schedule.obstacles))
    run_at, look_at, world = functions.run, functions.look, island.world
    arrays: dict[int, Any] = {
        k.BODIES: bodies, k.TOUCHING: physics.contacts.flag, k.TURN_STEP: turn_step,
        k.TURN_WHO: turn_who, k.TURN_VELOCITY: turn_velocity, k.ITEMS: people.items,
        k.DUES: people.dues, k.UNSEEN: people.unseen, k.NEAR: people.near, k.X: x, k.Y: y,
        k.THERE: ground.there, k.SEEN: ground.seen, k.FIRST: first, k.MEMBERS: members,
        k.ROCK: rocks,
    }  # fmt: skip
    n, f = array("q", bytes(8 * (k.QUIET + 1))), array("d", bytes(8 * (k.HUMANOID_RADIUS + 1)))
    for place, held in arrays.items():
        n[place] = engine.data_address(held)
    n[k.PEOPLE], n[k.COLUMNS] = len(people.items), ground.places.columns
    n[k.ASK_FROM], n[k.MOST_ITEMS] = people.settings.ask_from, people.settings.most_items
    n[k.SPACE], n[k.ROBOT] = engine.address(physics.handle), engine.address(robot.body)
    f[k.DT], f[k.PERCEPTION], f[k.SIGHT] = island.dt, robot.settings.perception, robot.sight
    f[k.STRIDE], f[k.WALK], f[k.CELL] = robot.stride, island.walk, ground.places.cell
    n[k.TOGETHER], n[k.FAR], f[k.TOLERANCE] = TOGETHER, FAR, TOLERANCE
    n[k.FLIES], n[k.ROCKS] = flies and functions.flies, len(island.schedule.obstacles)
    f[k.SIDE], f[k.ROBOT_RADIUS] = world.side, world.robot.radius
    f[k.HUMANOID_RADIUS] = world.humanoids.radius
    ints, floats, board = n.buffer_info()[0], f.buffer_info()[0], island.board

    def run(until: int, _held: object = arrays) -> int:  # the addresses lead to their memory
        n[k.STEP], n[k.TURN] = island.step, island.turn
        n[k.GROUND_DUE], n[k.PEOPLE_DUE] = ground.due, people.due
        n[k.FOUND], n[k.DRIVING] = int(board[GARBAGE]), robot.driving
        f[k.HEADING_X], f[k.HEADING_Y] = robot.heading.real, robot.heading.imag
        run_at(ints, floats, until)
        if n[k.CROWDED]:
            raise Crowded
        island.turn, ground.due, people.due = n[k.TURN], n[k.GROUND_DUE], n[k.PEOPLE_DUE]
        return n[k.STEP]

    def look() -> tuple[int, int]:
        n[k.STEP], n[k.DRIVING] = island.step, robot.driving
        f[k.HEADING_X], f[k.HEADING_Y] = robot.heading.real, robot.heading.imag
        look_at(ints, floats)
        ground.due = n[k.GROUND_DUE]
        return n[k.FOUND], n[k.NEW]

    return Compiled(run, look)
