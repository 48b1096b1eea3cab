"""Counts agree with a loop over pixels, whichever kernel made them, and fold into matrices that add up."""

from __future__ import annotations

from typing import Literal

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from evaluator.benchmark import INVALID
from evaluator.buffer import Buffer
from evaluator.confusion import Runs, count_cloud, count_image, fold, reference_counts

pytestmark = pytest.mark.usefixtures("either_path")

K = 3
COLUMNS = np.full(256, INVALID, np.uint8)
COLUMNS[[0, 1, 2, 3, 4, 255]] = [3, 0, 2, 1, 2, 3]  # 0 is unlabelled, 2 and 4 are one class

Stretches = list[tuple[int, int, int]]
"""True class, predicted value, and how many pixels in a row have both."""

truths = st.sampled_from([0, 1, 2, 255])
lengths = st.one_of(st.integers(1, 5), st.integers(1, 90))
anything = st.lists(st.tuples(truths, st.integers(0, 255), lengths), max_size=40)
encoded = st.lists(st.tuples(truths, st.sampled_from([0, 1, 2, 3, 4, 255]), lengths), max_size=40)


def unzip(stretches: Stretches) -> tuple[Runs, NDArray[np.uint8]]:
    table = np.array(stretches, np.uint32).reshape(-1, 3)
    runs = Runs(table[:, 0].astype(np.uint8), table[:, 2].copy())
    return runs, np.repeat(table[:, 1].astype(np.uint8), table[:, 2])


def loop(runs: Runs, labels: NDArray[np.uint8]) -> NDArray[np.int64]:
    expected = np.zeros((K + 1, 256), np.int64)
    for true, value in zip(np.repeat(runs.classes, runs.lengths), labels, strict=True):
        expected[min(int(true), K), value] += 1
    return expected


def in_buffer(labels: NDArray[np.uint8]) -> Buffer:
    buffer = Buffer()
    buffer.take(labels.size + 40)[:] = 77  # what stands behind must not count
    buffer.take(labels.size)[:] = labels
    return buffer


@given(anything)
def test_every_pair_of_true_row_and_value_is_counted_once(stretches: Stretches) -> None:
    runs, labels = unzip(stretches)
    found = reference_counts(runs, labels, K)
    assert found.dtype == np.int64
    np.testing.assert_array_equal(found, loop(runs, labels))


@given(anything, st.booleans())
def test_an_image_counts_as_the_reference_does_whether_it_is_taken_for_noise_or_not(
    stretches: Stretches, noisy: Literal[True, False]
) -> None:
    runs, labels = unzip(stretches)
    found = count_image(runs, in_buffer(labels), labels.size, K, noisy=noisy, spare=Buffer())
    assert found.dtype == np.int64
    np.testing.assert_array_equal(found, reference_counts(runs, labels, K))


@given(anything, st.integers(0, 65535))
def test_a_cloud_counts_as_the_reference_does_whatever_the_upper_bits_are(stretches: Stretches, upper: int) -> None:
    runs, labels = unzip(stretches)
    points = labels.astype(np.uint32) | np.uint32(upper << 16)
    found = count_cloud(runs, points, K, spare=Buffer())
    assert found is not None
    np.testing.assert_array_equal(found, reference_counts(runs, labels, K))


@given(anything.filter(bool), st.data())
def test_a_cloud_with_a_label_above_255_anywhere_is_not_counted(stretches: Stretches, data: st.DataObject) -> None:
    runs, labels = unzip(stretches)
    points = labels.astype(np.uint32)
    points[data.draw(st.integers(0, labels.size - 1))] = data.draw(st.integers(256, 65535))
    assert count_cloud(runs, points, K, spare=Buffer()) is None


@pytest.mark.parametrize("length", [2, 4, 4_000_000_000])
@pytest.mark.parametrize("noisy", [True, False])
def test_runs_of_another_number_of_pixels_are_an_error_and_nothing_is_read_behind_the_end(
    length: int, *, noisy: bool
) -> None:
    runs, labels = Runs(np.array([1], np.uint8), np.array([length], np.uint32)), np.array([1, 2, 3], np.uint8)
    with pytest.raises(ValueError, match=f"^{length} labels, expected 3$"):
        count_image(runs, in_buffer(labels), 3, K, noisy=noisy, spare=Buffer())
    with pytest.raises(ValueError, match=f"^{length} labels, expected 3$"):
        count_cloud(runs, labels.astype(np.uint32), K, spare=Buffer())


@given(encoded)
def test_a_matrix_has_a_row_a_class_a_column_a_class_and_one_for_void(stretches: Stretches) -> None:
    runs, labels = unzip(stretches)
    expected = np.zeros((K, K + 1), np.int64)
    for true, value in zip(np.repeat(runs.classes, runs.lengths), labels, strict=True):
        if true != 255:
            expected[true, COLUMNS[value]] += 1
    found = fold(reference_counts(runs, labels, K)[None], COLUMNS)
    assert found.dtype == np.int64
    np.testing.assert_array_equal(found, expected[None])


@given(encoded, encoded)
def test_matrices_are_folded_frame_by_frame_and_add_up_to_that_of_the_whole(
    first: Stretches, second: Stretches
) -> None:
    counts = [reference_counts(*unzip(part), K) for part in (first, second, first + second)]
    folded = fold(np.stack(counts), COLUMNS)
    for one, alone in zip(folded, counts, strict=True):
        np.testing.assert_array_equal(one, fold(alone[None], COLUMNS)[0])
    np.testing.assert_array_equal(folded[0] + folded[1], folded[2])


@pytest.mark.parametrize("true", [0, 255])
def test_a_value_outside_the_encoding_is_never_folded_away_not_even_where_nothing_is_labelled(true: int) -> None:
    counts = reference_counts(Runs(np.array([true], np.uint8), np.array([1], np.uint32)), np.array([5], np.uint8), K)
    with pytest.raises(ValueError, match="a value occurs that the encoding does not have"):
        fold(counts[None], COLUMNS)
