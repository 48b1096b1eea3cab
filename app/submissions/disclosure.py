"""Which figures of a release may be shown, how precise, and to whom: the one place that decides it."""

from __future__ import annotations

from dataclasses import dataclass
from decimal import ROUND_HALF_EVEN, Decimal
from typing import Any

from evaluator.benchmark import Track
from evaluator.frames import Facts

MIOU_DIGITS, CLASS_DIGITS = 4, 3
"""Digits of a fraction on a hidden release: mIoU in percent with two decimals, class figures with one."""


def rounded(value: float | None, digits: int) -> float | None:
    """Half-even rounding of a fraction to so many decimals; undefined stays undefined."""
    if value is None:
        return None
    return float(Decimal(repr(value)).quantize(Decimal(1).scaleb(-digits), ROUND_HALF_EVEN))


@dataclass(frozen=True)
class Shown:
    """The figures that somebody may see, fractions in [0, 1]; None where undefined."""

    miou: float | None
    official: float | None
    classes: dict[str, float | None]
    means: dict[str, float | None]


def seen_in_full(track: Track, facts: Facts | None) -> bool:
    """Whether everything of a track may be shown to everybody: practice, and releases whose labels are open."""
    return not track.protocol.ranked or (facts is not None and facts.open)


def disclose(results: dict[str, Any], *, official: str | None, in_full: bool) -> Shown:
    """What of an evaluation's results may be shown.

    Args:
        results: every figure, as `evaluator.report.results` gives it.
        official: the name of the official script's mean; None where the modality has none.
        in_full: whether everything may be seen: practice tracks, open releases, maintainers.
    """

    def shown(value: float | None, digits: int) -> float | None:
        return value if in_full else rounded(value, digits)

    return Shown(
        miou=shown(results["miou"], MIOU_DIGITS),
        official=shown(results.get(official), MIOU_DIGITS) if official else None,
        classes={name: shown(one["iou"], CLASS_DIGITS) for name, one in results["classes"].items()},
        means={name: shown(results[name], CLASS_DIGITS) for name in ("accuracy", "mean_accuracy", "fw_iou")},
    )


def percent(value: float | None, digits: int) -> str:
    """A fraction as percent with so many decimals, half-even; a dash where it is undefined."""
    shown = rounded(value, digits + 2)
    return "\N{EM DASH}" if shown is None else f"{Decimal(repr(shown)) * 100:.{digits}f}"
