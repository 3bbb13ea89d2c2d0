"""Tables at addresses, and lengths that are rounded in the same way on all machines."""

from __future__ import annotations

from functools import partial
from math import frexp, ldexp, sqrt
from typing import Final

from numba import carray, njit, types
from numba.core import cgutils
from numba.extending import intrinsic

compiled: Final = partial(njit, error_model="numpy")
"""Compiles a function that others call; `engine` has those that Python calls."""


@intrinsic
def _pointer(_typing, address):
    def code(_context, builder, _signature, args):
        return builder.inttoptr(args[0], cgutils.voidptr_t)

    return types.voidptr(address), code


@compiled
def table(address, count, dtype):
    """The array of `count` records or numbers at an address."""
    return carray(_pointer(address), count, dtype)


SPLITTER: Final = float((1 << 27) + 1)  # Veltkamp's, for two halves of a float's digits


@compiled
def norm(x, y):
    """The length of a vector, with the same bits as Python's `math.hypot`.

    That of the C library differs in the last bit from machine to machine.
    """
    x, y = abs(x), abs(y)
    if x == 0.0 and y == 0.0:
        return 0.0
    scale = ldexp(1.0, -frexp(max(x, y))[1])
    total = 1.0, 0.0, 0.0, 0.0
    total = _add_square(_add_square(total, x * scale, 1.0), y * scale, 1.0)
    root = sqrt(total[0] - 1.0 + (total[1] + total[2] + total[3]))
    total = _add_square(total, root, -1.0)
    rest = total[0] - 1.0 + (total[1] + total[2] + total[3])
    return (root + rest / (2.0 * root)) / scale


@compiled
def _add_square(total, x, sign):
    """Adds `sign` * x * x to a sum that is kept with its rounding errors."""
    large, middle, small, smallest = total
    high = x * SPLITTER - (x * SPLITTER - x)
    low = x - high
    product = sign * high * high
    middle += (large - (large + product)) + product
    large += product
    product = sign * 2.0 * high * low
    small += (large - (large + product)) + product
    large += product
    return large, middle, small, smallest + sign * low * low
