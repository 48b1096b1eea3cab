"""What kernels are written in: types of their arrays, and eight bytes in a word."""

from __future__ import annotations

from typing import Any

import numpy as np
from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.extending import intrinsic

U8, I32, I64, U64 = types.uint8, types.int32, types.int64, types.uint64
BYTES = types.Array(U8, 1, "C")
WINDOW = types.Array(U64, 1, "A", aligned=False)
WORDS = types.Array(types.uint32, 1, "C", readonly=True)
FROZEN = types.Array(U8, 1, "C", readonly=True)
LENGTHS = types.Array(types.uint32, 1, "C", readonly=True, aligned=False)
PAIRS = types.Array(U64, 1, "C", readonly=True, aligned=False)
COUNTS = types.Array(I64, 1, "C")

EACH_BYTE = np.uint64(0x0101010101010101)
OPTIONS: dict[str, Any] = {"nogil": True, "boundscheck": False, "cache": True}


@intrinsic
def first_set(_context: object, _value: types.Integer) -> tuple[object, object]:
    """The number of zero bits below the lowest set one."""

    def generate(_: object, builder: ir.IRBuilder, __: object, args: tuple[ir.Value]) -> ir.Value:
        return builder.cttz(args[0], cgutils.true_bit)

    return U64(U64), generate
