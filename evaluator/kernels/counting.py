"""Labels to counts of true row and predicted value."""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

from evaluator.kernels.words import (
    BYTES,
    COUNTS,
    EACH_BYTE,
    FROZEN,
    I64,
    LENGTHS,
    OPTIONS,
    PAIRS,
    U64,
    WIDTH,
    WINDOW,
    WORDS,
    differing,
    first_set,
)

HIGHEST_BIT = np.uint64(1 << 63)
"""What `count_points` adds to its answer when a label is above 255."""


@njit([U64(FROZEN, LENGTHS, I64, I64, BYTES, COUNTS)], **OPTIONS)
def count_runs(
    classes: NDArray[np.uint8],
    lengths: NDArray[np.uint32],
    k: int,
    size: int,
    labels: NDArray[np.uint8],
    counts: NDArray[np.int64],
) -> int:
    """Count labels against runs of truth, a stretch of equal labels at a time.

    Args:
        classes: the true class of each run, 255 for unlabelled; shape (R,).
        lengths: pixels of each run, shape (R,).
        k: the number of classes K, which is also the row of what is unlabelled.
        size: the number of pixels N.
        labels: the values of the prediction, shape (N + PADDING,) or longer.
        counts: where counts are added, shape ((K + 1) * 256,).

    Returns:
        The pixels that the runs cover; the counts are of use when it is N.
    """
    at = U64(0)
    stop = U64(size)
    width = U64(WIDTH)
    for run in range(U64(classes.size)):
        base = min(U64(classes[run]), U64(k)) << U64(8)
        end = at + U64(lengths[run])
        if end > stop:
            return end
        while at < end:
            value = labels[at]
            start = at
            others = differing(labels, at, value)
            while others == U64(0):
                at += width
                if at >= end:
                    break
                others = differing(labels, at, value)
            if others != U64(0):
                at += first_set(others)
            at = min(at, end)
            counts[base + U64(value)] += I64(at - start)
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
    at = U64(0)
    stop = U64(size)
    for run in range(U64(classes.size)):
        end = at + U64(lengths[run])
        if end > stop:
            return end
        row = min(U64(classes[run]), U64(k))
        word = row * EACH_BYTE
        rows_window[at] = word  # most runs are short: stores cost less than a wrong guess where one ends
        rows_window[at + U64(8)] = word
        rows_window[at + U64(16)] = word
        at += U64(24)
        while at < end:
            rows_window[at] = word
            at += U64(8)
        at = end
    return at


@njit(inline="always")
def _merge(counts: NDArray[np.int64]) -> None:
    """Add the other three tables to the first."""
    table = U64(counts.size >> 2)
    for i in range(table):
        counts[i] += counts[table + i] + counts[table + table + i] + counts[table + table + table + i]


@njit([U64(FROZEN, LENGTHS, I64, I64, I64, BYTES, WINDOW, BYTES, COUNTS)], **OPTIONS)
def count_noise(
    classes: NDArray[np.uint8],
    lengths: NDArray[np.uint32],
    k: int,
    size: int,
    bits: int,
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
        bits: of a row: 2 to the power of bits is more than K.
        rows: memory for the true rows, shape (N + PADDING,) or longer.
        rows_window: its window.
        labels: the values of the prediction, shape (N,) or longer.
        counts: four tables of zeros, shape (4 * 256 * 2**bits,); the first gets the counts, value by value and in a
            value row by row: the few values that occur are near each other and stay in the fastest memory.

    Returns:
        The pixels that the runs cover; the counts are of use when it is N.
    """
    covered = _expand(classes, lengths, k, size, rows_window)
    if covered != U64(size):
        return covered
    table = U64(counts.size >> 2)
    shift = U64(bits)
    at = U64(0)
    while at + U64(4) <= covered:
        counts[(U64(labels[at]) << shift) + U64(rows[at])] += 1
        at += U64(1)
        counts[table + (U64(labels[at]) << shift) + U64(rows[at])] += 1
        at += U64(1)
        counts[table + table + (U64(labels[at]) << shift) + U64(rows[at])] += 1
        at += U64(1)
        counts[table + table + table + (U64(labels[at]) << shift) + U64(rows[at])] += 1
        at += U64(1)
    while at < covered:
        counts[(U64(labels[at]) << shift) + U64(rows[at])] += 1
        at += U64(1)
    _merge(counts)
    return covered


@njit([U64(FROZEN, LENGTHS, I64, I64, I64, BYTES, WINDOW, WORDS, PAIRS, COUNTS)], **OPTIONS)
def count_points(
    classes: NDArray[np.uint8],
    lengths: NDArray[np.uint32],
    k: int,
    size: int,
    bits: int,
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
        bits: of a row: 2 to the power of bits is more than K.
        rows: memory for the true rows, shape (N + PADDING,) or longer.
        rows_window: its window.
        points: as the file has them, of which the lower 16 bits are the label; shape (N,).
        pairs: the same memory, two points a number; shape (N // 2,).
        counts: four tables of zeros, shape (4 * 256 * 2**bits,); the first gets the counts, value by value and in a
            value row by row: the few values that occur are near each other and stay in the fastest memory.

    Returns:
        The points that the runs cover, with the highest bit set when a label is above 255; the counts are of use when
        it is N.
    """
    covered = _expand(classes, lengths, k, size, rows_window)
    if covered != U64(size):
        return covered
    table = U64(counts.size >> 2)
    shift = U64(bits)
    low = U64(0xFFFF)
    byte = U64(0xFF)
    over = U64(0)
    at = U64(0)
    while at + U64(4) <= covered:  # eight rows in a word, two points in a word
        row = rows_window[at]
        first = pairs[at >> U64(1)]
        second = pairs[(at >> U64(1)) + U64(1)]
        over |= first | second
        counts[((first & byte) << shift) + (row & byte)] += 1
        counts[table + (((first >> U64(32)) & byte) << shift) + ((row >> U64(8)) & byte)] += 1
        counts[table + table + ((second & byte) << shift) + ((row >> U64(16)) & byte)] += 1
        counts[table + table + table + (((second >> U64(32)) & byte) << shift) + ((row >> U64(24)) & byte)] += 1
        at += U64(4)
    over = (over | (over >> U64(32))) & low
    while at < covered:
        a = U64(points[at]) & low
        over |= a
        counts[((a & byte) << shift) + U64(rows[at])] += 1
        at += U64(1)
    _merge(counts)
    return covered if over < U64(256) else covered | HIGHEST_BIT
