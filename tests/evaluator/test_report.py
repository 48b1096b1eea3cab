"""What became of a submission reads the same as JSON and in a terminal: full precision here, percent there."""

from __future__ import annotations

import json
from collections.abc import Sequence

import numpy as np
import pytest
from numpy.typing import NDArray

from evaluator import SCORING_VERSION, __version__
from evaluator.benchmark import Benchmark
from evaluator.errors import HINTS, Code, Problem
from evaluator.evaluate import Outcome
from evaluator.report import listing, refusal, results, table

TRUNK, STRUCTURE, WATER, OTHER_TERRAIN, DIRT, SKY, VOID = 13, 11, 14, 8, 1, 10, 15
DASH = {"iou": None, "precision": None, "recall": None, "f1": None}


@pytest.fixture
def worked() -> NDArray[np.int64]:
    """The example of the protocol."""
    matrix = np.zeros((15, 16), np.int64)
    matrix[TRUNK, [TRUNK, SKY, VOID]] = 80, 10, 10
    matrix[STRUCTURE, SKY] = 50
    matrix[WATER, WATER] = 20
    matrix[OTHER_TERRAIN, DIRT] = 10
    return matrix


def test_the_worked_example_as_json_is_whole_and_in_order(worked: NDArray[np.int64], wildscenes: Benchmark) -> None:
    track = wildscenes.track("3d-standard")
    said = results(worked, track, wildscenes, digest="abc", frames=7)
    classes: dict[str, object] = {wildscenes.names[i]: DASH for i in track.scored}
    classes["tree-trunk"] = {"iou": 0.8, "precision": 1.0, "recall": 0.8, "f1": 8 / 9}
    classes["structure"] = {"iou": 0.0, "precision": None, "recall": 0.0, "f1": 0.0}
    expected = {
        "benchmark": "wildscenes",
        "track": "3d-standard",
        "evaluator": __version__,
        "scoring": SCORING_VERSION,
        "groundtruth": "abc",
        "frames": 7,
        "miou": 0.4,
        "miou_13": 0.2,
        "accuracy": 80 / 150,
        "mean_accuracy": 0.4,
        "fw_iou": 8 / 15,
        "classes": classes,
        "confusion": worked.tolist(),
    }
    assert json.dumps(said) == json.dumps(expected)


def test_a_2d_track_has_no_official_mean(worked: NDArray[np.int64], wildscenes: Benchmark) -> None:
    said = results(worked, wildscenes.track("2d-standard"), wildscenes, digest="abc", frames=7)
    assert list(said) == [
        *("benchmark", "track", "evaluator", "scoring", "groundtruth", "frames", "miou", "accuracy"),
        *("mean_accuracy", "fw_iou", "classes", "confusion"),
    ]
    assert list(said["classes"]) == list(wildscenes.names)


@pytest.mark.parametrize(("track_id", "dirt", "mean"), [("3d-standard", 0.0, 0.5), ("3d-val", None, 0.75)])
def test_a_class_without_ground_truth_is_zero_when_ranked_and_a_dash_in_practice(
    wildscenes: Benchmark, track_id: str, dirt: float | None, mean: float
) -> None:
    matrix = np.zeros((15, 16), np.int64)
    matrix[TRUNK, [TRUNK, DIRT]] = 80
    matrix[STRUCTURE, STRUCTURE] = 20
    said = results(matrix, wildscenes.track(track_id), wildscenes, digest="", frames=1)
    assert (said["classes"]["dirt"]["iou"], said["miou"], said["miou_13"]) == (dirt, mean, mean)


def test_the_table_shows_percent_with_dashes(forest: Benchmark) -> None:
    matrix = np.array([[2, 0, 0, 1], [0, 0, 0, 0], [0, 0, 0, 1]], np.int64)
    said = results(matrix, forest.track("scan-whole"), forest, digest="", frames=1)
    assert table(said).splitlines() == [
        "class                   IoU  precision     recall         F1",
        "leaf                  66.67     100.00      66.67      80.00",
        "soil                      -          -          -          -",
        "",
        "miou                  66.67",
        "miou_all              33.33",
        "accuracy              66.67",
        "mean_accuracy         66.67",
        "fw_iou                66.67",
    ]


def outcome(problems: Sequence[Problem] = (), warnings: Sequence[Problem] = ()) -> Outcome:
    return Outcome((), np.zeros((0, 3, 4), np.int64), tuple(problems), tuple(warnings))


def test_a_valid_outcome_says_so() -> None:
    assert refusal(outcome()) == {
        "valid": True,
        "problems": [],
        "problems_total": 0,
        "warnings": [],
        "warnings_total": 0,
    }


def test_a_refusal_lists_a_hundred_of_each_and_counts_all() -> None:
    wrong = [Problem(Code.MISSING_FRAME, f"{i}.png") for i in range(150)]
    odd = [Problem(Code.UNKNOWN_MEMBER, f"{i}.txt") for i in range(101)]
    said = refusal(outcome(wrong, odd))
    assert list(said) == ["valid", "problems", "problems_total", "warnings", "warnings_total"]
    assert (said["valid"], said["problems_total"], said["warnings_total"]) == (False, 150, 101)
    assert said["problems"] == [one.as_json() for one in wrong[:100]]
    assert said["warnings"] == [one.as_warning() for one in odd[:100]]


def test_warnings_alone_do_not_refuse() -> None:
    assert refusal(outcome(warnings=[Problem(Code.UNKNOWN_MEMBER, "README")]))["valid"]


def test_a_listing_ends_with_how_many_are_left() -> None:
    wrong = [Problem(Code.ENCRYPTED_MEMBER, f"{i}.png") for i in range(103)]
    hint = HINTS[Code.ENCRYPTED_MEMBER]
    lines = listing(wrong).splitlines()
    assert lines == [*(f"{i}.png: encrypted_member. {hint}" for i in range(100)), "... and 3 more"]
    assert listing(wrong[:2]).splitlines() == lines[:2]
    assert listing(wrong[:1], total=9).splitlines() == [lines[0], "... and 8 more"]
