"""The metrics agree with a few lines of plain numpy, and with the example and the rules of the protocol."""

from __future__ import annotations

from collections.abc import Iterable
from fractions import Fraction

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from numpy.typing import NDArray

from evaluator.benchmark import Benchmark
from evaluator.metrics import ClassScore, Scores, decimal, mean, restrict, score

Matrix = NDArray[np.int64]

COUNTS = st.one_of(st.just(0), st.integers(0, 9), st.integers(0, 1 << 40))


@st.composite
def confusions(draw: st.DrawFn) -> tuple[Matrix, list[int]]:
    k = draw(st.integers(1, 6))
    scored = draw(st.lists(st.integers(0, k - 1), min_size=1, unique=True).map(sorted))
    return draw(arrays(np.int64, (k, k + 1), elements=COUNTS)), scored


def reference(matrix: Matrix, scored: list[int]) -> NDArray[np.float64]:
    """IoU, precision, recall and F1 of each scored class, shape (4, S); NaN at 0/0."""
    rows = matrix[scored]
    tp = np.array([matrix[c, c] for c in scored])
    fn = rows.sum(axis=1) - tp
    fp = np.array([rows[:, c].sum() for c in scored]) - tp
    with np.errstate(invalid="ignore"):
        return np.array([tp / (tp + fp + fn), tp / (tp + fp), tp / (tp + fn), 2 * tp / (2 * tp + fp + fn)])


def shown(values: Iterable[Fraction | None]) -> NDArray[np.float64]:
    return np.array([np.nan if value is None else decimal(value) for value in values])


@given(confusions())
def test_each_figure_of_each_class_is_that_of_plain_numpy(drawn: tuple[Matrix, list[int]]) -> None:
    matrix, scored = drawn
    found = score(matrix, scored).classes
    assert list(found) == scored
    figures = [shown(getattr(one, name) for one in found.values()) for name in ("iou", "precision", "recall", "f1")]
    np.testing.assert_array_equal(np.array(figures), reference(matrix, scored))


@given(confusions())
def test_the_means_are_those_of_plain_numpy(drawn: tuple[Matrix, list[int]]) -> None:
    matrix, scored = drawn
    iou, _, recall, _ = reference(matrix, scored)
    rows, tp = matrix[scored].sum(axis=1), np.array([matrix[c, c] for c in scored])
    found = score(matrix, scored)
    some = rows.sum() > 0
    expected = [
        np.nanmean(iou) if not np.isnan(iou).all() else np.nan,
        tp.sum() / rows.sum() if some else np.nan,
        np.nanmean(recall) if some else np.nan,
        np.nansum(rows / rows.sum() * iou) if some else np.nan,
    ]
    figures = shown([found.miou, found.accuracy, found.mean_accuracy, found.fw_iou])
    np.testing.assert_allclose(figures, np.array(expected), rtol=1e-12)


@given(confusions())
def test_every_figure_is_a_share(drawn: tuple[Matrix, list[int]]) -> None:
    scores = score(*drawn)
    figures = [scores.miou, scores.accuracy, scores.mean_accuracy, scores.fw_iou]
    figures += [value for one in scores.classes.values() for value in (one.iou, one.precision, one.recall, one.f1)]
    assert all(value is None or 0 <= value <= 1 for value in figures)


@given(confusions(), st.integers(2, 9))
def test_a_submission_counted_several_times_scores_the_same(drawn: tuple[Matrix, list[int]], times: int) -> None:
    matrix, scored = drawn
    assert score(matrix * times, scored) == score(matrix, scored)


@given(confusions())
def test_columns_of_classes_that_are_not_scored_are_void(drawn: tuple[Matrix, list[int]]) -> None:
    matrix, scored = drawn
    found = restrict(matrix, scored)
    assert found.shape == (len(scored), len(scored) + 1)
    np.testing.assert_array_equal(found[:, :-1], matrix[np.ix_(scored, scored)])
    np.testing.assert_array_equal(found.sum(axis=1), matrix[scored].sum(axis=1))


@given(confusions())
def test_rows_of_classes_that_are_not_scored_change_nothing(drawn: tuple[Matrix, list[int]]) -> None:
    matrix, scored = drawn
    other = matrix.copy()
    other[[c for c in range(len(matrix)) if c not in scored]] = 7
    assert score(other, scored) == score(matrix, scored)


TRUNK, STRUCTURE, WATER, OTHER_TERRAIN, DIRT, SKY, VOID = 13, 11, 14, 8, 1, 10, 15


@pytest.fixture
def worked() -> Matrix:
    """The example of the protocol: points of a cloud."""
    matrix = np.zeros((15, 16), np.int64)
    matrix[TRUNK, [TRUNK, SKY, VOID]] = 80, 10, 10
    matrix[STRUCTURE, SKY] = 50
    matrix[WATER, WATER] = 20
    matrix[OTHER_TERRAIN, DIRT] = 10
    return matrix


def test_the_worked_example_of_the_protocol_comes_out(worked: Matrix, wildscenes: Benchmark) -> None:
    track = wildscenes.track("3d-standard")
    none = ClassScore(iou=None, precision=None, recall=None, f1=None)
    expected = dict.fromkeys(track.scored, none)
    expected[TRUNK] = ClassScore(Fraction(4, 5), Fraction(1), Fraction(4, 5), Fraction(8, 9))
    expected[STRUCTURE] = ClassScore(Fraction(0), None, Fraction(0), Fraction(0))
    assert restrict(worked, track.scored).sum() == 150
    assert score(worked, track.scored) == Scores(
        miou=Fraction(2, 5),
        accuracy=Fraction(80, 150),
        mean_accuracy=Fraction(2, 5),
        fw_iou=Fraction(100, 150) * Fraction(4, 5),
        classes=expected,
    )


def test_the_official_mean_of_the_worked_example_has_other_terrain_and_the_dirt_it_was_taken_for(
    worked: Matrix, wildscenes: Benchmark
) -> None:
    scores = score(worked, wildscenes.track("3d-standard").official)
    defined = {index: one.iou for index, one in scores.classes.items() if one.iou is not None}
    assert defined == {DIRT: 0, OTHER_TERRAIN: 0, STRUCTURE: 0, TRUNK: Fraction(4, 5)}
    assert scores.miou == Fraction(1, 5)


def test_cylinder3ds_official_mean_is_its_printed_mean_over_thirteen_classes() -> None:
    assert round(40.07 * 12 / 13, 2) == 36.99


ABSENT = np.array([[3, 1, 0], [0, 0, 0]], np.int64)
"""Class 1 has no ground truth but was predicted once."""


def test_a_class_that_is_absent_but_predicted_scores_zero() -> None:
    assert score(ABSENT, [0, 1]).classes[1].iou == 0
    assert score(ABSENT, [0, 1]).miou == Fraction(3, 8)


def test_a_class_that_is_absent_is_a_dash_for_everybody_in_practice() -> None:
    assert score(ABSENT, [0, 1], dash_absent=True).classes[1].iou is None
    assert score(ABSENT, [0, 1], dash_absent=True).miou == Fraction(3, 4)


def test_a_class_that_is_neither_there_nor_predicted_is_left_out_of_every_mean() -> None:
    matrix = np.array([[2, 0, 2], [0, 0, 0]], np.int64)
    scores = score(matrix, [0, 1])
    assert scores.classes[1] == ClassScore(None, None, None, None)
    assert (scores.miou, scores.mean_accuracy, scores.fw_iou) == (Fraction(1, 2),) * 3


def test_nothing_counted_gives_no_figure_at_all() -> None:
    none = ClassScore(None, None, None, None)
    assert score(np.zeros((2, 3), np.int64), [0, 1]) == Scores(None, None, None, None, {0: none, 1: none})


def test_void_counts_as_a_miss_and_never_as_a_false_alarm() -> None:
    scores = score(np.array([[6, 0, 4], [0, 5, 0]], np.int64), [0, 1])
    assert scores.classes[0] == ClassScore(Fraction(3, 5), Fraction(1), Fraction(3, 5), Fraction(3, 4))
    assert scores.accuracy == Fraction(11, 15)


def test_figures_are_exact_beyond_what_a_float_can_hold() -> None:
    matrix = np.array([[(1 << 60) - 1, 1]], np.int64)
    assert score(matrix, [0]).miou == Fraction((1 << 60) - 1, 1 << 60)


def test_a_mean_is_of_the_defined_values_and_none_where_there_is_none() -> None:
    assert mean([Fraction(1, 3), None, Fraction(1)]) == Fraction(2, 3)
    assert mean([None]) is None
    assert mean([]) is None


def test_an_undefined_figure_is_none_as_a_decimal_too_and_never_zero() -> None:
    assert decimal(None) is None
    assert decimal(Fraction(1, 3)) == 1 / 3
