"""What kernels are written in: types of their arrays, and eight bytes in a word."""

from __future__ import annotations

from typing import Any

import numpy as np
from llvmlite import ir
from numba import njit, types
from numba.core import cgutils
from numba.core.base import BaseContext
from numba.core.typing.templates import Signature
from numba.extending import intrinsic

U8, I32, I64, U64 = types.uint8, types.int32, types.int64, types.uint64
BYTES = types.Array(U8, 1, "C")
WINDOW = types.Array(U64, 1, "A", aligned=False)
WORDS = types.Array(types.uint32, 1, "C", readonly=True)
FROZEN = types.Array(U8, 1, "C", readonly=True)
LENGTHS = types.Array(types.uint32, 1, "C", readonly=True, aligned=False)
PAIRS = types.Array(U64, 1, "C", readonly=True, aligned=False)
COUNTS = types.Array(I64, 1, "C")

WIDTH = 32
"""Bytes that `differing` looks at."""

_WIDE = ir.VectorType(ir.IntType(8), WIDTH)

EACH_BYTE = np.uint64(0x0101010101010101)
OPTIONS: dict[str, Any] = {"nogil": True, "boundscheck": False, "cache": True}


@intrinsic
def first_set(_context: object, _value: types.Integer) -> tuple[object, object]:
    """The number of zero bits below the lowest set one."""

    def generate(_: object, builder: ir.IRBuilder, __: object, args: tuple[ir.Value]) -> ir.Value:
        return builder.cttz(args[0], cgutils.true_bit)

    return U64(U64), generate


@njit(inline="always")
def add_bytes(a: int, b: int) -> int:
    """The sums of eight pairs of bytes, each modulo 256."""
    low = U64(0x7F7F7F7F7F7F7F7F)
    return ((a & low) + (b & low)) ^ ((a ^ b) & ~low)


@intrinsic
def differing(
    _context: object, memory: types.Array, _at: types.Integer, _value: types.Integer
) -> tuple[object, object]:
    """Which of the 32 bytes from `at` on differ from a value: bit i for byte at + i."""

    def generate(
        context: BaseContext, builder: ir.IRBuilder, signature: Signature, args: tuple[ir.Value, ir.Value, ir.Value]
    ) -> ir.Value:
        array, at, value = args
        data = context.make_array(signature.args[0])(context, builder, array).data
        found = builder.load(builder.bitcast(builder.gep(data, [at]), _WIDE.as_pointer()))
        found.align = 1
        first = builder.insert_element(ir.Constant(_WIDE, ir.Undefined), value, ir.Constant(ir.IntType(32), 0))
        nowhere = ir.Constant(ir.VectorType(ir.IntType(32), WIDTH), [0] * WIDTH)
        wanted = builder.shuffle_vector(first, ir.Constant(_WIDE, ir.Undefined), nowhere)
        unequal = builder.icmp_unsigned("!=", found, wanted)
        return builder.zext(builder.bitcast(unequal, ir.IntType(WIDTH)), ir.IntType(64))

    return U64(memory, U64, U8), generate
