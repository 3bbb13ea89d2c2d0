"""Direct calls of the Chipmunk functions that an episode uses most: step, position, velocity.

pymunk's wrappers take a third of the time of a step, and most of the time of the other two. They
handle threads, and bodies that are added or removed during a step, neither of which an episode
has. This is the only module that uses private names of pymunk. If a release of pymunk lacks them,
its public interface is used, with the same results.
"""

from __future__ import annotations

from array import array
from collections.abc import Callable
from typing import Any, NamedTuple

import pymunk

Handle = Any  # Chipmunk's pointer to a space or a body, or pymunk's object


class Engine(NamedTuple):
    """Functions of the physics engine, either Chipmunk's or pymunk's."""

    handle: Callable[[pymunk.Space | pymunk.Body], Handle]
    step: Callable[[Handle, float], None]  # (space, seconds): advances the simulation
    position: Callable[[Handle], Any]  # (body): its position; .x and .y in metres
    steer: Callable[[Handle, tuple[float, float]], None]  # (body, velocity in m/s)


def chipmunk() -> Engine:
    """Chipmunk's functions.

    Raises:
        ImportError, AttributeError: the installed pymunk has other private names.
    """
    from pymunk._chipmunk_cffi import lib

    def handle(thing: pymunk.Space | pymunk.Body) -> Handle:
        return thing._body if isinstance(thing, pymunk.Body) else thing._space

    handle(pymunk.Body()), handle(pymunk.Space())
    return Engine(handle, lib.cpSpaceStep, lib.cpBodyGetPosition, lib.cpBodySetVelocity)


def wrapped() -> Engine:
    """The same functions by pymunk's public interface."""

    def steer(body: pymunk.Body, velocity: tuple[float, float]) -> None:
        body.velocity = velocity

    return Engine(lambda thing: thing, pymunk.Space.step, lambda body: body.position, steer)


def _addresses() -> dict[str, int]:
    """The addresses of the functions that `compiled` calls, by name."""
    from pymunk._chipmunk_cffi import ffi, lib

    names = ["cpSpaceStep", "cpBodyGetPosition", "cpBodySetPosition"]
    names += ["cpBodyGetVelocity", "cpBodySetVelocity"]
    return {name: int(ffi.cast("uintptr_t", ffi.addressof(lib, name))) for name in names}


def address(thing: Handle) -> int:
    """The address of a space or a body, for compiled code."""
    from pymunk._chipmunk_cffi import ffi

    return int(ffi.cast("uintptr_t", thing))


def data_address(held: array[Any] | bytearray) -> int:
    """The address of an array's items, valid while its length does not change."""
    from pymunk._chipmunk_cffi import ffi

    return int(ffi.cast("uintptr_t", ffi.from_buffer(held)))


try:
    handle, step, position, steer = chipmunk()
    addresses = _addresses()
except (ImportError, AttributeError):
    handle, step, position, steer = wrapped()
    addresses = {}
