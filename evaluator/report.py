"""What became of a submission, as JSON and as a table for a terminal."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from evaluator import SCORING_VERSION, __version__
from evaluator.benchmark import Benchmark, Track
from evaluator.errors import Problem
from evaluator.evaluate import LISTED, Outcome
from evaluator.metrics import ClassScore, decimal, mean, score


def results(
    confusion: NDArray[np.int64], track: Track, benchmark: Benchmark, *, digest: str, frames: int
) -> dict[str, Any]:
    """Every figure of a track at full precision, as JSON.

    Args:
        confusion: the sum over the track's frames, shape (K, K + 1).
        track: whose classes are scored.
        benchmark: that names them.
        digest: of the ground truth.
        frames: how many were summed.
    """
    dash = not track.protocol.ranked
    scores = score(confusion, track.scored, dash_absent=dash)
    said: dict[str, Any] = {
        "benchmark": benchmark.id,
        "track": track.id,
        "evaluator": __version__,
        "scoring": SCORING_VERSION,
        "groundtruth": digest,
        "frames": frames,
        "miou": decimal(scores.miou),
    }
    if track.modality.official_mean:
        wider = score(confusion, track.official, dash_absent=dash)
        said[track.modality.official_mean.name] = decimal(mean(one.iou for one in wider.classes.values()))
    said |= {
        "accuracy": decimal(scores.accuracy),
        "mean_accuracy": decimal(scores.mean_accuracy),
        "fw_iou": decimal(scores.fw_iou),
        "classes": {benchmark.names[index]: _class_json(one) for index, one in scores.classes.items()},
        "confusion": confusion.tolist(),
    }
    return said


def refusal(outcome: Outcome) -> dict[str, Any]:
    """What is wrong with a submission, and what is odd, as JSON: 100 of each listed, all counted."""
    return {
        "valid": outcome.valid,
        "problems": [one.as_json() for one in outcome.problems[:LISTED]],
        "problems_total": len(outcome.problems),
        "warnings": [one.as_warning() for one in outcome.warnings[:LISTED]],
        "warnings_total": len(outcome.warnings),
    }


def table(said: dict[str, Any]) -> str:
    """The results as a table in percent, for a terminal."""
    means = [key for key in said if key.startswith(("miou", "accuracy", "mean_", "fw_"))]
    rows = [("class", "IoU", "precision", "recall", "F1")]
    rows += [
        (name, *(_percent(one[key]) for key in ("iou", "precision", "recall", "f1")))
        for name, one in said["classes"].items()
    ]
    lines = [f"{row[0]:<16}" + "".join(f"{cell:>11}" for cell in row[1:]) for row in rows]
    lines += ["", *(f"{key:<16}{_percent(said[key]):>11}" for key in means)]
    return "\n".join(lines)


def listing(problems: Sequence[Problem], total: int | None = None) -> str:
    """Problems or warnings, one a line, the first hundred."""
    lines = [str(one) for one in problems[:LISTED]]
    left = (len(problems) if total is None else total) - len(lines)
    return "\n".join([*lines, *([f"... and {left} more"] if left > 0 else [])])


def _class_json(one: ClassScore) -> dict[str, float | None]:
    return {
        "iou": decimal(one.iou),
        "precision": decimal(one.precision),
        "recall": decimal(one.recall),
        "f1": decimal(one.f1),
    }


def _percent(value: float | None) -> str:
    return "-" if value is None else f"{100 * value:.2f}"
