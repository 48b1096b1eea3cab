"""Who stands where on a board: pure rules."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from datetime import datetime
from typing import Any
from uuid import UUID

from app.submissions.disclosure import MIOU_DIGITS, Shown, rounded


@dataclass(frozen=True)
class Row:
    """A line of a board: a method's published submission, or a result that the paper printed.

    Attributes:
        rank: None where the row stands beside the board without one.
        submitted_at: None for the paper's rows, which have a year.
        attempt: which of the method's scored submissions it is, of how many.
    """

    method: str
    team: str
    shown: Shown
    rank: int | None = None
    submission_id: UUID | None = None
    submitted_at: datetime | None = None
    year: int | None = None
    baseline: bool = False
    source: str = ""
    note: str = ""
    inputs: str = ""
    training_data: str = ""
    paper: str = ""
    code: str = ""
    attempt: tuple[int, int] | None = None


@dataclass(frozen=True)
class Candidate:
    """A scored submission of a track; `published_at` is None while it is private or hidden."""

    submission_id: UUID
    method_id: UUID
    method: str
    team: str
    created_at: datetime
    published_at: datetime | None
    results: dict[str, Any]
    inputs: str
    training_data: str
    paper: str
    code: str


def standing(candidates: Iterable[Candidate]) -> list[tuple[Candidate, tuple[int, int]]]:
    """The submission of each method that stands on the board, with its attempt k of n.

    It is the one published last; never silently the best.
    """
    attempts: dict[UUID, list[Candidate]] = {}
    for one in sorted(candidates, key=lambda c: (c.created_at, c.submission_id)):
        attempts.setdefault(one.method_id, []).append(one)
    chosen = []
    for mine in attempts.values():
        published = [(one.published_at, one.created_at, k) for k, one in enumerate(mine, 1) if one.published_at]
        if published:
            k = max(published)[2]
            chosen.append((mine[k - 1], (k, len(mine))))
    return chosen


def rank(rows: Sequence[Row]) -> list[Row]:
    """Order rows by mIoU as shown and number them; equal figures share a rank, the earlier one first.

    A row without mIoU comes last and has no rank.
    """

    def key(row: Row) -> tuple[float, float]:
        figure = rounded(row.shown.miou, MIOU_DIGITS)
        when = row.submitted_at.timestamp() if row.submitted_at else 0.0
        return (-1.0 if figure is None else -figure - 1, when)

    ordered = sorted(rows, key=key)
    ordered.sort(key=lambda row: row.shown.miou is None)
    ranked: list[Row] = []
    for position, row in enumerate(ordered, 1):
        figure = rounded(row.shown.miou, MIOU_DIGITS)
        above = ranked[-1] if ranked else None
        shared = above is not None and rounded(above.shown.miou, MIOU_DIGITS) == figure
        number = above.rank if above and shared else position
        ranked.append(replace(row, rank=None if figure is None else number))
    return ranked
