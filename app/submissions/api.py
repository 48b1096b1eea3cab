"""REST routes of submissions."""

from __future__ import annotations

from uuid import UUID

from anyio import to_thread
from fastapi import APIRouter, Request, Response

from app.accounts.identity import Submitter, Viewer
from app.submissions import service
from app.submissions.receive import receive
from app.submissions.schemas import SubmissionMade, SubmissionOut, submission_out
from app.web import Wiring

router = APIRouter(prefix="/api/v1/submissions", tags=["submissions"])

FORM = {
    "required": True,
    "content": {
        "multipart/form-data": {
            "schema": {
                "type": "object",
                "required": ["track", "method", "file"],
                "properties": {
                    "track": {"type": "string"},
                    "method": {"type": "string"},
                    "labels": {"type": "string", "default": "benchmark"},
                    "visibility": {"type": "string", "enum": ["private", "public"], "default": "private"},
                    "file": {"type": "string", "format": "binary"},
                },
            }
        }
    },
}


@router.post("", status_code=202, openapi_extra={"requestBody": FORM})
async def submit(request: Request, response: Response, who: Submitter, wired: Wiring) -> SubmissionMade:
    """Send a zip for a track; put the fields before `file` to have them checked before it is read."""
    submission_id, created = await receive(request, wired, who=who)
    reading = await to_thread.run_sync(lambda: service.read(wired, submission_id, who=who))
    response.headers["Location"] = f"{router.prefix}/{submission_id}"
    return SubmissionMade(**submission_out(wired, reading).model_dump(), method_created=created)


@router.get("/{submission_id}")
def read_submission(submission_id: UUID, who: Viewer, wired: Wiring) -> SubmissionOut:
    """Where a submission stands, and what became of it."""
    return submission_out(wired, service.read(wired, submission_id, who=who))


@router.post("/{submission_id}/publish")
def publish_submission(submission_id: UUID, who: Submitter, wired: Wiring) -> SubmissionOut:
    """Show a scored submission on its leaderboard."""
    service.publish(wired, submission_id, who=who)
    return submission_out(wired, service.read(wired, submission_id, who=who))
