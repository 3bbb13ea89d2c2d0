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

from islandgp.domains.island import engine, layout
from islandgp.domains.island.schedule import Circle, Schedule
from islandgp.domains.island.sensing import GARBAGE

if TYPE_CHECKING:
    from islandgp.domains.island.garbage import Places
    from islandgp.domains.island.state import State

WARM: Final = 20  # episodes of a process before it compiles, which takes seconds


class Crowded(Exception):
    """A body touched two others at once, so the episode is repeated with every step."""


class Functions(NamedTuple):
    """The compiled functions; their arguments are addresses."""

    run: Any
    look: Any
    may_coast: bool  # coasting gives the same positions as Chipmunk


class Compiled(NamedTuple):
    """The compiled functions of one island."""

    run: Callable[[int], int]
    """Simulates until a step, or until Python has to act before it; returns the step."""
    look: Callable[[], tuple[int, int]]
    """Looks for garbage; returns whether some is in sight, and how many items are new."""


_episodes = count()
_SCRATCH: Final = array("q", [0, 0])  # compiled functions write their status here


def compiled_for(island: State, *, may_coast: bool = True) -> Compiled | None:
    """The compiled functions for an island, or None to use those in Python.

    Args:
        island: at step 0.
        may_coast: move bodies without Chipmunk while they cannot touch. `run` can raise Crowded.
    """
    if next(_episodes) < WARM and not _at_hand():
        return None
    functions = _functions()
    return None if functions is None else _bound(functions, island, may_coast)


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
    """The compiled functions, or None if numba or a folder for its results is missing."""
    if not _can_compile():
        return None
    try:
        from islandgp.domains.island.machine_code import addresses

        run, look, coast = (addresses()[name] for name in ("run", "look", "coast"))
    except (ImportError, OSError, RuntimeError):  # another NumPy, no folder to write to
        return None
    return Functions(
        _function(run, c_int64, c_int64, c_int64),
        _function(look, c_int64, c_int64),
        _adds_as_chipmunk(_function(coast, c_int64, c_double, c_int64)),
    )


def _function(address: int, *kinds: type) -> Callable[..., None]:
    """A function in numba's calling convention: two further arguments for the result and errors."""
    scratch = engine.data_address(_SCRATCH)
    function = PYFUNCTYPE(c_int, c_int64, c_int64, *kinds)(address)
    return partial(function, c_int64(scratch), c_int64(scratch))


def _adds_as_chipmunk(coast: Callable[[int, float, int], None]) -> bool:
    """True if compiled coasting ends where Chipmunk's steps end, to the last bit.

    On some processors a compiler may round a product and a sum in one step.
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
        coast(engine.address(engine.handle(body)), dt, steps)
    return ends == [body.position for body in space.bodies]


@lru_cache(maxsize=32)
def _turns(schedule: Schedule) -> tuple[array[int], array[int], array[float]]:
    """Steps, humanoids and velocities of a day's turns."""
    turns = schedule.turns
    steps = array("q", [turn[0] for turn in turns])
    humanoids = array("q", [turn[1] for turn in turns])
    return steps, humanoids, array("d", [v for turn in turns for v in turn[2:]])


@lru_cache(maxsize=8)
def _rocks(obstacles: tuple[Circle, ...]) -> array[float]:
    return array("d", chain(*obstacles))


@lru_cache(maxsize=32)
def _cells(places: Places) -> tuple[array[float], array[float], array[int], array[int]]:
    """Positions of items, and the items near each cell, by cell."""
    first = array("q", [0])
    for near in places.near:
        first.append(first[-1] + len(near))
    return array("d", places.x), array("d", places.y), first, array("q", chain(*places.near))


class _Memory(NamedTuple):
    """The block of memory that compiled code reads and writes (see `layout`)."""

    block: bytearray
    motion: array[float]  # x, y, vx and vy of the robot and of each humanoid
    arrays: tuple[object, ...]  # those whose addresses are in the block, so that they stay alive


def _memory_of(island: State, may_coast: bool) -> _Memory:
    """The memory of an episode, with its settings."""
    ground, people, robot, world = island.ground, island.humanoids, island.robot, island.world
    block = bytearray(8 * (layout.INTS + layout.FLOATS))
    ints = memoryview(block)[: 8 * layout.INTS].cast("q")
    floats = memoryview(block)[8 * layout.INTS :].cast("d")
    motion = array("d", bytes(32 * (1 + len(people.bodies))))
    arrays = _arrays(island, motion)
    for index, values in arrays.items():
        ints[index] = engine.data_address(values)
    whole_numbers = {
        layout.HUMANOIDS: len(people.items),
        layout.COLUMNS: ground.places.columns,
        layout.ASK_FROM: people.settings.ask_from,
        layout.MAX_ITEMS: people.settings.most_items,
        layout.SPACE: engine.address(island.physics.handle),
        layout.MAY_COAST: int(may_coast),
        layout.ROCK_COUNT: len(island.schedule.obstacles),
    }
    for index, number in whole_numbers.items():
        ints[index] = number
    measures = {
        layout.DT: island.dt,
        layout.PERCEPTION: robot.perception,
        layout.SIGHT_SQUARED: robot.sight_squared,
        layout.STRIDE: robot.stride,
        layout.HUMANOID_STRIDE: island.walk,
        layout.CELL_WIDTH: ground.places.cell,
        layout.SIDE: world.side,
        layout.ROBOT_RADIUS: world.robot.radius,
        layout.HUMANOID_RADIUS: world.humanoids.radius,
    }
    for index, measure in measures.items():
        floats[index] = measure
    return _Memory(block, motion, tuple(arrays.values()))


def _arrays(island: State, motion: array[float]) -> dict[int, Any]:
    """The arrays of an episode, by the index of their addresses."""
    ground, people = island.ground, island.humanoids
    turn_steps, turn_humanoids, turn_velocities = _turns(island.schedule)
    x, y, cell_starts, cell_items = _cells(ground.places)
    return {
        layout.BODIES: array("q", map(engine.address, (island.robot.body, *people.bodies))),
        layout.MOTION: motion,
        layout.TOUCHING: island.physics.contacts.flag,
        layout.TURN_STEPS: turn_steps,
        layout.TURN_HUMANOIDS: turn_humanoids,
        layout.TURN_VELOCITIES: turn_velocities,
        layout.CARRIED: people.items,
        layout.LOOK_STEPS: people.look_steps,
        layout.UNSEEN: people.unseen,
        layout.ASKING_NEAR: people.asking_near,
        layout.ITEM_X: x,
        layout.ITEM_Y: y,
        layout.PRESENT: ground.present,
        layout.DISCOVERED: ground.discovered,
        layout.CELL_STARTS: cell_starts,
        layout.CELL_ITEMS: cell_items,
        layout.ROCKS: _rocks(island.schedule.obstacles),
    }


def _bound(functions: Functions, island: State, may_coast: bool) -> Compiled:
    """The compiled functions with an episode's memory."""
    memory = _memory_of(island, may_coast and functions.may_coast)
    block, motion, _ = memory
    ints_at = engine.data_address(block)
    addresses = c_int64(ints_at), c_int64(ints_at + 8 * layout.INTS)
    run_compiled, look_compiled = (partial(f, *addresses) for f in functions[:2])
    write, read = layout.BEFORE.pack_into, layout.AFTER.unpack_from
    ground, people, robot, board = island.ground, island.humanoids, island.robot, island.board

    def write_state() -> None:
        write(
            block,
            layout.BEFORE_AT,
            island.step,
            island.turn,
            ground.next_look,
            people.next_look,
            robot.driving,
            island.patrolling,
            robot.heading.real,
            robot.heading.imag,
        )

    def run(end: int, _memory: _Memory = memory) -> int:  # keeps the arrays alive
        write_state()
        run_compiled(end)
        state: tuple[int, ...] = read(block, layout.AFTER_AT)
        _, in_sight, crowded, step, island.turn, ground.next_look, people.next_look = state
        if crowded:
            raise Crowded
        robot.x, robot.y = motion[0], motion[1]
        if in_sight != board[GARBAGE]:
            board[GARBAGE] = bool(in_sight)
            island.changed = True
        return step

    def look() -> tuple[int, int]:
        write_state()
        look_compiled()
        state: tuple[int, ...] = read(block, layout.AFTER_AT)
        discoveries, in_sight, _, _, _, ground.next_look, _ = state
        return in_sight, discoveries

    return Compiled(run, look)
