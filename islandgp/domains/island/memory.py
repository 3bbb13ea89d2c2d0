"""Tables at addresses, for compiled functions."""

from __future__ import annotations

from functools import partial
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
