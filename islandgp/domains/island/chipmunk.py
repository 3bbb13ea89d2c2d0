"""Functions of Chipmunk, pymunk's engine, that compiled functions call.

This is the only module that uses private names of pymunk. They take bodies and spaces by address.
"""

from __future__ import annotations

import sys

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

_DOUBLE, _ADDRESS = ir.DoubleType(), ir.IntType(8).as_pointer()
_VECTOR = types.UniTuple(types.float64, 2)


def address(thing: pymunk.Space | pymunk.Body) -> int:
    """The address of a space or a body."""
    held = thing._body if isinstance(thing, pymunk.Body) else thing._space
    return int(ffi.cast("uintptr_t", held))


def _call(builder, result, name, values):
    """Emits a call of Chipmunk's function `name`; the first of `values` is an address."""
    values = [builder.inttoptr(values[0], _ADDRESS), *values[1:]]
    kind = ir.FunctionType(result, [value.type for value in values])
    return builder.call(cgutils.get_or_insert_function(builder.module, kind, name), values)


def _function(name, *kinds):
    """Chipmunk's function `name`, which takes an address and numbers, and returns nothing.

    A vector is passed as two numbers.
    """

    def code(context, builder, _signature, args):
        _call(builder, ir.VoidType(), name, args)
        return context.get_dummy_value()

    return types.void(types.int64, *kinds), code


@intrinsic
def step_space(_typing, _space, _dt):
    """cpSpaceStep(space, dt)."""
    return _function("cpSpaceStep", types.float64)


@intrinsic
def steer(_typing, _body, _x, _y):
    """cpBodySetVelocity(body, {x, y})."""
    return _function("cpBodySetVelocity", types.float64, types.float64)


@intrinsic
def place(_typing, _body, _x, _y):
    """cpBodySetPosition(body, {x, y})."""
    return _function("cpBodySetPosition", types.float64, types.float64)


def _vector(name):
    """Chipmunk's function `name`, which returns a vector of a body."""

    def code(context, builder, signature, args):
        vector = _call(builder, ir.LiteralStructType([_DOUBLE, _DOUBLE]), name, args)
        values = [builder.extract_value(vector, i) for i in range(2)]
        return context.make_tuple(builder, signature.return_type, values)

    return _VECTOR(types.int64), code


@intrinsic
def position(_typing, _body):
    """cpBodyGetPosition(body)."""
    return _vector("cpBodyGetPosition")


@intrinsic
def velocity(_typing, _body):
    """cpBodyGetVelocity(body)."""
    return _vector("cpBodyGetVelocity")
