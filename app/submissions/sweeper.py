"""What repeats until it succeeds: lost work is sent again, and what cannot succeed is ended."""

from __future__ import annotations

from datetime import timedelta

from sqlalchemy import and_, or_, select, update

from app.submissions.claims import follow, move
from app.submissions.lifecycle import MAX_FRUITLESS, Stage, State
from app.submissions.models import Evaluation, Submission
from app.wiring import Wired

BATCH = 100


def sweep(wired: Wired) -> int:
    """One round; several sweepers at once do no harm. Returns how many evaluations wait unclaimed for too long."""
    _fail_hopeless(wired)
    _give_up_uploads(wired)
    return _resend(wired)


def _resend(wired: Wired) -> int:
    """Send what waits, or whose worker fell silent, once every `resend_seconds`, for ever."""
    now = wired.now()
    stale = now - timedelta(seconds=wired.settings.resend_seconds)
    silent = and_(Evaluation.state == Stage.RUNNING, Evaluation.lease_until < now)
    waiting = or_(Evaluation.state == Stage.QUEUED, silent)
    due = and_(waiting, or_(Evaluation.sent_at.is_(None), Evaluation.sent_at < stale))
    with wired.db.read() as session:
        candidates = session.scalars(
            select(Evaluation.id).where(due).order_by(Evaluation.created_at).limit(BATCH)
        ).all()
        deaf = now - timedelta(seconds=wired.settings.deaf_seconds)
        overdue = session.scalars(select(Evaluation.id).where(waiting, Evaluation.created_at < deaf).limit(BATCH)).all()
    for evaluation_id in candidates:
        with wired.db.begin() as session:
            mine = update(Evaluation).where(Evaluation.id == evaluation_id, due).values(sent_at=now)
            taken = session.scalar(mine.returning(Evaluation.id))
        if taken is not None and not wired.queue.send(taken):
            break  # the broker is away: the next rounds go on from here
    return len(overdue)


def _fail_hopeless(wired: Wired) -> None:
    now = wired.now()
    hopeless = and_(
        Evaluation.fruitless >= MAX_FRUITLESS,
        or_(Evaluation.state == Stage.QUEUED, and_(Evaluation.state == Stage.RUNNING, Evaluation.lease_until < now)),
    )
    with wired.db.begin() as session:
        for evaluation_id in session.scalars(
            update(Evaluation)
            .where(hopeless)
            .values(state=Stage.FAILED, finished_at=now, lease_until=None)
            .returning(Evaluation.id)
        ).all():
            reason = f"{MAX_FRUITLESS} attempts in a row stored nothing"
            follow(session, evaluation_id, State.FAILED, now=now, reason=reason)


def _give_up_uploads(wired: Wired) -> None:
    """Uploads whose server was killed: nothing was counted, and their sender may send again."""
    now = wired.now()
    with wired.db.begin() as session:
        silent = session.scalars(
            select(Submission)
            .where(Submission.state == State.RECEIVING, Submission.deadline < now)
            .with_for_update(skip_locked=True)
        ).all()
        for submission in silent:
            submission.deadline = None
            move(session, submission, State.CANCELLED, now=now, reason="the upload fell silent")
