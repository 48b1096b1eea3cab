"""Compiled kernels (extra `fast`): PNG rows to labels, and labels to counts; each has a plain reference elsewhere.

A label map is mostly long runs of one value, so the kernels look at eight bytes at once through a *window*: an array of
uint64 whose element i is the eight bytes from byte i on. Signatures are explicit, so that nothing is compiled twice;
indices are unsigned, so that none is tested for being negative. Buffers and windows are those of `evaluator.buffer`.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from llvmlite import ir
from numba import njit, types
from numba.core import cgutils
from numba.extending import intrinsic
from numpy.typing import NDArray

_u8, _i32, _i64, _u64 = types.uint8, types.int32, types.int64, types.uint64
_bytes = types.Array(_u8, 1, "C")
_window = types.Array(_u64, 1, "A", aligned=False)
_words = types.Array(types.uint32, 1, "C", readonly=True)
_frozen = types.Array(_u8, 1, "C", readonly=True)
_lengths = types.Array(types.uint32, 1, "C", readonly=True, aligned=False)
_pairs = types.Array(_u64, 1, "C", readonly=True, aligned=False)
_counts = types.Array(_i64, 1, "C")

HIGHEST_BIT = np.uint64(1 << 63)
"""What `count_points` adds to its answer when a label is above 255."""

_EACH_BYTE = np.uint64(0x0101010101010101)
_OPTIONS: dict[str, Any] = {"nogil": True, "boundscheck": False, "cache": True}


@intrinsic
def _first_set(_context: object, _value: types.Integer) -> tuple[object, object]:
    """The number of zero bits below the lowest set one."""

    def generate(_: object, builder: ir.IRBuilder, __: object, args: tuple[ir.Value]) -> ir.Value:
        return builder.cttz(args[0], cgutils.true_bit)

    return _u64(_u64), generate


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


@njit([types.void(_frozen, _window, _i64, _i64, _bytes, _window)], **_OPTIONS)
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


@njit([_u64(_frozen, _lengths, _i64, _i64, _bytes, _window, _counts)], **_OPTIONS)
def count_runs(
    classes: NDArray[np.uint8],
    lengths: NDArray[np.uint32],
    k: int,
    size: int,
    labels: NDArray[np.uint8],
    labels_window: NDArray[np.uint64],
    counts: NDArray[np.int64],
) -> int:
    """Count labels against runs of truth, a stretch of equal labels at a time.

    Args:
        classes: the true class of each run, 255 for unlabelled; shape (R,).
        lengths: pixels of each run, shape (R,).
        k: the number of classes K, which is also the row of what is unlabelled.
        size: the number of pixels N.
        labels: the values of the prediction, shape (N + PADDING,) or longer.
        labels_window: their window.
        counts: where counts are added, shape ((K + 1) * 256,).

    Returns:
        The pixels that the runs cover; the counts are of use when it is N.
    """
    at = _u64(0)
    stop = _u64(size)
    for run in range(_u64(classes.size)):
        base = min(_u64(classes[run]), _u64(k)) << _u64(8)
        end = at + _u64(lengths[run])
        if end > stop:
            return end
        while at < end:
            value = _u64(labels[at])
            word = value * _EACH_BYTE
            start = at
            differing = labels_window[at] ^ word
            while differing == _u64(0):
                at += _u64(8)
                if at >= end:
                    break
                while at + _u64(32) <= end and (
                    (labels_window[at] ^ word)
                    | (labels_window[at + _u64(8)] ^ word)
                    | (labels_window[at + _u64(16)] ^ word)
                    | (labels_window[at + _u64(24)] ^ word)
                ) == _u64(0):
                    at += _u64(32)
                if at >= end:
                    break
                differing = labels_window[at] ^ word
            if at < end:
                at += _first_set(differing) >> _u64(3)
            at = min(at, end)
            counts[base + value] += _i64(at - start)
    return at


@njit(inline="always")
def _expand(
    classes: NDArray[np.uint8],
    lengths: NDArray[np.uint32],
    k: int,
    size: int,
    rows_window: NDArray[np.uint64],
) -> int:
    """Write the true row of each of N pixels, eight at once, shape (N + PADDING,); returns the pixels of the runs."""
    at = _u64(0)
    stop = _u64(size)
    for run in range(_u64(classes.size)):
        end = at + _u64(lengths[run])
        if end > stop:
            return end
        row = min(_u64(classes[run]), _u64(k))
        word = row * _EACH_BYTE
        rows_window[at] = word  # most runs are short: stores cost less than a wrong guess where one ends
        rows_window[at + _u64(8)] = word
        rows_window[at + _u64(16)] = word
        at += _u64(24)
        while at < end:
            rows_window[at] = word
            at += _u64(8)
        at = end
    return at


@njit([_u64(_frozen, _lengths, _i64, _i64, _bytes, _window, _bytes, _counts)], **_OPTIONS)
def count_noise(
    classes: NDArray[np.uint8],
    lengths: NDArray[np.uint32],
    k: int,
    size: int,
    rows: NDArray[np.uint8],
    rows_window: NDArray[np.uint64],
    labels: NDArray[np.uint8],
    counts: NDArray[np.int64],
) -> int:
    """Count labels that hardly ever repeat: pixel by pixel, into four tables in turn, so that none waits for itself.

    Args:
        classes: as in `count_runs`.
        lengths: as in `count_runs`.
        k: the number of classes K.
        size: the number of pixels N.
        rows: memory for the true rows, shape (N + PADDING,) or longer.
        rows_window: its window.
        labels: the values of the prediction, shape (N,) or longer.
        counts: where counts are added, shape (4 * (K + 1) * 256,); the four tables are to be summed.

    Returns:
        The pixels that the runs cover; the counts are of use when it is N.
    """
    covered = _expand(classes, lengths, k, size, rows_window)
    if covered != _u64(size):
        return covered
    table = _u64(counts.size >> 2)
    at = _u64(0)
    while at + _u64(4) <= covered:
        counts[(_u64(rows[at]) << _u64(8)) + _u64(labels[at])] += 1
        at += _u64(1)
        counts[table + (_u64(rows[at]) << _u64(8)) + _u64(labels[at])] += 1
        at += _u64(1)
        counts[table + table + (_u64(rows[at]) << _u64(8)) + _u64(labels[at])] += 1
        at += _u64(1)
        counts[table + table + table + (_u64(rows[at]) << _u64(8)) + _u64(labels[at])] += 1
        at += _u64(1)
    while at < covered:
        counts[(_u64(rows[at]) << _u64(8)) + _u64(labels[at])] += 1
        at += _u64(1)
    return covered


@njit([_u64(_frozen, _lengths, _i64, _i64, _bytes, _window, _words, _pairs, _counts)], **_OPTIONS)
def count_points(
    classes: NDArray[np.uint8],
    lengths: NDArray[np.uint32],
    k: int,
    size: int,
    rows: NDArray[np.uint8],
    rows_window: NDArray[np.uint64],
    points: NDArray[np.uint32],
    pairs: NDArray[np.uint64],
    counts: NDArray[np.int64],
) -> int:
    """Count the labels of a cloud, in which runs are short, as `count_noise` does.

    Args:
        classes: as in `count_runs`.
        lengths: as in `count_runs`.
        k: the number of classes K.
        size: the number of points N.
        rows: memory for the true rows, shape (N + PADDING,) or longer.
        rows_window: its window.
        points: as the file has them, of which the lower 16 bits are the label; shape (N,).
        pairs: the same memory, two points a number; shape (N // 2,).
        counts: where counts are added, shape (4 * (K + 1) * 256,); the four tables are to be summed.

    Returns:
        The points that the runs cover, with the highest bit set when a label is above 255; the counts are of use when
        it is N.
    """
    covered = _expand(classes, lengths, k, size, rows_window)
    if covered != _u64(size):
        return covered
    table = _u64(counts.size >> 2)
    low = _u64(0xFFFF)
    byte = _u64(0xFF)
    over = _u64(0)
    at = _u64(0)
    while at + _u64(8) <= covered:  # eight rows in a word, two points in a word
        row = rows_window[at] << _u64(8)
        spread = _u64(0xFF00)
        for half in range(2):
            first = pairs[(at >> _u64(1)) + _u64(2 * half)]
            second = pairs[(at >> _u64(1)) + _u64(2 * half + 1)]
            over |= first | second
            counts[((row) & spread) + (first & byte)] += 1
            counts[table + ((row >> _u64(8)) & spread) + ((first >> _u64(32)) & byte)] += 1
            counts[table + table + ((row >> _u64(16)) & spread) + (second & byte)] += 1
            counts[table + table + table + ((row >> _u64(24)) & spread) + ((second >> _u64(32)) & byte)] += 1
            row = rows_window[at + _u64(4)] << _u64(8)
        at += _u64(8)
    over = (over | (over >> _u64(32))) & low
    while at < covered:
        a = _u64(points[at]) & low
        over |= a
        counts[(_u64(rows[at]) << _u64(8)) + (a & byte)] += 1
        at += _u64(1)
    return covered if over < _u64(256) else covered | HIGHEST_BIT
