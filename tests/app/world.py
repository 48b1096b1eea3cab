"""A service with people and submissions in it, as the tests of the service build one."""

from __future__ import annotations

import hashlib
import threading
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any, TypeVar
from uuid import UUID

from sqlalchemy import select

from app.accounts.models import Role, Scope
from app.accounts.service import Identity, create_person, create_token, identify_token
from app.submissions import evaluation, service
from app.submissions.lifecycle import Visibility
from app.submissions.models import Evaluation, Score, Submission, SubmissionEvent
from app.submissions.service import Begun, Entry
from app.wiring import Wired
from evaluator.benchmark import load
from evaluator.demo import write_predictions
from evaluator.groundtruth import GroundTruth

T = TypeVar("T")
NOON = datetime(2026, 3, 1, 12, tzinfo=UTC)


@dataclass
class Clock:
    """The one thing that tests pretend: what time it is."""

    at: datetime = NOON

    def __call__(self) -> datetime:
        return self.at

    def advance(self, seconds: float) -> None:
        self.at += timedelta(seconds=seconds)


@dataclass
class Predictions:
    """Zips for the tracks of a release, made once each."""

    release: Path
    folder: Path
    _made: dict[tuple[str, float], bytes] = field(default_factory=dict)

    def __call__(self, track_id: str, quality: float = 0.8) -> bytes:
        """A submission to a track; 1 is perfect."""
        if (track_id, quality) not in self._made:
            benchmark = load()
            track, truth = benchmark.track(track_id), GroundTruth(self.release, benchmark)
            labelled = ((f.sequence, f.name, truth.labels(track, f).reshape(f.shape)) for f in truth.frames(track))
            path = self.folder / f"{track_id}-{quality}.zip"
            write_predictions(labelled, path, kind=track.modality.kind, quality=quality, seed=0, k=benchmark.k)
            self._made[track_id, quality] = path.read_bytes()
        return self._made[track_id, quality]


@dataclass
class World:
    """A wired service, its clock, and shorthands for what people do with it."""

    wired: Wired
    clock: Clock
    predictions: Predictions

    def token(self, email: str = "ada@example.org", *, role: Role = Role.MEMBER, scope: Scope = Scope.SUBMIT) -> str:
        """A token of a new person."""
        create_person(self.wired.db, email=email, role=role, now=self.clock())
        return create_token(self.wired.db, email=email, scope=scope, now=self.clock())

    def person(self, email: str = "ada@example.org", *, role: Role = Role.MEMBER) -> Identity:
        """A new person, known by a token."""
        return identify_token(self.wired.db, self.token(email, role=role))

    def begin(
        self, who: Identity, *, track: str = "2d-standard", method: str = "Forest", public: bool = False
    ) -> Begun:
        """A row whose bytes come next."""
        visibility = Visibility.PUBLIC if public else Visibility.PRIVATE
        return service.begin(self.wired, Entry(track, method, visibility=visibility), who=who)

    def arrive(self, begun: Begun, data: bytes) -> None:
        """The bytes of a submission that was begun."""
        writer = self.wired.storage.create(begun.upload_key)
        writer.write(data)
        writer.commit()
        digest = hashlib.sha256(data).hexdigest()
        service.received(self.wired, begun.id, key=begun.upload_key, sha256=digest, size=len(data))

    def submit(
        self,
        who: Identity,
        *,
        track: str = "2d-standard",
        method: str = "Forest",
        quality: float = 0.8,
        public: bool = False,
        data: bytes | None = None,
    ) -> UUID:
        """A submission that waits."""
        begun = self.begin(who, track=track, method=method, public=public)
        self.arrive(begun, data or self.predictions(track, quality))
        return begun.id

    def scored(self, who: Identity, **how: Any) -> UUID:
        """A submission that a worker has dealt with."""
        submission_id = self.submit(who, **how)
        evaluation.run(self.wired, self.evaluation(submission_id).id)
        return submission_id

    def submission(self, submission_id: UUID) -> Submission:
        """Its row."""
        with self.wired.db.read() as session:
            return session.get_one(Submission, submission_id)

    def evaluation(self, submission_id: UUID) -> Evaluation:
        """The row of its first evaluation."""
        with self.wired.db.read() as session:
            mine = select(Evaluation).where(Evaluation.submission_id == submission_id, Evaluation.first)
            return session.scalars(mine).one()

    def results(self, submission_id: UUID) -> dict[str, Any]:
        """Every figure of it, as kept."""
        evaluation_id = self.evaluation(submission_id).id
        with self.wired.db.read() as session:
            return session.get_one(Score, evaluation_id).results

    def events(self, submission_id: UUID) -> list[tuple[str, str, str]]:
        """Its moves: from, to, and why."""
        with self.wired.db.read() as session:
            mine = select(SubmissionEvent).where(SubmissionEvent.submission_id == submission_id)
            return [(str(e.before), str(e.after), e.reason) for e in session.scalars(mine.order_by(SubmissionEvent.id))]


def at_once(acts: Sequence[Callable[[], T]]) -> list[T | Exception]:
    """Run functions in as many threads, all let go together; what each gave or raised, in their order."""
    gate = threading.Barrier(len(acts))
    got: list[T | Exception] = [RuntimeError("did not end")] * len(acts)

    def run(position: int) -> None:
        gate.wait(30)
        try:
            got[position] = acts[position]()
        except Exception as error:  # noqa: BLE001 the test looks at it
            got[position] = error

    threads = [threading.Thread(target=run, args=(position,)) for position in range(len(acts))]
    for one in threads:
        one.start()
    for one in threads:
        one.join(60)
    return got
