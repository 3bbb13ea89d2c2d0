"""Direct calls of the Chipmunk functions that an episode uses most: step, position, velocity.

pymunk's wrappers take a third of the time of a step, and most of the time of the others. They
handle threads, and bodies that are added or removed during a step, neither of which an episode
has. This is the only module that uses private names of pymunk. If a release of pymunk lacks them,
its public interface is used, with the same results.
"""

from __future__ import annotations

from array import array
from collections.abc import Callable, Iterable, Sequence
from typing import Any, NamedTuple

import pymunk

Handle = Any  # Chipmunk's pointer to a space or a body, or pymunk's object
Movers = Sequence[tuple[pymunk.Body, pymunk.Shape]]  # bodies, each with its only shape
Starts = Iterable[tuple[float, float, float, float]]  # of each mover: x, y in m, vx, vy in m/s


class Engine(NamedTuple):
    """Functions of the physics engine, either Chipmunk's or pymunk's."""

    handle: Callable[[pymunk.Space | pymunk.Body], Handle]
    step: Callable[[Handle, float], None]  # (space, seconds): advances the simulation
    position: Callable[[Handle], Any]  # (body): its position; .x and .y in metres
    steer: Callable[[Handle, tuple[float, float]], None]  # (body, velocity in m/s)
    restart: Callable[[pymunk.Space, Movers, Starts], None]
    """Takes the movers out of a space, places them, and adds them again in the same order."""


def chipmunk() -> Engine:
    """Chipmunk's functions.

    Raises:
        ImportError, AttributeError: the installed pymunk has other private names.
    """
    from pymunk._chipmunk_cffi import lib

    def handle(thing: pymunk.Space | pymunk.Body) -> Handle:
        return thing._body if isinstance(thing, pymunk.Body) else thing._space

    def restart(space: pymunk.Space, movers: Movers, starts: Starts) -> None:
        within = space._space
        pointers = [(body._body, shape._shape) for body, shape in movers]
        for body, shape in pointers:
            lib.cpSpaceRemoveBody(within, body)
            lib.cpSpaceRemoveShape(within, shape)
        for (body, shape), (x, y, vx, vy) in zip(pointers, starts, strict=True):
            lib.cpBodyUpdatePosition(body, 0)
            lib.cpBodySetPosition(body, (x, y))
            lib.cpBodySetVelocity(body, (vx, vy))
            lib.cpSpaceAddBody(within, body)
            lib.cpSpaceAddShape(within, shape)

    space, body = pymunk.Space(), pymunk.Body(1, 1)
    space.add(body, circle := pymunk.Circle(body, 1))
    restart(space, [(body, circle)], [(0, 0, 0, 0)])
    return Engine(handle, lib.cpSpaceStep, lib.cpBodyGetPosition, lib.cpBodySetVelocity, restart)


def wrapped() -> Engine:
    """The same functions by pymunk's public interface."""

    def steer(body: pymunk.Body, velocity: tuple[float, float]) -> None:
        body.velocity = velocity

    def restart(space: pymunk.Space, movers: Movers, starts: Starts) -> None:
        space.remove(*(thing for mover in movers for thing in mover))
        for (body, shape), (x, y, vx, vy) in zip(movers, starts, strict=True):
            body.update_position(body, 0)  # a remaining overlap no longer moves it
            body.position, body.velocity = (x, y), (vx, vy)
            space.add(body, shape)

    return Engine(
        lambda thing: thing, pymunk.Space.step, lambda body: body.position, steer, restart
    )


def _addresses() -> dict[str, int]:
    """The addresses of the functions that `compiled` calls, by name."""
    from pymunk._chipmunk_cffi import ffi, lib

    names = ["cpSpaceStep", "cpBodyGetPosition", "cpBodySetPosition"]
    names += ["cpBodyGetVelocity", "cpBodySetVelocity"]
    return {name: int(ffi.cast("uintptr_t", ffi.addressof(lib, name))) for name in names}


def address(thing: Handle) -> int:
    """The address of a space or a body, for compiled code."""
    return int(_ffi.cast("uintptr_t", thing))


def data_address(held: array[Any] | bytearray) -> int:
    """The address of an array's items, valid while its length does not change."""
    return int(_ffi.cast("uintptr_t", _ffi.from_buffer(held)))


try:
    from pymunk._chipmunk_cffi import ffi as _ffi

    handle, step, position, steer, restart = chipmunk()
    addresses = _addresses()
except (ImportError, AttributeError):
    handle, step, position, steer, restart = wrapped()
    addresses = {}
