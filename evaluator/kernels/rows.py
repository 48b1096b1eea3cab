"""PNG rows to labels."""

from __future__ import annotations

import numpy as np
from numba import njit, types
from numpy.typing import NDArray

from evaluator.kernels.words import BYTES, EACH_BYTE, FROZEN, I32, I64, OPTIONS, U8, U64, WINDOW, add_bytes, first_set


@njit(inline="always")
def _paeth(a: int, b: int, c: int) -> int:
    """The PNG specification's predictor from left, above, and above left."""
    if b == c:
        return a
    if a == c:
        return b
    distance_a, distance_b, distance_c = abs(b - c), abs(a - c), abs(a + b - c - c)
    if distance_a <= distance_b and distance_a <= distance_c:
        return a
    return b if distance_b <= distance_c else c


@njit([types.void(FROZEN, WINDOW, I64, I64, BYTES, WINDOW)], **OPTIONS)
def unfilter(
    raw: NDArray[np.uint8],
    raw_window: NDArray[np.uint64],
    height: int,
    width: int,
    out: NDArray[np.uint8],
    out_window: NDArray[np.uint64],
) -> None:
    """Undo the filters of a PNG with one byte a pixel.

    Where a row's residuals are zero, `up` copies the row above, `sub` repeats the pixel on the left, and `paeth` does
    the first while left and above left are equal, the other while above and above left are.

    Args:
        raw: the inflated pixel data, shape (height * (width + 1),); every filter is 0 to 4.
        raw_window: its window.
        height: rows.
        width: pixels, and bytes, of a row.
        out: where labels go, shape (height * width + PADDING,) or longer.
        out_window: its window.

    Source:
        Portable Network Graphics (PNG) Specification, W3C, section 9.
    """
    columns = U64(width)
    for row in range(height):
        source = U64(row) * (columns + U64(1)) + U64(1)
        target = U64(row) * columns
        above = target - columns
        kind = raw[source - U64(1)]
        at = U64(0)
        left = U8(0)
        corner = U8(0)
        if row == 0:  # nothing is above: up is none, paeth is sub
            if kind == 2:
                kind = U8(0)
            elif kind == 4:
                kind = U8(1)
        last = row == height - 1  # a window may not look behind the last row
        if kind == 0:
            for i in range(columns):
                out[target + i] = raw[source + i]
        elif kind == 1:
            while at < columns:
                if last:
                    left = U8(left + raw[source + at])
                    out[target + at] = left
                    at += U64(1)
                    continue
                residual = raw_window[source + at]
                word = U64(left) * EACH_BYTE
                if residual != U64(0):
                    residual = add_bytes(residual, residual << U64(8))
                    residual = add_bytes(residual, residual << U64(16))
                    word = add_bytes(add_bytes(residual, residual << U64(32)), word)
                    left = U8(word >> U64(56))
                out_window[target + at] = word
                at += U64(8)
        elif kind == 2:
            for i in range(columns):
                out[target + i] = U8(raw[source + i] + out[above + i])
        elif kind == 3:
            before = I32(0)
            for i in range(columns):
                up = I32(out[above + i]) if row else I32(0)
                before = (I32(raw[source + i]) + ((before + up) >> 1)) & I32(255)
                out[target + i] = U8(before)
        else:
            while at < columns:
                if not last and left == corner:
                    residual = raw_window[source + at]
                    out_window[target + at] = out_window[above + at]
                    while residual == U64(0):
                        at += U64(8)
                        if at >= columns:
                            break
                        out_window[target + at] = out_window[above + at]
                        residual = raw_window[source + at]
                    if at < columns:
                        at += first_set(residual) >> U64(3)
                    if at < columns:
                        corner = out[above + at]
                        left = U8(raw[source + at] + corner)
                        out[target + at] = left
                        at += U64(1)
                    continue
                if not last:
                    same = U64(corner) * EACH_BYTE
                    word = U64(left) * EACH_BYTE
                    residual = raw_window[source + at] | (out_window[above + at] ^ same)
                    out_window[target + at] = word
                    while residual == U64(0):
                        at += U64(8)
                        if at >= columns:
                            break
                        out_window[target + at] = word
                        residual = raw_window[source + at] | (out_window[above + at] ^ same)
                    if at < columns:
                        at += first_set(residual) >> U64(3)
                if at < columns:
                    up8 = out[above + at]
                    left = U8(raw[source + at] + U8(_paeth(I32(left), I32(up8), I32(corner))))
                    out[target + at] = left
                    corner = up8
                    at += U64(1)
