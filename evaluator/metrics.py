"""Counts to IoU and its relatives, exactly: fractions of integers until somebody asks for a decimal."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from fractions import Fraction

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True)
class ClassScore:
    """The figures of one class; None where a figure is 0/0."""

    iou: Fraction | None
    precision: Fraction | None
    recall: Fraction | None
    f1: Fraction | None


UNDEFINED = ClassScore(None, None, None, None)


@dataclass(frozen=True)
class Scores:
    """The figures of one track, over its scored classes in canonical order."""

    miou: Fraction | None
    accuracy: Fraction | None
    mean_accuracy: Fraction | None
    fw_iou: Fraction | None
    classes: dict[int, ClassScore]


def restrict(confusion: NDArray[np.int64], scored: Sequence[int]) -> NDArray[np.int64]:
    """Drop the rows of classes that are not scored, and add their columns to void.

    Args:
        confusion: counts, shape (K, K + 1); rows are true classes, the last column is void.
        scored: canonical indices of the S scored classes, ascending.

    Returns:
        Shape (S, S + 1).
    """
    kept = list(scored)
    rows = confusion[kept]
    void = rows.sum(axis=1) - rows[:, kept].sum(axis=1)
    return np.column_stack([rows[:, kept], void])


def score(confusion: NDArray[np.int64], scored: Sequence[int], *, dash_absent: bool = False) -> Scores:
    """Every figure of a track.

    With TP the diagonal, FN the rest of a row (void included) and FP the rest of a column, over scored rows only:
    IoU = TP / (TP + FP + FN), precision = TP / (TP + FP), recall = TP / (TP + FN), F1 = 2 TP / (2 TP + FP + FN);
    mIoU and mean accuracy are means of the defined IoUs and recalls; accuracy = sum TP / all;
    fw_iou = sum of (row / all rows) x IoU.

    Args:
        confusion: counts, shape (K, K + 1); rows are true classes, the last column is void.
        scored: canonical indices of the scored classes, ascending.
        dash_absent: whether a class without ground truth is undefined even where it was predicted (practice tracks
            and breakdowns); else its IoU, precision and F1 are then 0.

    Source:
        Everingham et al., The PASCAL VOC Challenge: A Retrospective, IJCV 2015, section 4.2 (IoU);
        Long et al., Fully Convolutional Networks for Semantic Segmentation, CVPR 2015, section 5 (the means).
    """
    table = restrict(confusion, scored)
    truth = [int(n) for n in table.sum(axis=1)]
    predicted = [int(n) for n in table[:, :-1].sum(axis=0)]
    hits = [int(n) for n in table[:, :-1].diagonal()]
    classes = {
        index: UNDEFINED
        if dash_absent and not row
        else ClassScore(
            iou=_ratio(tp, row + column - tp),
            precision=_ratio(tp, column),
            recall=_ratio(tp, row),
            f1=_ratio(2 * tp, row + column),
        )
        for index, tp, row, column in zip(scored, hits, truth, predicted, strict=True)
    }
    ious = [one.iou for one in classes.values()]
    weighted = [row * iou for row, iou in zip(truth, ious, strict=True) if iou is not None]
    return Scores(
        miou=mean(ious),
        accuracy=_ratio(sum(hits), sum(truth)),
        mean_accuracy=mean(one.recall for one in classes.values()),
        fw_iou=sum(weighted, Fraction(0)) / sum(truth) if sum(truth) else None,
        classes=classes,
    )


def mean(values: Iterable[Fraction | None]) -> Fraction | None:
    """The arithmetic mean of the defined values; None where none is."""
    defined = [value for value in values if value is not None]
    return sum(defined, Fraction(0)) / len(defined) if defined else None


def decimal(value: Fraction | None) -> float | None:
    """The float nearest to an exact figure."""
    return None if value is None else float(value)


def _ratio(part: int, whole: int) -> Fraction | None:
    return Fraction(part, whole) if whole else None
