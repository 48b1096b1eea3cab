"""Compiled kernels (extra `fast`): PNG rows to labels, and labels to counts; each has a plain reference elsewhere.

A label map is mostly long runs of one value, so the kernels look at eight bytes at once through a *window*: an array of
uint64 whose element i is the eight bytes from byte i on. Signatures are explicit, so that nothing is compiled twice, and
indices are unsigned, so that none is tested for being negative.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from llvmlite import ir
from numba import njit, types
from numba.core import cgutils
from numba.extending import intrinsic
from numpy.typing import NDArray

PADDING = 16
"""Bytes behind a buffer that a window may read or write, whatever stands there."""

_u8, _i32, _i64, _u64 = types.uint8, types.int32, types.int64, types.uint64
_bytes = types.Array(_u8, 1, "C")
_window = types.Array(_u64, 1, "A", aligned=False)
_words = types.Array(types.uint32, 1, "C")
_counts = types.Array(_i64, 1, "C")

_EACH_BYTE = np.uint64(0x0101010101010101)
_OPTIONS: dict[str, Any] = {"nogil": True, "boundscheck": False, "cache": True}


def window(buffer: NDArray[np.uint8]) -> NDArray[np.uint64]:
    """Eight bytes from each byte on, as numbers; shape (N - 7,), sharing the buffer's memory."""
    return np.ndarray((buffer.size - 7,), np.uint64, buffer, 0, (1,))


@intrinsic  # type: ignore[untyped-decorator]
def _first_set(_context: object, _value: types.Integer) -> tuple[object, object]:
    """The number of zero bits below the lowest set one."""

    def generate(_: object, builder: ir.IRBuilder, __: object, args: tuple[ir.Value]) -> ir.Value:
        return builder.cttz(args[0], cgutils.true_bit)

    return _u64(_u64), generate


@njit(inline="always")  # type: ignore[untyped-decorator]
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


@njit([types.void(_bytes, _window, _i64, _i64, _bytes, _window)], **_OPTIONS)  # type: ignore[untyped-decorator]
def unfilter(  # noqa: C901, PLR0912, PLR0913, PLR0915 one loop over rows, one branch a filter
    raw: NDArray[np.uint8],
    raw_window: NDArray[np.uint64],
    height: int,
    width: int,
    out: NDArray[np.uint8],
    out_window: NDArray[np.uint64],
) -> None:
    """Undo the filters of a PNG with one byte a pixel.

    Where a row's residuals are zero, `up` copies the row above; `sub` repeats the pixel on the left; and `paeth` does the
    one while left and above left are equal, the other while above and above left are.

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
    columns = _u64(width)
    for row in range(height):
        source = _u64(row) * (columns + _u64(1)) + _u64(1)
        target = _u64(row) * columns
        above = target - columns
        kind = raw[source - _u64(1)]
        at = _u64(0)
        left = _u8(0)
        corner = _u8(0)
        if row == 0:  # nothing is above: up is none, paeth is sub
            if kind == 2:
                kind = _u8(0)
            elif kind == 4:
                kind = _u8(1)
        last = row == height - 1  # a window may not look behind the last row
        if kind == 0:
            for i in range(columns):
                out[target + i] = raw[source + i]
        elif kind == 1:
            while at < columns:
                if last:
                    left = _u8(left + raw[source + at])
                    out[target + at] = left
                    at += _u64(1)
                    continue
                word = _u64(left) * _EACH_BYTE
                residual = raw_window[source + at]
                out_window[target + at] = word
                while residual == _u64(0):
                    at += _u64(8)
                    if at >= columns:
                        break
                    out_window[target + at] = word
                    residual = raw_window[source + at]
                if at < columns:
                    at += _first_set(residual) >> _u64(3)
                if at < columns:
                    left = _u8(left + raw[source + at])
                    out[target + at] = left
                    at += _u64(1)
        elif kind == 2:
            for i in range(columns):
                out[target + i] = _u8(raw[source + i] + out[above + i])
        elif kind == 3:
            before = _i32(0)
            for i in range(columns):
                up = _i32(out[above + i]) if row else _i32(0)
                before = (_i32(raw[source + i]) + ((before + up) >> 1)) & _i32(255)
                out[target + i] = _u8(before)
        else:
            while at < columns:
                if not last and left == corner:
                    residual = raw_window[source + at]
                    out_window[target + at] = out_window[above + at]
                    while residual == _u64(0):
                        at += _u64(8)
                        if at >= columns:
                            break
                        out_window[target + at] = out_window[above + at]
                        residual = raw_window[source + at]
                    if at < columns:
                        at += _first_set(residual) >> _u64(3)
                    if at < columns:
                        corner = out[above + at]
                        left = _u8(raw[source + at] + corner)
                        out[target + at] = left
                        at += _u64(1)
                    continue
                if not last:
                    same = _u64(corner) * _EACH_BYTE
                    word = _u64(left) * _EACH_BYTE
                    residual = raw_window[source + at] | (out_window[above + at] ^ same)
                    out_window[target + at] = word
                    while residual == _u64(0):
                        at += _u64(8)
                        if at >= columns:
                            break
                        out_window[target + at] = word
                        residual = raw_window[source + at] | (out_window[above + at] ^ same)
                    if at < columns:
                        at += _first_set(residual) >> _u64(3)
                if at < columns:
                    up8 = out[above + at]
                    left = _u8(raw[source + at] + _u8(_paeth(_i32(left), _i32(up8), _i32(corner))))
                    out[target + at] = left
                    corner = up8
                    at += _u64(1)


@njit([types.void(_bytes, _words, _bytes, _window, _counts)], **_OPTIONS)  # type: ignore[untyped-decorator]
def count_runs(
    rows: NDArray[np.uint8],
    lengths: NDArray[np.uint32],
    labels: NDArray[np.uint8],
    labels_window: NDArray[np.uint64],
    counts: NDArray[np.int64],
) -> None:
    """Count labels against runs of truth, a stretch of equal labels at a time.

    Args:
        rows: the true row of each run, shape (R,).
        lengths: pixels of each run, shape (R,).
        labels: the values of the prediction, shape (N + PADDING,) or longer.
        labels_window: their window.
        counts: where counts are added, shape ((K + 1) * 256,).
    """
    at = _u64(0)
    for run in range(_u64(rows.size)):
        base = _u64(rows[run]) << _u64(8)
        end = at + _u64(lengths[run])
        while at < end:
            value = _u64(labels[at])
            word = value * _EACH_BYTE
            start = at
            differing = labels_window[at] ^ word
            while differing == _u64(0):
                at += _u64(8)
                if at >= end:
                    break
                while (
                    at + _u64(32) <= end
                    and (
                        (labels_window[at] ^ word)
                        | (labels_window[at + _u64(8)] ^ word)
                        | (labels_window[at + _u64(16)] ^ word)
                        | (labels_window[at + _u64(24)] ^ word)
                    )
                    == _u64(0)
                ):
                    at += _u64(32)
                if at >= end:
                    break
                differing = labels_window[at] ^ word
            if at < end:
                at = min(at + (_first_set(differing) >> _u64(3)), end)
            at = min(at, end)
            counts[base + value] += _i64(at - start)


@njit([types.void(_bytes, _words, _bytes, _counts)], **_OPTIONS)  # type: ignore[untyped-decorator]
def count_noise(
    rows: NDArray[np.uint8], lengths: NDArray[np.uint32], labels: NDArray[np.uint8], counts: NDArray[np.int64]
) -> None:
    """Count labels that hardly ever repeat: pixel by pixel, into four tables in turn, so that none waits for itself.

    Args:
        rows: the true row of each run, shape (R,).
        lengths: pixels of each run, shape (R,).
        labels: the values of the prediction, shape (N,) or longer.
        counts: where counts are added, shape (4 * (K + 1) * 256,); the four tables are to be summed.
    """
    size = _u64(counts.size >> 2)
    at = _u64(0)
    for run in range(_u64(rows.size)):
        base = _u64(rows[run]) << _u64(8)
        end = at + _u64(lengths[run])
        while at + _u64(4) <= end:
            counts[base + _u64(labels[at])] += 1
            counts[size + base + _u64(labels[at + _u64(1)])] += 1
            counts[size + size + base + _u64(labels[at + _u64(2)])] += 1
            counts[size + size + size + base + _u64(labels[at + _u64(3)])] += 1
            at += _u64(4)
        while at < end:
            counts[base + _u64(labels[at])] += 1
            at += _u64(1)


@njit([_u64(_bytes, _words, _words, _counts)], **_OPTIONS)  # type: ignore[untyped-decorator]
def count_points(
    rows: NDArray[np.uint8], lengths: NDArray[np.uint32], labels: NDArray[np.uint32], counts: NDArray[np.int64]
) -> int:
    """Count the labels of a cloud against runs of truth.

    Args:
        rows: the true row of each run, shape (R,).
        lengths: points of each run, shape (R,).
        labels: as the file has them, of which the lower 16 bits count; shape (N,).
        counts: where counts are added, shape ((K + 1) * 256,).

    Returns:
        Zero when every label is below 256; else the counts are of no use.
    """
    over = _u64(0)
    at = _u64(0)
    for run in range(_u64(rows.size)):
        base = _u64(rows[run]) << _u64(8)
        end = at + _u64(lengths[run])
        while at + _u64(4) <= end:
            a = _u64(labels[at]) & _u64(0xFFFF)
            b = _u64(labels[at + _u64(1)]) & _u64(0xFFFF)
            c = _u64(labels[at + _u64(2)]) & _u64(0xFFFF)
            d = _u64(labels[at + _u64(3)]) & _u64(0xFFFF)
            over |= a | b | c | d
            if a == b and b == c and c == d:
                counts[base + (a & _u64(255))] += 4
            else:
                counts[base + (a & _u64(255))] += 1
                counts[base + (b & _u64(255))] += 1
                counts[base + (c & _u64(255))] += 1
                counts[base + (d & _u64(255))] += 1
            at += _u64(4)
        while at < end:
            a = _u64(labels[at]) & _u64(0xFFFF)
            over |= a
            counts[base + (a & _u64(255))] += 1
            at += _u64(1)
    return over >> _u64(8)
