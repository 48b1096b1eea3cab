"""Tables of submissions, their evaluations, and everything that these leave behind."""

from __future__ import annotations

from datetime import datetime
from typing import Any
from uuid import UUID, uuid4

from sqlalchemy import JSON, BigInteger, ForeignKey, Index, Integer, LargeBinary, String, Text, UniqueConstraint
from sqlalchemy.orm import Mapped, mapped_column, relationship

from app.accounts.models import Team, one_of
from app.database import Base, UtcDateTime
from app.methods.models import Method
from app.submissions.lifecycle import Stage, State, Visibility

_SERIAL = BigInteger().with_variant(Integer, "sqlite")  # SQLite numbers rows by itself only as INTEGER


class Submission(Base):
    """A zip that somebody sent for a track."""

    __tablename__ = "submissions"
    __table_args__ = (Index("ix_submissions_track_state", "track", "state"),)

    id: Mapped[UUID] = mapped_column(primary_key=True, default=uuid4)
    benchmark: Mapped[str] = mapped_column(String(100))
    track: Mapped[str] = mapped_column(String(100))
    team_id: Mapped[UUID] = mapped_column(ForeignKey("teams.id"), index=True)
    uploader_id: Mapped[UUID] = mapped_column(ForeignKey("people.id"))
    method_id: Mapped[UUID] = mapped_column(ForeignKey("methods.id"), index=True)
    encoding: Mapped[str] = mapped_column(String(100))
    state: Mapped[State] = mapped_column(one_of(State))
    visibility: Mapped[Visibility] = mapped_column(one_of(Visibility))
    hidden: Mapped[bool] = mapped_column(default=False)
    sha256: Mapped[str | None] = mapped_column(String(64))
    size: Mapped[int | None] = mapped_column(BigInteger)
    upload_key: Mapped[str | None] = mapped_column(String(100))
    created_at: Mapped[datetime] = mapped_column(UtcDateTime)
    deadline: Mapped[datetime | None] = mapped_column(UtcDateTime)
    published_at: Mapped[datetime | None] = mapped_column(UtcDateTime)
    team: Mapped[Team] = relationship()
    method: Mapped[Method] = relationship()


class SubmissionEvent(Base):
    """One move of a submission: when, by whom, from where to where, and why."""

    __tablename__ = "submission_events"

    id: Mapped[int] = mapped_column(_SERIAL, primary_key=True)
    submission_id: Mapped[UUID] = mapped_column(ForeignKey("submissions.id"), index=True)
    at: Mapped[datetime] = mapped_column(UtcDateTime)
    actor_id: Mapped[UUID | None] = mapped_column(ForeignKey("people.id"))
    before: Mapped[State | None] = mapped_column(one_of(State))
    after: Mapped[State] = mapped_column(one_of(State))
    reason: Mapped[str] = mapped_column(String(500))


class Evaluation(Base):
    """The scoring of a submission by one scoring version against one ground truth.

    `attempts` counts claims and is the fence: whoever holds an older number may write nothing.
    """

    __tablename__ = "evaluations"
    __table_args__ = (
        UniqueConstraint("submission_id", "scoring", "groundtruth"),
        Index("ix_evaluations_state_sent_at", "state", "sent_at"),
    )

    id: Mapped[UUID] = mapped_column(primary_key=True, default=uuid4)
    submission_id: Mapped[UUID] = mapped_column(ForeignKey("submissions.id"))
    scoring: Mapped[int]
    groundtruth: Mapped[str] = mapped_column(String(64))
    evaluator: Mapped[str] = mapped_column(String(50))
    first: Mapped[bool]
    state: Mapped[Stage] = mapped_column(one_of(Stage))
    attempts: Mapped[int] = mapped_column(default=0)
    fruitless: Mapped[int] = mapped_column(default=0)
    lease_until: Mapped[datetime | None] = mapped_column(UtcDateTime)
    worker: Mapped[str | None] = mapped_column(String(200))
    sent_at: Mapped[datetime | None] = mapped_column(UtcDateTime)
    frames_total: Mapped[int] = mapped_column(default=0)
    frames_done: Mapped[int] = mapped_column(default=0)
    created_at: Mapped[datetime] = mapped_column(UtcDateTime)
    started_at: Mapped[datetime | None] = mapped_column(UtcDateTime)
    finished_at: Mapped[datetime | None] = mapped_column(UtcDateTime)
    problems: Mapped[list[dict[str, Any]]] = mapped_column(JSON, default=list)
    problems_total: Mapped[int] = mapped_column(default=0)
    warnings: Mapped[list[dict[str, Any]]] = mapped_column(JSON, default=list)
    warnings_total: Mapped[int] = mapped_column(default=0)
    error: Mapped[str | None] = mapped_column(Text)
    submission: Mapped[Submission] = relationship()


class Chunk(Base):
    """Some frames in a row of an evaluation, counted for good: matrices is int64, (N, K, K + 1), zlib-compressed."""

    __tablename__ = "chunks"

    evaluation_id: Mapped[UUID] = mapped_column(ForeignKey("evaluations.id"), primary_key=True)
    start: Mapped[int] = mapped_column(primary_key=True)
    length: Mapped[int]
    frames: Mapped[list[str]] = mapped_column(JSON)
    matrices: Mapped[bytes] = mapped_column(LargeBinary)
    seen: Mapped[list[int]] = mapped_column(JSON)
    problems: Mapped[list[dict[str, Any]]] = mapped_column(JSON)


class Score(Base):
    """The figures of a finished evaluation, fractions in [0, 1] at full precision; None where undefined."""

    __tablename__ = "scores"

    evaluation_id: Mapped[UUID] = mapped_column(ForeignKey("evaluations.id"), primary_key=True)
    miou: Mapped[float | None]
    results: Mapped[dict[str, Any]] = mapped_column(JSON)
    evaluation: Mapped[Evaluation] = relationship()
