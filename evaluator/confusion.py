"""Labels to counts that add up: how often each true class met each predicted value."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from evaluator.benchmark import INVALID

VALUES = 256


def pair_counts(truth: NDArray[np.uint8], labels: NDArray[np.uint8]) -> NDArray[np.int64]:
    """Count every pair of true class and predicted value.

    Args:
        truth: canonical classes, 255 for unlabelled; shape (N,).
        labels: values as they stand in the submitted file; shape (N,).

    Returns:
        Shape (256, 256): rows are true classes, columns predicted values.
    """
    pairs = (truth.astype(np.uint16) << 8) | labels
    return np.bincount(pairs, minlength=VALUES * VALUES).reshape(VALUES, VALUES)


def fold(pairs: NDArray[np.int64], columns: NDArray[np.uint8], k: int) -> NDArray[np.int64]:
    """Reduce the counts of pairs to a confusion matrix over the full class space.

    Args:
        pairs: counts, shape (256, 256), as `pair_counts` gives them.
        columns: where each value is counted, shape (256,), as `Benchmark.columns` gives it.
        k: the number of classes.

    Returns:
        Shape (K, K + 1): rows are true classes, the last column is void. Pixels without a true class are not counted.

    Raises:
        ValueError: a value occurs that the encoding does not have.
    """
    if pairs[:, columns == INVALID].any():
        raise ValueError("a value occurs that the encoding does not have")
    matrix = np.zeros((k, k + 1), np.int64)
    for value in np.flatnonzero(pairs[:k].any(axis=0)):
        matrix[:, columns[value]] += pairs[:k, value]
    return matrix
