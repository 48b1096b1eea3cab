"""Likely mistakes are named with their fix, told from the values of a whole submission."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from evaluator.benchmark import Benchmark
from evaluator.errors import HINTS, Code, Problem
from evaluator.mistakes import explain, other_encoding

pytestmark = pytest.mark.usefixtures("either_path")


ONE_TOO_HIGH = "0 seems to be 'unlabelled' here and every index one too high: subtract 1, and write 255 where it was 0."
RAW = "These labels look like 'raw19': send them again with labels=raw19."


def seen(*values: int) -> NDArray[np.int64]:
    counts = np.zeros(256, np.int64)
    counts[list(values)] = 5
    return counts


def hint(wildscenes: Benchmark, track_id: str, encoding: str, *values: int) -> str | None:
    """The hint that a value out of range gets; nothing else of a submission's problems may change."""
    wrong = Problem(Code.VALUE_OUT_OF_RANGE, "1-2.png", "labels", "99 (5 times)")
    other = Problem(Code.WRONG_SIZE, "1-3.png")
    found = explain([wrong, other], seen(*values), wildscenes.track(track_id), encoding, wildscenes)
    assert (replace(found[0], hint=None), found[1]) == (wrong, other)
    return found[0].as_json()["hint"]


@pytest.mark.parametrize("track_id", ["2d-standard", "3d-standard"])
def test_indices_up_to_15_look_one_too_high(wildscenes: Benchmark, track_id: str) -> None:
    assert hint(wildscenes, track_id, "benchmark", *range(16), 255) == ONE_TOO_HIGH


@pytest.mark.parametrize("values", [range(19), [0, 18], [17, 255]])
def test_indices_up_to_18_in_2d_look_like_the_released_labels(wildscenes: Benchmark, values: Iterable[int]) -> None:
    assert hint(wildscenes, "2d-standard", "benchmark", *values) == RAW


def test_indices_up_to_18_in_3d_look_like_nothing_known(wildscenes: Benchmark) -> None:
    assert hint(wildscenes, "3d-standard", "benchmark", *range(19)) == HINTS[Code.VALUE_OUT_OF_RANGE]


@pytest.mark.parametrize("values", [[0, 19], [254], [0, 15, 200]])
def test_indices_of_no_encoding_get_the_general_hint(wildscenes: Benchmark, values: Iterable[int]) -> None:
    assert hint(wildscenes, "2d-standard", "benchmark", *values) == HINTS[Code.VALUE_OUT_OF_RANGE]


def test_indices_that_are_in_range_where_they_could_be_read_get_the_general_hint(wildscenes: Benchmark) -> None:
    assert hint(wildscenes, "3d-standard", "benchmark", 0, 14, 255) == HINTS[Code.VALUE_OUT_OF_RANGE]
    assert hint(wildscenes, "3d-standard", "benchmark") == HINTS[Code.VALUE_OUT_OF_RANGE]


def test_the_default_encoding_is_named_where_another_one_was_too_small(wildscenes: Benchmark) -> None:
    found = hint(wildscenes, "3d-standard", "mmdet3d13", *range(15))
    assert found == "These labels look like 'benchmark': send them again with labels=benchmark."


def test_a_problem_with_a_hint_of_its_own_keeps_it(wildscenes: Benchmark) -> None:
    own = Problem(Code.VALUE_OUT_OF_RANGE, hint="Turn the page.")
    assert explain([own], seen(15), wildscenes.track("2d-standard"), "benchmark", wildscenes) == (own,)


def warned(wildscenes: Benchmark, track_id: str, encoding: str, *values: int) -> list[dict[str, str | None]]:
    return [one.as_json() for one in other_encoding(seen(*values), wildscenes.track(track_id), encoding, wildscenes)]


def test_labels_of_the_official_3d_configuration_that_were_not_mapped_are_warned_of(wildscenes: Benchmark) -> None:
    assert warned(wildscenes, "3d-standard", "benchmark", *range(13)) == [
        {
            "member": None,
            "code": "looks_like_other_encoding",
            "expected": "benchmark",
            "found": "10 occurs, 13 never",
            "hint": "These labels look like 'mmdet3d13', in which 10 is structure and not sky. "
            "If so, send them again with labels=mmdet3d13.",
        }
    ]


@pytest.mark.parametrize(
    ("track_id", "encoding", "values"),
    [
        ("3d-standard", "benchmark", range(15)),
        ("3d-standard", "benchmark", [0, 1, 11, 12, 14]),
        ("3d-standard", "benchmark", [10, 13]),
        ("3d-standard", "mmdet3d13", range(13)),
        ("2d-standard", "benchmark", range(13)),
        ("2d-standard", "raw19", range(19)),
    ],
)
def test_labels_that_can_only_be_what_they_are_named_are_not_warned_of(
    wildscenes: Benchmark, track_id: str, encoding: str, values: Iterable[int]
) -> None:
    assert warned(wildscenes, track_id, encoding, *values) == []
