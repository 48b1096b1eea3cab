"""The scoring of one submission: claim, chunks that a retry resumes, finish."""

from __future__ import annotations

import os
import socket
import zlib
from collections.abc import Callable, Iterator, Mapping
from datetime import timedelta
from uuid import UUID

import numpy as np
from sqlalchemy import Select, select
from sqlalchemy.orm import Session

from app.submissions.claims import Claim, LostClaim, claim, follow, heartbeat, release, write
from app.submissions.lifecycle import Stage, State
from app.submissions.models import Chunk, Evaluation, Score, Submission
from app.wiring import Wired
from evaluator import __version__
from evaluator.archive import Archive
from evaluator.errors import Problem, Refused
from evaluator.evaluate import LISTED, Outcome, Task, conclude, open_archive, plan, refusal, score_parts
from evaluator.evaluate import Chunk as Counted
from evaluator.groundtruth import GroundTruth
from evaluator.matching import Matched
from evaluator.report import results


class _DrainedError(Exception):
    """The worker was asked to stop between two chunks."""


def run(wired: Wired, evaluation_id: UUID, *, draining: Callable[[], bool] = lambda: False) -> None:
    """Score an evaluation that waits; safe to call twice, and after any crash.

    Args:
        wired: the service.
        evaluation_id: which; when it does not wait there is nothing to do.
        draining: whether this worker should stop; asked between chunks.
    """
    lease = timedelta(seconds=wired.settings.lease_seconds)
    worker = f"{socket.gethostname()}:{os.getpid()}"
    held = claim(wired.db, evaluation_id, worker=worker, now=wired.now(), lease=lease)
    if held is None:
        return
    try:
        with heartbeat(wired, held) as lost:

            def stop() -> None:
                if lost.is_set():
                    raise LostClaim
                if draining():
                    raise _DrainedError

            _score(wired, held, stop)
    except LostClaim:
        return
    except _DrainedError:
        _give_back(wired, held, "the worker was stopped in an orderly way", counts=False)
    except Exception as error:
        _give_back(wired, held, f"{type(error).__name__}: {error}", counts=True)
        raise


def _give_back(wired: Wired, held: Claim, reason: str, *, counts: bool) -> None:
    try:
        release(wired.db, held, now=wired.now(), reason=reason, counts=counts)
    except LostClaim:
        return


def _score(wired: Wired, held: Claim, stop: Callable[[], None]) -> None:
    with wired.db.read() as session:
        evaluation = session.get_one(Evaluation, held.evaluation_id)
        submission = session.get_one(Submission, evaluation.submission_id)
    benchmark, track = wired.tracks[submission.track]
    task = Task(benchmark, track, submission.encoding)
    truth = GroundTruth(wired.settings.releases / evaluation.groundtruth, benchmark)
    if submission.upload_key is None:
        raise FileNotFoundError(submission.id)
    with wired.storage.local(submission.upload_key) as path:
        try:
            archive = open_archive(path, benchmark)
        except Refused as refused:
            _finish(wired, held, refusal(refused.problem, task), task)
            return
        with archive:
            matched = plan(archive, truth.frames(track), task)
            _score_chunks(wired, held, archive, matched, task, truth, stop)
    with wired.db.read() as session:
        chunks = [_restore(row, benchmark.k) for row in session.scalars(_chunks_of(held.evaluation_id))]
    _finish(wired, held, conclude(matched, chunks, task), task)


def _score_chunks(  # noqa: PLR0913 one evaluation's whole context
    wired: Wired,
    held: Claim,
    archive: Archive,
    matched: Matched,
    task: Task,
    truth: GroundTruth,
    stop: Callable[[], None],
) -> None:
    """Count the chunks that no earlier attempt has stored, and store each in its own transaction."""
    with wired.db.begin() as session:
        stored = {row.start: row.length for row in session.scalars(_chunks_of(held.evaluation_id))}
        done = sum(stored.values())
        write(session, held, frames_total=len(matched.pairs), frames_done=done, evaluator=__version__)
    missing = list(_missing(stored, len(matched.pairs), wired.settings.chunk_frames))
    parts = [matched.pairs[one.start : one.stop] for one in missing]
    counted = score_parts(archive, parts, task, truth, jobs=wired.settings.scoring_threads)
    for one, chunk in zip(missing, counted, strict=True):
        stop()
        done += len(one)
        with wired.db.begin() as session:
            write(session, held, frames_done=done, fruitless=0)
            session.add(_keep(held.evaluation_id, one.start, len(one), chunk))


def _missing(stored: Mapping[int, int], total: int, size: int) -> Iterator[range]:
    """Chunks of the frames that no stored one (start: length) has; the size may have been another one before."""
    at = 0
    for start, length in [*sorted(stored.items()), (total, 0)]:
        yield from (range(i, min(i + size, start)) for i in range(at, start, size))
        at = start + length


def _finish(wired: Wired, held: Claim, outcome: Outcome, task: Task) -> None:
    """Scores and states in one short transaction."""
    now = wired.now()
    with wired.db.begin() as session:
        write(
            session,
            held,
            state=Stage.SCORED if outcome.valid else Stage.REJECTED,
            lease_until=None,
            finished_at=now,
            error=None,
            problems=[one.as_json() for one in outcome.problems[:LISTED]],
            problems_total=len(outcome.problems),
            warnings=[one.as_warning() for one in outcome.warnings[:LISTED]],
            warnings_total=len(outcome.warnings),
        )
        if outcome.valid:
            _store_score(session, held, outcome, task)
            follow(session, held.evaluation_id, State.SCORED, now=now, reason=f"{len(outcome.frames)} frames scored")
        else:
            reason = f"{len(outcome.problems)} problems"
            follow(session, held.evaluation_id, State.REJECTED, now=now, reason=reason)


def _store_score(session: Session, held: Claim, outcome: Outcome, task: Task) -> None:
    evaluation = session.get_one(Evaluation, held.evaluation_id)
    said = results(
        outcome.confusion.sum(axis=0),
        task.track,
        task.benchmark,
        digest=evaluation.groundtruth,
        frames=len(outcome.frames),
    )
    session.add(Score(evaluation_id=held.evaluation_id, miou=said["miou"], results=said))


def _chunks_of(evaluation_id: UUID) -> Select[Chunk]:
    return select(Chunk).where(Chunk.evaluation_id == evaluation_id).order_by(Chunk.start)


def _keep(evaluation_id: UUID, start: int, length: int, chunk: Counted) -> Chunk:
    return Chunk(
        evaluation_id=evaluation_id,
        start=start,
        length=length,
        frames=list(chunk.frames),
        matrices=zlib.compress(chunk.confusion.astype("<i8").tobytes()),
        seen=chunk.seen.tolist(),
        problems=[one.as_row() for one in chunk.problems],
    )


def _restore(row: Chunk, k: int) -> Counted:
    return Counted(
        frames=tuple(row.frames),
        confusion=np.frombuffer(zlib.decompress(row.matrices), "<i8").reshape(-1, k, k + 1),
        seen=np.array(row.seen, np.int64),
        problems=tuple(Problem.from_row(one) for one in row.problems),
    )
