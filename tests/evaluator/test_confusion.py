"""Counts of pairs and their folding agree with a loop over pixels."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from evaluator.benchmark import INVALID
from evaluator.confusion import fold, pair_counts

K = 3
COLUMNS = np.full(256, INVALID, np.uint8)
COLUMNS[[0, 1, 2, 3, 4, 255]] = [3, 0, 2, 1, 2, 3]  # 0 is unlabelled, 2 and 4 are one class

pixels = st.lists(st.tuples(st.sampled_from([0, 1, 2, 255]), st.sampled_from([0, 1, 2, 3, 4, 255])), max_size=60)


def unzip(pairs: list[tuple[int, int]]) -> NDArray[np.uint8]:
    return np.array(pairs, np.uint8).reshape(-1, 2).T


@given(st.lists(st.tuples(st.integers(0, 255), st.integers(0, 255)), max_size=60))
def test_every_pair_of_true_class_and_value_is_counted_once(pairs: list[tuple[int, int]]) -> None:
    expected = np.zeros((256, 256), np.int64)
    for true, value in pairs:
        expected[true, value] += 1
    found = pair_counts(*unzip(pairs))
    assert found.dtype == np.int64
    np.testing.assert_array_equal(found, expected)


@given(pixels)
def test_a_matrix_has_a_row_a_class_a_column_a_class_and_one_for_void(pairs: list[tuple[int, int]]) -> None:
    expected = np.zeros((K, K + 1), np.int64)
    for true, value in pairs:
        if true != 255:
            expected[true, COLUMNS[value]] += 1
    found = fold(pair_counts(*unzip(pairs)), COLUMNS, K)
    assert found.dtype == np.int64
    np.testing.assert_array_equal(found, expected)


@given(pixels, pixels)
def test_the_matrices_of_two_parts_add_up_to_that_of_the_whole(
    first: list[tuple[int, int]], second: list[tuple[int, int]]
) -> None:
    parts = [fold(pair_counts(*unzip(part)), COLUMNS, K) for part in (first, second)]
    np.testing.assert_array_equal(sum(parts), fold(pair_counts(*unzip(first + second)), COLUMNS, K))


@pytest.mark.parametrize("true", [0, 255])
def test_a_value_outside_the_encoding_is_never_folded_away_not_even_where_nothing_is_labelled(true: int) -> None:
    with pytest.raises(ValueError, match="a value occurs that the encoding does not have"):
        fold(pair_counts(np.array([true], np.uint8), np.array([5], np.uint8)), COLUMNS, K)
