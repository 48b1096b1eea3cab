"""The JSON of boards."""

from __future__ import annotations

from datetime import datetime
from uuid import UUID

from pydantic import BaseModel, ConfigDict

from app.leaderboards.ranking import Row
from app.leaderboards.service import Board
from app.submissions.schemas import AttemptOut
from app.wiring import Wired


class GroundTruthOut(BaseModel):
    """The release that a board is scored against; `comparable` says whether its frames are the paper's."""

    digest: str
    title: str
    visibility: str
    comparable: bool
    frames: int


class RowOut(BaseModel):
    """A line of a board; figures are fractions in [0, 1], null where undefined. In 3D also the official `miou_13`.

    `submitted_at` is a date and time (RFC 3339), or the year alone for a row of the paper.
    """

    model_config = ConfigDict(extra="allow")

    rank: int | None
    method: str
    team: str
    submission_id: UUID | None
    permalink: str | None
    submitted_at: datetime | str | None
    baseline: bool
    source: str | None
    note: str | None
    inputs: str | None
    training_data: str | None
    paper: str | None
    code: str | None
    attempt: AttemptOut | None
    miou: float | None
    classes: dict[str, float | None]


class BoardOut(BaseModel):
    """A track's leaderboard."""

    track: str
    benchmark: str
    groundtruth: GroundTruthOut | None
    rows: list[RowOut]


def board_out(wired: Wired, board: Board) -> BoardOut:
    """A board as JSON."""
    facts, mean = board.facts, board.track.modality.official_mean
    return BoardOut(
        track=board.track.id,
        benchmark=board.benchmark.id,
        groundtruth=GroundTruthOut(
            digest=facts.groundtruth,
            title=facts.title,
            visibility="open" if facts.open else "hidden",
            comparable=facts.comparable,
            frames=board.frames,
        )
        if facts
        else None,
        rows=[_row_out(wired, row, mean.name if mean else None) for row in board.rows],
    )


def permalink(wired: Wired, row: Row) -> str | None:
    """The address of a row's own page."""
    return f"{wired.settings.base_url.rstrip('/')}/submissions/{row.submission_id}" if row.submission_id else None


def _row_out(wired: Wired, row: Row, official: str | None) -> RowOut:
    return RowOut(
        rank=row.rank,
        method=row.method,
        team=row.team,
        submission_id=row.submission_id,
        permalink=permalink(wired, row),
        submitted_at=row.submitted_at or (str(row.year) if row.year else None),
        baseline=row.baseline,
        source=row.source or None,
        note=row.note or None,
        inputs=row.inputs or None,
        training_data=row.training_data or None,
        paper=row.paper or None,
        code=row.code or None,
        attempt=AttemptOut(k=row.attempt[0], n=row.attempt[1]) if row.attempt else None,
        miou=row.shown.miou,
        classes=row.shown.classes,
        **({official: row.shown.official} if official else {}),
    )
