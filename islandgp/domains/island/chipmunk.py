"""Functions of Chipmunk, pymunk's engine, that compiled functions call.

This is the only module that uses private names of pymunk. They take bodies and spaces by address.
"""

from __future__ import annotations

import sys
from typing import Any, Final

import pymunk
from llvmlite import binding, ir
from numba import types
from numba.core import cgutils
from numba.extending import intrinsic
from pymunk._chipmunk_cffi import ffi, lib

from islandgp.errors import DomainError

if sys.platform == "win32":
    raise DomainError(
        "Expected Linux or macOS for episodes of the island, found Windows, where Chipmunk's"
        " functions are called in another way; run islandgp in WSL."
    )

for _name in (
    "cpSpaceStep",
    "cpBodyGetPosition",
    "cpBodySetPosition",
    "cpBodyGetVelocity",
    "cpBodySetVelocity",
):
    binding.add_symbol(_name, int(ffi.cast("uintptr_t", ffi.addressof(lib, _name))))

_VECTOR: Final = types.UniTuple(types.float64, 2)
_OF_VECTOR: Final = types.void(types.int64, types.float64, types.float64)

step_space: Final = types.ExternalFunction("cpSpaceStep", types.void(types.int64, types.float64))
"""cpSpaceStep(space, dt)."""
steer: Final = types.ExternalFunction("cpBodySetVelocity", _OF_VECTOR)
"""cpBodySetVelocity(body, {x, y}); a vector is passed as two numbers."""
place: Final = types.ExternalFunction("cpBodySetPosition", _OF_VECTOR)
"""cpBodySetPosition(body, {x, y})."""


def address(thing: pymunk.Space | pymunk.Body) -> int:
    """The address of a space or a body."""
    held = thing._body if isinstance(thing, pymunk.Body) else thing._space
    return int(ffi.cast("uintptr_t", held))


def _vector(name: str) -> Any:
    """Chipmunk's function `name`, which returns a vector of a body."""

    @intrinsic
    def read(_typing, _body):
        def code(context, builder, signature, args):
            double = ir.DoubleType()
            kind = ir.FunctionType(ir.LiteralStructType([double, double]), [ir.IntType(64)])
            function = cgutils.get_or_insert_function(builder.module, kind, name)
            vector = builder.call(function, args)
            values = [builder.extract_value(vector, i) for i in range(2)]
            return context.make_tuple(builder, signature.return_type, values)

        return _VECTOR(types.int64), code

    return read


position: Final = _vector("cpBodyGetPosition")
velocity: Final = _vector("cpBodyGetVelocity")
