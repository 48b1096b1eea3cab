"""The JSON of submissions."""

from __future__ import annotations

from datetime import datetime
from uuid import UUID

from pydantic import BaseModel, ConfigDict

from app.submissions import service
from app.submissions.lifecycle import State, Visibility
from app.submissions.service import Reading
from app.wiring import Wired


class Progress(BaseModel):
    """Frames counted, of those that the archive has."""

    done: int
    total: int


class ProblemOut(BaseModel):
    """One thing that is wrong with a submission."""

    member: str | None
    code: str
    expected: str | None
    found: str | None
    hint: str | None


class WarningOut(BaseModel):
    """One thing that is odd about a submission."""

    member: str | None
    code: str
    hint: str | None


class ScoresOut(BaseModel):
    """Fractions in [0, 1], rounded to what may be shown; null where undefined. In 3D also the official `miou_13`."""

    model_config = ConfigDict(extra="allow")

    miou: float | None
    classes: dict[str, float | None]


class AttemptOut(BaseModel):
    """Which of the method's scored submissions on the track this is, of how many."""

    k: int
    n: int


class SubmissionOut(BaseModel):
    """A submission and what became of it."""

    id: UUID
    state: State
    visibility: Visibility
    track: str
    method: str
    team: str
    labels: str
    submitted_at: datetime
    sha256: str | None
    size: int | None
    progress: Progress
    problems: list[ProblemOut]
    problems_total: int
    warnings: list[WarningOut]
    scores: ScoresOut | None
    evaluator: str | None
    scoring: int | None
    groundtruth: str | None
    attempt: AttemptOut | None
    links: dict[str, str]


class SubmissionMade(SubmissionOut):
    """A submission that has just arrived; `method_created` says that its method was new."""

    method_created: bool


def submission_out(wired: Wired, reading: Reading) -> SubmissionOut:
    """A submission as JSON, its figures as they may be shown."""
    submission, evaluation = reading.submission, reading.evaluation
    root = wired.settings.base_url.rstrip("/")
    return SubmissionOut(
        id=submission.id,
        state=submission.state,
        visibility=submission.visibility,
        track=submission.track,
        method=submission.method.name,
        team=submission.team.name,
        labels=submission.encoding,
        submitted_at=submission.created_at,
        sha256=submission.sha256,
        size=submission.size,
        progress=Progress(
            done=evaluation.frames_done if evaluation else 0, total=evaluation.frames_total if evaluation else 0
        ),
        problems=[ProblemOut.model_validate(one) for one in evaluation.problems] if evaluation else [],
        problems_total=evaluation.problems_total if evaluation else 0,
        warnings=[WarningOut.model_validate(one) for one in evaluation.warnings] if evaluation else [],
        scores=_scores(wired, reading),
        evaluator=evaluation.evaluator if evaluation else None,
        scoring=evaluation.scoring if evaluation else None,
        groundtruth=evaluation.groundtruth if evaluation else None,
        attempt=AttemptOut(k=reading.attempt[0], n=reading.attempt[1]) if reading.attempt else None,
        links={
            "self": f"{root}/api/v1/submissions/{submission.id}",
            "html": f"{root}/submissions/{submission.id}",
            "leaderboard": f"{root}/leaderboards/{submission.track}",
        },
    )


def _scores(wired: Wired, reading: Reading) -> ScoresOut | None:
    shown = service.shown_figures(wired, reading)
    if shown is None:
        return None
    mean = wired.tracks[reading.submission.track][1].modality.official_mean
    return ScoresOut(miou=shown.miou, classes=shown.classes, **({mean.name: shown.official} if mean else {}))
