"""Who may work on an evaluation: claims, leases and fences, each one conditional UPDATE."""

from __future__ import annotations

import threading
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from datetime import datetime, timedelta
from typing import Any
from uuid import UUID

from sqlalchemy import and_, case, or_, update
from sqlalchemy.orm import Session

from app.database import Database
from app.submissions.lifecycle import MAX_FRUITLESS, Stage, State, may_move
from app.submissions.models import Evaluation, Submission, SubmissionEvent
from app.wiring import Wired


class LostClaim(Exception):
    """The lease ran out and another worker has claimed the evaluation."""


@dataclass(frozen=True)
class Claim:
    """The right to write to an evaluation, as long as its attempt is the newest."""

    evaluation_id: UUID
    attempt: int


def claim(db: Database, evaluation_id: UUID, *, worker: str, now: datetime, lease: timedelta) -> Claim | None:
    """Take an evaluation that waits or whose worker fell silent; None when there is nothing to do."""
    free = or_(
        Evaluation.state == Stage.QUEUED,
        and_(Evaluation.state == Stage.RUNNING, Evaluation.lease_until < now),
    )
    with db.begin() as session:
        attempt = session.scalar(
            update(Evaluation)
            .where(Evaluation.id == evaluation_id, free, Evaluation.fruitless < MAX_FRUITLESS)
            .values(
                state=Stage.RUNNING,
                attempts=Evaluation.attempts + 1,
                fruitless=Evaluation.fruitless + 1,
                lease_until=now + lease,
                worker=worker,
                started_at=now,
            )
            .returning(Evaluation.attempts)
        )
        if attempt is None:
            return None
        follow(session, evaluation_id, State.RUNNING, now=now, reason=f"claimed, attempt {attempt}")
    return Claim(evaluation_id, attempt)


def write(session: Session, held: Claim, **values: Any) -> None:  # noqa: ANN401 columns
    """Change an evaluation under its claim.

    Raises:
        LostClaim: a newer attempt exists; nothing was written.
    """
    mine = update(Evaluation).where(
        Evaluation.id == held.evaluation_id,
        Evaluation.attempts == held.attempt,
        Evaluation.state == Stage.RUNNING,
    )
    if session.scalar(mine.values(**values).returning(Evaluation.id)) is None:
        raise LostClaim


def release(db: Database, held: Claim, *, now: datetime, reason: str, counts: bool) -> None:
    """Give a claim back so that the evaluation waits again; without `counts` as if it had not been tried.

    Raises:
        LostClaim: it was somebody else's already.
    """
    with db.begin() as session:
        tried = case((Evaluation.fruitless > 0, Evaluation.fruitless - 1), else_=0)  # a stored chunk made it 0
        fruitless = Evaluation.fruitless if counts else tried
        write(session, held, state=Stage.QUEUED, lease_until=None, fruitless=fruitless, sent_at=None, error=reason)
        public = reason.splitlines()[0].partition(":")[0]  # what follows may name our folders and hosts
        follow(session, held.evaluation_id, State.QUEUED, now=now, reason=public)


def follow(session: Session, evaluation_id: UUID, state: State, *, now: datetime, reason: str) -> None:
    """Let the submission's state follow its first evaluation, with an event; a later one changes nothing."""
    evaluation = session.get_one(Evaluation, evaluation_id)
    if evaluation.first:
        submission = session.get_one(Submission, evaluation.submission_id, with_for_update=True)
        move(session, submission, state, now=now, reason=reason)


def move(  # noqa: PLR0913 who, when and why belong to every move
    session: Session, submission: Submission, state: State, *, now: datetime, reason: str, actor: UUID | None = None
) -> None:
    """Set a submission's state and write the event that says so; a state may be entered again.

    Raises:
        ValueError: the table of moves does not have it.
    """
    if submission.state != state and not may_move(submission.state, state):
        raise ValueError(f"a submission cannot go from {submission.state} to {state}")
    session.add(
        SubmissionEvent(
            submission_id=submission.id,
            at=now,
            actor_id=actor,
            before=submission.state,
            after=state,
            reason=reason[:500],
        )
    )
    submission.state = state


@contextmanager
def heartbeat(wired: Wired, held: Claim) -> Iterator[threading.Event]:
    """Renew the lease in a thread; the event is set once the claim is lost."""
    lost, over = threading.Event(), threading.Event()
    lease = timedelta(seconds=wired.settings.lease_seconds)

    def beat() -> None:
        while not over.wait(wired.settings.heartbeat_seconds):
            try:
                with wired.db.begin() as session:
                    write(session, held, lease_until=wired.now() + lease)
            except LostClaim:
                lost.set()
                return

    thread = threading.Thread(target=beat, name="heartbeat", daemon=True)
    thread.start()
    try:
        yield lost
    finally:
        over.set()
        thread.join()
