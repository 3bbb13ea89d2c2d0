"""The compiled parts of an episode, where numba is installed (`islandgp[fast]`)."""

from __future__ import annotations

import sys
from array import array
from collections.abc import Callable
from ctypes import PYFUNCTYPE, c_int64
from functools import cache, lru_cache
from importlib.util import find_spec
from itertools import chain, count
from typing import TYPE_CHECKING, Any, Final, NamedTuple, cast

from islandgp.domains.island import engine
from islandgp.domains.island.robot import TOLERANCE
from islandgp.domains.island.schedule import Schedule
from islandgp.domains.island.sensing import GARBAGE, TOGETHER
from islandgp.domains.island.world import FAR

if TYPE_CHECKING:
    from islandgp.domains.island.garbage import Places
    from islandgp.domains.island.state import State

WARM: Final = 20  # episodes of a process before numba, which takes half a second to import


class Compiled(NamedTuple):
    """The compiled functions of one island."""

    run: Callable[[int], int]
    """Moves to a step at most; returns the step at which something is to be done."""
    look: Callable[[], tuple[int, int]]
    """Looks for garbage; returns whether some is in sight, and how many items are new."""


_episodes = count()


def compiled_for(island: State) -> Compiled | None:
    """The compiled functions for an island; None: Python's are to be used."""
    functions = None if next(_episodes) < WARM else _functions()
    return None if functions is None else _bound(*functions, island)


@cache
def _functions() -> tuple[Any, Any] | None:
    """The compiled `run` and `look`, or None where numba or its cache is missing."""
    if sys.platform == "win32" or find_spec("numba") is None or not engine.addresses:
        return None
    try:
        from llvmlite.binding import add_symbol

        for name, address in engine.addresses.items():
            add_symbol(name, address)
        from islandgp.domains.island import kernel
    except (ImportError, OSError, RuntimeError):  # another NumPy, no room or folder for its cache
        return None
    run, look = (cast(int, f.address) for f in (kernel.run, kernel.look))  # after compilation
    return (
        PYFUNCTYPE(None, c_int64, c_int64, c_int64)(run),
        PYFUNCTYPE(None, c_int64, c_int64)(look),
    )


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


def _bound(run_at: Any, look_at: Any, island: State) -> Compiled:
    from islandgp.domains.island import kernel as k

    ground, people, robot, physics = island.ground, island.humanoids, island.robot, island.physics
    turn_step, turn_who, turn_velocity = _turns(island.schedule)
    x, y, first, members = _cells(ground.places)
    bodies = array("q", map(engine.address, people.bodies))
    arrays: dict[int, Any] = {
        k.BODIES: bodies, k.TOUCHING: physics.contacts.flag, k.TURN_STEP: turn_step,
        k.TURN_WHO: turn_who, k.TURN_VELOCITY: turn_velocity, k.ITEMS: people.items,
        k.DUES: people.dues, k.UNSEEN: people.unseen, k.NEAR: people.near, k.X: x, k.Y: y,
        k.THERE: ground.there, k.SEEN: ground.seen, k.FIRST: first, k.MEMBERS: members,
    }  # fmt: skip
    n, f = array("q", bytes(8 * (k.MEMBERS + 1))), array("d", bytes(8 * (k.TOLERANCE + 1)))
    for place, held in arrays.items():
        n[place] = engine.data_address(held)
    n[k.PEOPLE], n[k.COLUMNS] = len(people.items), ground.places.columns
    n[k.ASK_FROM], n[k.MOST_ITEMS] = people.settings.ask_from, people.settings.most_items
    n[k.SPACE], n[k.ROBOT] = engine.address(physics.handle), engine.address(robot.body)
    f[k.DT], f[k.PERCEPTION], f[k.SIGHT] = island.dt, robot.settings.perception, robot.sight
    f[k.STRIDE], f[k.WALK], f[k.CELL] = robot.stride, island.walk, ground.places.cell
    n[k.TOGETHER], n[k.FAR], f[k.TOLERANCE] = TOGETHER, FAR, TOLERANCE
    ints, floats, board = n.buffer_info()[0], f.buffer_info()[0], island.board

    def run(until: int, _held: object = arrays) -> int:  # the addresses lead to their memory
        n[k.STEP], n[k.TURN] = island.step, island.turn
        n[k.GROUND_DUE], n[k.PEOPLE_DUE] = ground.due, people.due
        n[k.FOUND], n[k.DRIVING] = int(board[GARBAGE]), robot.driving
        f[k.HEADING_X], f[k.HEADING_Y] = robot.heading.real, robot.heading.imag
        run_at(ints, floats, until)
        island.turn, ground.due, people.due = n[k.TURN], n[k.GROUND_DUE], n[k.PEOPLE_DUE]
        return n[k.STEP]

    def look() -> tuple[int, int]:
        n[k.STEP], n[k.DRIVING] = island.step, robot.driving
        f[k.HEADING_X], f[k.HEADING_Y] = robot.heading.real, robot.heading.imag
        look_at(ints, floats)
        ground.due = n[k.GROUND_DUE]
        return n[k.FOUND], n[k.NEW]

    return Compiled(run, look)
