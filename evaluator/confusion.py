"""Labels to counts that add up: how often each true class met each predicted value."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from evaluator.benchmark import INVALID, LOW_BITS, UNLABELLED
from evaluator.buffer import Buffer
from evaluator.compiled import kernels

VALUES = 256


class Runs(NamedTuple):
    """True labels as runs.

    Attributes:
        classes: the canonical class of each run, 255 for unlabelled; shape (R,).
        lengths: pixels or points of each run, shape (R,).
    """

    classes: NDArray[np.uint8]
    lengths: NDArray[np.uint32]

    @classmethod
    def of_nothing(cls, size: int) -> Runs:
        """Runs of a frame of which no truth is known: all unlabelled."""
        return cls(np.array([UNLABELLED], np.uint8), np.array([size], np.uint32))

    def expand(self, size: int) -> NDArray[np.uint8]:
        """The class of each pixel or point, shape (size,).

        Raises:
            ValueError: the runs are damaged and give another number of labels, which may not fit into memory.
        """
        covered = int(self.lengths.sum(dtype=np.int64))
        if covered != size:
            raise _damaged(covered, size)
        return np.repeat(self.classes, self.lengths)


def reference_counts(runs: Runs, labels: NDArray[np.uint8], k: int) -> NDArray[np.int64]:
    """Count every pair of true row and predicted value, plainly: what every kernel is held to.

    Args:
        runs: the truth of N pixels or points.
        labels: values as they stand in the submitted file, shape (N,).
        k: the number of classes.

    Returns:
        Shape (K + 1, 256): a row for each class, the last for unlabelled.

    Raises:
        ValueError: the runs are of another number of pixels.
    """
    rows = np.minimum(runs.expand(labels.size), k)
    pairs = (rows.astype(np.uint16) << 8) | labels
    return np.bincount(pairs, minlength=(k + 1) * VALUES).reshape(k + 1, VALUES)


def count_image(  # noqa: PLR0913 a frame and the memory for it
    runs: Runs, image: Buffer, size: int, k: int, *, noisy: bool, spare: Buffer
) -> NDArray[np.int64]:
    """Count a label map.

    Args:
        runs: its truth, N pixels in all.
        image: which holds the N labels.
        size: N.
        k: the number of classes.
        noisy: whether its labels hardly ever repeat, by which the kernel is chosen.
        spare: memory that a kernel may use.

    Returns:
        Shape (K + 1, 256), as `reference_counts`.

    Raises:
        ValueError: the runs are of another number of pixels.
    """
    fast = kernels()
    if fast is None:
        return reference_counts(runs, image.take(size), k)
    if not noisy:
        counts = np.zeros((k + 1, VALUES), np.int64)
        covered = fast.count_runs(*runs, k, size, image.memory, counts.reshape(-1))
    else:
        spare.take(size)
        tables = _tables(k)
        flat = tables.reshape(-1)
        covered = fast.count_noise(*runs, k, size, k.bit_length(), spare.memory, spare.window, image.memory, flat)
        counts = _by_row(tables, k)
    if covered != size:
        raise _damaged(covered, size)
    return counts


def count_cloud(runs: Runs, points: NDArray[np.uint32], k: int, *, spare: Buffer) -> NDArray[np.int64] | None:
    """Count the labels of a cloud.

    Args:
        runs: its truth, N points in all.
        points: as the file has them, of which the lower 16 bits are the label; shape (N,).
        k: the number of classes.
        spare: memory that a kernel may use.

    Returns:
        Shape (K + 1, 256), as `reference_counts`; None when a label is above 255.

    Raises:
        ValueError: the runs are of another number of points.
    """
    fast = kernels()
    if fast is None:
        labels = points & LOW_BITS
        return reference_counts(runs, labels.astype(np.uint8), k) if labels.max(initial=0) < VALUES else None
    spare.take(points.size)
    pairs = points[: points.size // 2 * 2].view(np.uint64)
    tables = _tables(k)
    flat = tables.reshape(-1)
    covered = fast.count_points(*runs, k, points.size, k.bit_length(), spare.memory, spare.window, points, pairs, flat)
    if covered == points.size | int(fast.HIGHEST_BIT):
        return None
    if covered != points.size:
        raise _damaged(covered, points.size)
    return _by_row(tables, k)


def _tables(k: int) -> NDArray[np.int64]:
    """Four tables as kernels fill them: value by value, in a value row by row."""
    return np.zeros((4, VALUES, 1 << k.bit_length()), np.int64)


def _by_row(tables: NDArray[np.int64], k: int) -> NDArray[np.int64]:
    """The first of the tables as `reference_counts` has it, shape (K + 1, 256)."""
    return np.ascontiguousarray(tables[0, :, : k + 1].T)


def _damaged(covered: int, size: int) -> ValueError:
    return ValueError(f"{covered} labels, expected {size}")


def fold(counts: NDArray[np.int64], columns: NDArray[np.uint8]) -> NDArray[np.int64]:
    """Reduce the counts of frames to their confusion matrices over the full class space.

    Args:
        counts: shape (N, K + 1, 256), a frame's as `reference_counts` gives them.
        columns: where each value is counted, shape (256,), as `Benchmark.columns` gives it.

    Returns:
        Shape (N, K, K + 1): rows are true classes, the last column is void. Pixels without a class do not count.

    Raises:
        ValueError: a value occurs that the encoding does not have.
    """
    frames, rows, _ = counts.shape
    used = np.flatnonzero(counts.any(axis=(0, 1)))
    targets = columns[used]
    if (targets == INVALID).any():
        raise ValueError("a value occurs that the encoding does not have")
    matrices = np.zeros((frames, rows - 1, rows), np.int64)
    for value, target in zip(used.tolist(), targets.tolist(), strict=True):
        matrices[:, :, target] += counts[:, :-1, value]
    return matrices
