"""The use cases of submissions: receive, read, publish, and what maintainers may do."""

from __future__ import annotations

from dataclasses import dataclass
from datetime import timedelta
from uuid import UUID, uuid4

from sqlalchemy import func, or_, select, update
from sqlalchemy.orm import Session, joinedload

from app.accounts.service import Identity
from app.errors import Conflict, Invalid, NotFound
from app.methods.models import Method
from app.methods.service import checked_name, find_or_make
from app.submissions.claims import move
from app.submissions.disclosure import Shown, disclose, seen_in_full
from app.submissions.lifecycle import Stage, State, Visibility
from app.submissions.models import Evaluation, Score, Submission, SubmissionEvent
from app.tracks.service import current_facts, frames_of
from app.wiring import Wired
from evaluator import SCORING_VERSION, __version__
from evaluator.benchmark import DEFAULT_ENCODING


@dataclass(frozen=True)
class Entry:
    """What somebody says of a zip that they send; checked before a byte of it is read."""

    track: str
    method: str
    encoding: str = DEFAULT_ENCODING
    visibility: Visibility = Visibility.PRIVATE


@dataclass(frozen=True)
class Begun:
    """A submission whose bytes may come now."""

    id: UUID
    upload_key: str
    method_created: bool


@dataclass(frozen=True)
class Reading:
    """A submission with everything that a page or an answer is made of."""

    submission: Submission
    evaluation: Evaluation | None
    score: Score | None
    events: list[SubmissionEvent]
    attempt: tuple[int, int] | None
    mine: bool


def check_entry(wired: Wired, entry: Entry) -> None:
    """Refuse fields that cannot become a submission.

    Raises:
        Invalid: a field is missing, or names what this server does not have.
    """
    if entry.track not in wired.tracks:
        known = ", ".join(wired.tracks)
        what = f"there is no track {entry.track!r}" if entry.track else "the field 'track' is missing"
        raise Invalid(f"{what}; there are: {known}", code="unknown_track" if entry.track else "track_missing")
    benchmark, track = wired.tracks[entry.track]
    if entry.encoding not in benchmark.encodings:
        known = ", ".join(benchmark.encodings)
        raise Invalid(f"there is no label encoding {entry.encoding!r}; there are: {known}", code="unknown_encoding")
    if not frames_of(current_facts(wired.db, benchmark), track):
        raise Conflict(f"track {track.id} has no ground truth on this server yet", code="no_groundtruth")
    checked_name(entry.method)


def begin(wired: Wired, entry: Entry, *, who: Identity) -> Begun:
    """Make the row of a submission whose bytes come next.

    Raises:
        Invalid, Conflict: as `check_entry`.
    """
    check_entry(wired, entry)
    benchmark, _ = wired.tracks[entry.track]
    now, key = wired.now(), f"{uuid4()}.zip"
    with wired.db.begin() as session:
        method, created = find_or_make(session, team_id=who.team_id, name=entry.method, now=now)
        submission = Submission(
            benchmark=benchmark.id,
            track=entry.track,
            team_id=who.team_id,
            uploader_id=who.person_id,
            method_id=method.id,
            encoding=entry.encoding,
            state=State.RECEIVING,
            visibility=entry.visibility,
            created_at=now,
            deadline=now + timedelta(seconds=wired.settings.receiving_seconds),
            published_at=now if entry.visibility is Visibility.PUBLIC else None,
        )
        session.add(submission)
        session.flush()
        move(session, submission, State.RECEIVING, now=now, reason="upload begun", actor=who.person_id)
    return Begun(submission.id, key, created)


def still_receiving(wired: Wired, submission_id: UUID) -> None:
    """Say that bytes are still coming, so that the sweeper does not give the upload up.

    Raises:
        Conflict: it was given up already.
    """
    deadline = wired.now() + timedelta(seconds=wired.settings.receiving_seconds)
    with wired.db.begin() as session:
        here = Submission.id == submission_id, Submission.state == State.RECEIVING
        if session.scalar(update(Submission).where(*here).values(deadline=deadline).returning(Submission.id)) is None:
            raise Conflict("this upload was given up; send it again")


def received(wired: Wired, submission_id: UUID, *, key: str, sha256: str, size: int) -> None:
    """Queue a submission whose bytes are durable; the queue is told after the commit.

    Raises:
        Conflict: the upload was given up in the meantime.
    """
    now = wired.now()
    truths = {one.id: current_facts(wired.db, one) for one in wired.benchmarks.values()}
    with wired.db.begin() as session:
        submission = session.get_one(Submission, submission_id, with_for_update=True)
        if submission.state != State.RECEIVING:
            raise Conflict("this upload was given up; send it again")
        facts = truths[submission.benchmark]
        if facts is None:
            raise Conflict("this track has no ground truth on this server yet", code="no_groundtruth")
        submission.upload_key, submission.sha256, submission.size, submission.deadline = key, sha256, size, None
        move(session, submission, State.QUEUED, now=now, reason=f"{size} bytes received", actor=submission.uploader_id)
        evaluation = Evaluation(
            submission_id=submission_id,
            scoring=SCORING_VERSION,
            groundtruth=facts.groundtruth,
            evaluator=__version__,
            first=True,
            state=Stage.QUEUED,
            created_at=now,
            sent_at=now,
        )
        session.add(evaluation)
    wired.queue.send(evaluation.id)  # may fail: the sweeper sends a waiting evaluation again


def broke_off(wired: Wired, submission_id: UUID, *, reason: str) -> bool:
    """End a submission whose upload did not arrive; nothing is counted. Returns whether its bytes may be removed."""
    with wired.db.begin() as session:
        submission = session.get_one(Submission, submission_id, with_for_update=True)
        if submission.state == State.RECEIVING:
            submission.deadline = None
            move(session, submission, State.CANCELLED, now=wired.now(), reason=reason)
        return submission.upload_key is None


def read(wired: Wired, submission_id: UUID, *, who: Identity | None) -> Reading:
    """A submission, for somebody who may see it.

    Raises:
        NotFound: there is none, or it is private and somebody else's.
    """
    with wired.db.read() as session:
        submission = session.scalar(
            select(Submission)
            .where(Submission.id == submission_id)
            .options(joinedload(Submission.team), joinedload(Submission.method))
        )
        if submission is None or not _may_see(submission, who):
            raise NotFound("there is no such submission, or it is private")
        found = session.execute(
            select(Evaluation, Score)
            .outerjoin(Score)
            .where(Evaluation.submission_id == submission_id)
            .order_by(Evaluation.created_at.desc())
        ).first()
        events = session.scalars(
            select(SubmissionEvent).where(SubmissionEvent.submission_id == submission_id).order_by(SubmissionEvent.id)
        ).all()
        attempt = _attempt(session, submission)
    evaluation, score = found or (None, None)
    mine = who is not None and who.team_id == submission.team_id
    return Reading(submission, evaluation, score, list(events), attempt, mine)


def _may_see(submission: Submission, who: Identity | None) -> bool:
    if who and (who.maintains or who.team_id == submission.team_id):
        return True
    public = submission.visibility is Visibility.PUBLIC and submission.state is State.SCORED
    return public and not submission.hidden


def _attempt(session: Session, submission: Submission) -> tuple[int, int] | None:
    """Which of the method's scored submissions on the track this is, and how many there are."""
    if submission.state is not State.SCORED:
        return None
    scored = select(func.count()).where(
        Submission.method_id == submission.method_id,
        Submission.track == submission.track,
        Submission.state == State.SCORED,
    )
    until = scored.where(
        or_(
            Submission.created_at < submission.created_at,
            (Submission.created_at == submission.created_at) & (Submission.id <= submission.id),
        )
    )
    return session.scalars(until).one(), session.scalars(scored).one()


def list_of_team(wired: Wired, *, who: Identity, limit: int = 200) -> list[tuple[Submission, Score | None]]:
    """The team's submissions, newest first, each with the score of its newest evaluation."""
    with wired.db.read() as session:
        rows = session.execute(
            select(Submission, Score)
            .outerjoin(Evaluation, (Evaluation.submission_id == Submission.id) & Evaluation.first)
            .outerjoin(Score, Score.evaluation_id == Evaluation.id)
            .where(Submission.team_id == who.team_id)
            .options(joinedload(Submission.method))
            .order_by(Submission.created_at.desc())
            .limit(limit)
        ).all()
    return [(row[0], row[1]) for row in rows]


def publish(wired: Wired, submission_id: UUID, *, who: Identity) -> None:
    """Show a scored submission on its board.

    Raises:
        NotFound: the team has no such submission.
        Conflict: it is not scored.
    """
    with wired.db.begin() as session:
        submission = session.get(Submission, submission_id, with_for_update=True)
        if submission is None or submission.team_id != who.team_id:
            raise NotFound("there is no such submission, or it is private")
        if submission.state is not State.SCORED:
            raise Conflict(f"only a scored submission can be published; this one is {submission.state.value}")
        if submission.visibility is not Visibility.PUBLIC:
            submission.visibility, submission.published_at = Visibility.PUBLIC, wired.now()
            reason = "published"
            move(session, submission, State.SCORED, now=wired.now(), reason=reason, actor=who.person_id)


def newest(wired: Wired, *, state: State | None = None, limit: int = 50) -> list[tuple[Submission, str]]:
    """Submissions of everybody, newest first, each with its method's name; for maintainers."""
    with wired.db.read() as session:
        rows = select(Submission, Method.name).join(Method).order_by(Submission.created_at.desc()).limit(limit)
        if state:
            rows = rows.where(Submission.state == state)
        return [(row[0], row[1]) for row in session.execute(rows)]


def rerun(wired: Wired, submission_id: UUID) -> None:
    """Score a failed submission again, from the chunk where it stopped; for maintainers.

    Raises:
        NotFound: there is no such submission.
        Conflict: it did not fail.
    """
    now = wired.now()
    with wired.db.begin() as session:
        submission = session.get(Submission, submission_id, with_for_update=True)
        if submission is None:
            raise NotFound("there is no such submission")
        evaluation = session.scalars(
            select(Evaluation).where(Evaluation.submission_id == submission_id, Evaluation.first)
        ).one_or_none()
        if evaluation is None or submission.state is not State.FAILED:
            raise Conflict(f"only a failed submission can be run again; this one is {submission.state.value}")
        evaluation.state, evaluation.fruitless, evaluation.sent_at = Stage.QUEUED, 0, now
        move(session, submission, State.QUEUED, now=now, reason="run again by a maintainer")
    wired.queue.send(evaluation.id)


def hide(wired: Wired, submission_id: UUID, *, hidden: bool = True) -> None:
    """Take a submission off the boards, or put it back; for maintainers.

    Raises:
        NotFound: there is no such submission.
    """
    with wired.db.begin() as session:
        submission = session.get(Submission, submission_id, with_for_update=True)
        if submission is None:
            raise NotFound("there is no such submission")
        submission.hidden = hidden
        reason = "hidden by a maintainer" if hidden else "shown again by a maintainer"
        move(session, submission, submission.state, now=wired.now(), reason=reason)


def is_open(wired: Wired, submission: Submission) -> bool:
    """Whether everything of this submission's figures may be shown to everybody."""
    benchmark, track = wired.tracks[submission.track]
    return seen_in_full(track, current_facts(wired.db, benchmark))


def shown_figures(wired: Wired, reading: Reading) -> Shown | None:
    """The figures of a submission as they may be shown to everybody; None before it is scored."""
    if reading.score is None:
        return None
    mean = wired.tracks[reading.submission.track][1].modality.official_mean
    in_full = is_open(wired, reading.submission)
    return disclose(reading.score.results, official=mean.name if mean else None, in_full=in_full)
