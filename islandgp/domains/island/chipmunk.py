"""Functions of Chipmunk that compiled code can call, and arrays at addresses."""

from __future__ import annotations

from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.extending import intrinsic

DOUBLE, ADDRESS = ir.DoubleType(), ir.IntType(8).as_pointer()


def _array_at(item):
    """A function that returns the array of `item` at an address."""

    @intrinsic
    def pointer(_typing, _address):
        def code(context, builder, signature, args):
            return builder.inttoptr(args[0], context.get_value_type(signature.return_type))

        return types.CPointer(item)(types.int64), code

    return pointer


float_array, int_array, flag_array = map(_array_at, (types.float64, types.int64, types.uint8))


def _call(builder, result, name, values):
    """Emits a call of Chipmunk's function `name`; the first of `values` is an address."""
    values = [builder.inttoptr(values[0], ADDRESS), *values[1:]]
    kind = ir.FunctionType(result, [value.type for value in values])
    return builder.call(cgutils.get_or_insert_function(builder.module, kind, name), values)


def _void(name):
    """The code of a call of Chipmunk's function `name`, which returns nothing."""

    def code(context, builder, _signature, args):
        _call(builder, ir.VoidType(), name, args)
        return context.get_dummy_value()

    return code


@intrinsic
def step_space(_typing, _space, _dt):
    """cpSpaceStep(space, dt)."""
    return types.void(types.int64, types.float64), _void("cpSpaceStep")


@intrinsic
def steer(_typing, _body, _x, _y):
    """cpBodySetVelocity(body, {x, y}); a vector is passed as two numbers except on Windows."""
    return types.void(types.int64, types.float64, types.float64), _void("cpBodySetVelocity")


@intrinsic
def place(_typing, _body, _x, _y):
    """cpBodySetPosition(body, {x, y})."""
    return types.void(types.int64, types.float64, types.float64), _void("cpBodySetPosition")


def _pair(name):
    """The function `name` of Chipmunk, which returns a vector of a body."""

    @intrinsic
    def pair(_typing, _body):
        def code(context, builder, signature, args):
            vector = _call(builder, ir.LiteralStructType([DOUBLE, DOUBLE]), name, args)
            values = [builder.extract_value(vector, i) for i in range(2)]
            return context.make_tuple(builder, signature.return_type, values)

        return types.UniTuple(types.float64, 2)(types.int64), code

    return pair


position, velocity = _pair("cpBodyGetPosition"), _pair("cpBodyGetVelocity")
