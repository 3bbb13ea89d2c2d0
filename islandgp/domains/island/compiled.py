"""The compiled parts of an episode, where numba is installed (`islandgp[fast]`)."""

from __future__ import annotations

import sys
from array import array
from collections.abc import Callable
from ctypes import PYFUNCTYPE, c_double, c_int, c_int64
from functools import cache, lru_cache, partial
from importlib.util import find_spec
from itertools import chain, count
from typing import TYPE_CHECKING, Any, Final, NamedTuple

import pymunk

from islandgp.domains.island import engine
from islandgp.domains.island import layout as k
from islandgp.domains.island.schedule import Schedule
from islandgp.domains.island.sensing import GARBAGE

if TYPE_CHECKING:
    from islandgp.domains.island.garbage import Places
    from islandgp.domains.island.state import State

WARM: Final = 20  # episodes of a process before it compiles, which takes seconds


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
_SCRATCH: Final = array("q", [0, 0])  # to which compiled functions write their status


def compiled_for(island: State, *, flies: bool = True) -> Compiled | None:
    """The compiled functions for an island; None: Python's are to be used.

    Args:
        island: at step 0.
        flies: leave out steps in which no bodies can touch. `run` can then raise Crowded.
    """
    if next(_episodes) < WARM and not _at_hand():
        return None
    functions = _functions()
    return None if functions is None else _bound(functions, island, flies)


def _can_compile() -> bool:
    return sys.platform != "win32" and find_spec("numba") is not None and bool(engine.addresses)


@cache
def _at_hand() -> bool:
    """True if the functions need not be compiled."""
    try:
        from islandgp.domains.island.machine_code import is_cached

        return _can_compile() and is_cached()
    except ImportError:
        return False


@cache
def _functions() -> Functions | None:
    """The compiled functions, or None where numba or a folder for its results is missing."""
    if not _can_compile():
        return None
    try:
        from islandgp.domains.island.machine_code import addresses

        run, look, fly = (addresses()[name] for name in ("run", "look", "fly"))
    except (ImportError, OSError, RuntimeError):  # another NumPy, no folder to write to
        return None
    return Functions(
        _function(run, c_int64, c_int64, c_int64),
        _function(look, c_int64, c_int64),
        _adds_as_chipmunk(_function(fly, c_int64, c_double, c_int64)),
    )


def _function(address: int, *kinds: type) -> Callable[..., None]:
    """A function of numba's calling convention: the result and errors go to its first arguments."""
    scratch = engine.data_address(_SCRATCH)
    function = PYFUNCTYPE(c_int, c_int64, c_int64, *kinds)(address)
    return partial(function, scratch, scratch)


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
    turns = schedule.turns
    steps, who = array("q", [turn[0] for turn in turns]), array("q", [turn[1] for turn in turns])
    return steps, who, array("d", [v for turn in turns for v in turn[2:]])


@lru_cache(maxsize=16)
def _cells(places: Places) -> tuple[array[float], array[float], array[int], array[int]]:
    """Positions of items, and the items near each cell, by cell."""
    first = array("q", [0])
    for near in places.near:
        first.append(first[-1] + len(near))
    return array("d", places.x), array("d", places.y), first, array("q", chain(*places.near))


def _bound(functions: Functions, island: State, flies: bool) -> Compiled:
    ground, people, robot, physics = island.ground, island.humanoids, island.robot, island.physics
    turn_step, turn_who, turn_velocity = _turns(island.schedule)
    x, y, first, members = _cells(ground.places)
    bodies = array("q", map(engine.address, (robot.body, *people.bodies)))
    motion = array("d", bytes(32 * len(bodies)))
    rocks = array("d", chain(*island.schedule.obstacles))
    world = island.world
    arrays: dict[int, Any] = {
        k.BODIES: bodies, k.MOTION: motion, k.TOUCHING: physics.contacts.flag,
        k.TURN_STEP: turn_step, k.TURN_WHO: turn_who, k.TURN_VELOCITY: turn_velocity,
        k.ITEMS: people.items,
        k.DUES: people.dues, k.UNSEEN: people.unseen, k.NEAR: people.near, k.X: x, k.Y: y,
        k.THERE: ground.there, k.SEEN: ground.seen, k.FIRST: first, k.MEMBERS: members,
        k.ROCK: rocks,
    }  # fmt: skip
    n, f = array("q", bytes(8 * k.WHOLE_NUMBERS)), array("d", bytes(8 * k.NUMBERS))
    for place, held in arrays.items():
        n[place] = engine.data_address(held)
    n[k.PEOPLE], n[k.COLUMNS] = len(people.items), ground.places.columns
    n[k.ASK_FROM], n[k.MOST_ITEMS] = people.settings.ask_from, people.settings.most_items
    n[k.SPACE] = engine.address(physics.handle)
    f[k.DT], f[k.PERCEPTION], f[k.SIGHT] = island.dt, robot.settings.perception, robot.sight
    f[k.STRIDE], f[k.WALK], f[k.CELL] = robot.stride, island.walk, ground.places.cell
    n[k.FLIES], n[k.ROCKS] = flies and functions.flies, len(island.schedule.obstacles)
    f[k.SIDE], f[k.ROBOT_RADIUS] = world.side, world.robot.radius
    f[k.HUMANOID_RADIUS] = world.humanoids.radius
    ints, floats, board = engine.data_address(n), engine.data_address(f), island.board
    run_to, look_now = partial(functions.run, ints, floats), partial(functions.look, ints, floats)

    def run(until: int, _held: object = arrays) -> int:  # the addresses lead to their memory
        n[k.STEP], n[k.TURN] = island.step, island.turn
        n[k.GROUND_DUE], n[k.PEOPLE_DUE] = ground.due, people.due
        n[k.DRIVING], n[k.PATROLLING] = robot.driving, island.patrolling
        heading = robot.heading
        f[k.HEADING_X], f[k.HEADING_Y] = heading.real, heading.imag
        run_to(until)
        if n[k.CROWDED]:
            raise Crowded
        island.turn, ground.due, people.due = n[k.TURN], n[k.GROUND_DUE], n[k.PEOPLE_DUE]
        robot.x, robot.y = motion[0], motion[1]
        if n[k.FOUND] != board[GARBAGE]:
            board[GARBAGE] = bool(n[k.FOUND])
            island.changed = True
        return n[k.STEP]

    def look() -> tuple[int, int]:
        n[k.STEP], n[k.DRIVING] = island.step, robot.driving
        f[k.HEADING_X], f[k.HEADING_Y] = robot.heading.real, robot.heading.imag
        look_now()
        ground.due = n[k.GROUND_DUE]
        return n[k.FOUND], n[k.NEW]

    return Compiled(run, look)
