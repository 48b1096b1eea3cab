"""Which figures may be shown, and how precise."""

from __future__ import annotations

from fractions import Fraction
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from app.submissions.disclosure import CLASS_DIGITS, MIOU_DIGITS, Shown, disclose, percent, rounded

RESULTS: dict[str, Any] = {
    "miou": 0.51234567,
    "miou_13": 0.41234567,
    "accuracy": 0.87654321,
    "mean_accuracy": 0.6543210,
    "fw_iou": 0.7654321,
    "frames": 2133,
    "classes": {
        "bush": {"iou": 0.123456, "precision": 0.987654, "recall": 0.876543, "f1": 0.765432},
        "mud": {"iou": None, "precision": None, "recall": None, "f1": None},
    },
    "confusion": [[31415, 9265], [3589, 793]],
}


@pytest.mark.parametrize(
    ("value", "digits", "expected"),
    [
        (0.12345, 4, 0.1234),
        (0.12355, 4, 0.1236),
        (0.00005, 4, 0.0),
        (0.00015, 4, 0.0002),
        (0.99995, 4, 1.0),
        (0.0625, 3, 0.062),
        (0.0635, 3, 0.064),
        (0.1234500001, 4, 0.1235),
        (1.0, 4, 1.0),
        (0.0, 4, 0.0),
        (None, 4, None),
    ],
)
def test_figures_round_half_to_even_and_undefined_stays_undefined(
    value: float | None, digits: int, expected: float | None
) -> None:
    assert rounded(value, digits) == expected


@given(st.floats(0, 1), st.sampled_from([CLASS_DIGITS, MIOU_DIGITS]))
def test_rounding_moves_a_figure_by_half_a_digit_at_most_and_once_only(value: float, digits: int) -> None:
    once = rounded(value, digits)
    assert once is not None
    assert abs(Fraction(repr(once)) - Fraction(repr(value))) <= Fraction(1, 2 * 10**digits)
    assert rounded(once, digits) == once
    assert percent(once, digits - 2) == percent(value, digits - 2)


@pytest.mark.parametrize(
    ("value", "digits", "expected"),
    [
        (0.12345, 2, "12.34"),
        (0.12355, 2, "12.36"),
        (0.4, 2, "40.00"),
        (1.0, 1, "100.0"),
        (0.0, 2, "0.00"),
        (0.00004, 2, "0.00"),
        (0.0625, 1, "6.2"),
        (None, 2, "\N{EM DASH}"),
    ],
)
def test_a_fraction_reads_as_percent_and_an_undefined_one_as_a_dash(
    value: float | None, digits: int, expected: str
) -> None:
    assert percent(value, digits) == expected


def test_of_a_hidden_release_rounded_figures_are_shown_and_nothing_else() -> None:
    assert disclose(RESULTS, official="miou_13", in_full=False) == Shown(
        miou=0.5123,
        official=0.4123,
        classes={"bush": 0.123, "mud": None},
        means={"accuracy": 0.877, "mean_accuracy": 0.654, "fw_iou": 0.765},
    )


def test_in_full_the_same_figures_are_shown_at_full_precision() -> None:
    assert disclose(RESULTS, official="miou_13", in_full=True) == Shown(
        miou=0.51234567,
        official=0.41234567,
        classes={"bush": 0.123456, "mud": None},
        means={"accuracy": 0.87654321, "mean_accuracy": 0.654321, "fw_iou": 0.7654321},
    )


def test_a_modality_without_an_official_mean_has_none() -> None:
    assert disclose(RESULTS, official=None, in_full=True).official is None
