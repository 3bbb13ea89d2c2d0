"""Direct calls of Chipmunk's functions that an episode calls often: step, position, velocity.

pymunk's wrappers take a third of the time of a step, and most of the time of the
other two. What they look after does not happen in an episode: bodies and shapes
that come and go, and threads. So Chipmunk's functions are called as pymunk calls
them. This is the only place that reaches behind pymunk's public interface; a
pymunk without these functions is used as it is, to the same results.
"""

from __future__ import annotations

from array import array
from collections.abc import Callable
from typing import Any, NamedTuple

import pymunk

Handle = Any  # by which these functions know a space or a body


class Engine(NamedTuple):
    """The functions."""

    handle: Callable[[pymunk.Space | pymunk.Body], Handle]
    step: Callable[[Handle, float], None]  # a space, by seconds
    position: Callable[[Handle], Any]  # of a body; .x and .y in metres
    steer: Callable[[Handle, tuple[float, float]], None]  # a body; m/s


def chipmunk() -> Engine:
    """Chipmunk's functions. Raises ImportError or AttributeError where pymunk has others."""
    from pymunk._chipmunk_cffi import lib

    def handle(thing: pymunk.Space | pymunk.Body) -> Handle:
        return thing._body if isinstance(thing, pymunk.Body) else thing._space

    handle(pymunk.Body()), handle(pymunk.Space())
    return Engine(handle, lib.cpSpaceStep, lib.cpBodyGetPosition, lib.cpBodySetVelocity)


def wrapped() -> Engine:
    """pymunk's public interface."""

    def steer(body: pymunk.Body, velocity: tuple[float, float]) -> None:
        body.velocity = velocity

    return Engine(lambda thing: thing, pymunk.Space.step, lambda body: body.position, steer)


def _addresses() -> dict[str, int]:
    """Addresses of the functions that compiled code calls."""
    from pymunk._chipmunk_cffi import ffi, lib

    names = ["cpSpaceStep", "cpBodyGetPosition", "cpBodySetPosition"]
    names += ["cpBodyGetVelocity", "cpBodySetVelocity"]
    return {name: int(ffi.cast("uintptr_t", ffi.addressof(lib, name))) for name in names}


def address(thing: Handle) -> int:
    """The address of a space or a body."""
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
