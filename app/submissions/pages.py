"""Pages of submissions: the form, one submission, and the team's list."""

from __future__ import annotations

from datetime import datetime
from typing import Any
from uuid import UUID

from anyio import to_thread
from fastapi import APIRouter, Request, Response
from fastapi.responses import RedirectResponse

from app.accounts.identity import Submitter, Viewer
from app.errors import Refusal, Unauthenticated
from app.submissions import service
from app.submissions.disclosure import percent
from app.submissions.lifecycle import FINAL, SAID, State, Visibility
from app.submissions.receive import receive
from app.submissions.service import Reading
from app.web import Wiring, render
from app.wiring import Wired
from evaluator.benchmark import DEFAULT_ENCODING

router = APIRouter(include_in_schema=False)


def shown_time(when: datetime) -> str:
    """A time as pages show it."""
    return f"{when:%Y-%m-%d %H:%M} UTC"


def shown_size(size: int | None) -> str:
    """A number of bytes as pages show it."""
    if size is None:
        return "\N{EM DASH}"
    return f"{size / 1e6:.1f} MB" if size >= 1e6 else f"{size / 1e3:.1f} kB"  # noqa: PLR2004 a megabyte


@router.get("/submit")
def form(request: Request, wired: Wiring, track: str = "", method: str = "") -> Response:
    """The submission form."""
    selected = {"track": track, "method": method, "labels": DEFAULT_ENCODING, "visibility": "private"}
    return render(request, "submit.html", _form(wired, selected))


@router.post("/submit")
async def submit(request: Request, who: Submitter, wired: Wiring) -> Response:
    """Receive the form; its page comes back with the reason when it is refused."""
    try:
        submission_id, _ = await receive(request, wired, who=who)
    except Refusal as refusal:
        status = refusal.status
        context = _form(wired, {"track": "", "method": "", "labels": "", "visibility": "private"}, refusal)
        return await to_thread.run_sync(lambda: render(request, "submit.html", context, status))
    return RedirectResponse(f"/submissions/{submission_id}", 303)


@router.get("/submissions")
def mine(request: Request, who: Viewer, wired: Wiring) -> Response:
    """The team's submissions."""
    if who is None:
        raise Unauthenticated("sign in to see your submissions")
    rows = [
        {
            "id": one.id,
            "method": one.method.name,
            "track_title": wired.tracks[one.track][1].title,
            "state": one.state.value,
            "state_text": one.state.value,
            "visibility": one.visibility.value,
            "submitted": shown_time(one.created_at),
            "miou": percent(score.miou, 2) if score else "",
        }
        for one, score in service.list_of_team(wired, who=who)
    ]
    return render(request, "submissions.html", {"submissions": rows})


@router.get("/submissions/{submission_id}")
def show(request: Request, submission_id: UUID, who: Viewer, wired: Wiring) -> Response:
    """One submission: its state while it moves, then its scores or its problems."""
    reading = service.read(wired, submission_id, who=who)
    submission = reading.submission
    context = {
        "submission": _shown(wired, reading),
        "live": submission.state not in FINAL,
        "mine": reading.mine,
        "may_publish": reading.mine
        and submission.state is State.SCORED
        and submission.visibility is Visibility.PRIVATE,
        "events": [
            {"at": f"{one.at:%Y-%m-%d %H:%M:%S}", "state": one.after.value, "reason": one.reason}
            for one in reading.events
        ],
    }
    return render(request, "submission.html", context)


@router.post("/submissions/{submission_id}/publish")
def publish(submission_id: UUID, who: Submitter, wired: Wiring) -> Response:
    """Put a scored submission on its board."""
    service.publish(wired, submission_id, who=who)
    return RedirectResponse(f"/submissions/{submission_id}", 303)


def _form(wired: Wired, selected: dict[str, str], refusal: Refusal | None = None) -> dict[str, Any]:
    encodings = {name: one for benchmark in wired.benchmarks.values() for name, one in benchmark.encodings.items()}
    return {
        "tracks": [{"id": track.id, "title": track.title} for _, track in wired.tracks.values()],
        "encodings": [{"name": name, "title": one.title} for name, one in encodings.items()],
        "selected": selected,
        "error": refusal.detail if refusal else None,
        "problems": refusal.errors if refusal else [],
    }


def _shown(wired: Wired, reading: Reading) -> dict[str, Any]:
    submission, evaluation = reading.submission, reading.evaluation
    done, total = (evaluation.frames_done, evaluation.frames_total) if evaluation else (0, 0)
    track = wired.tracks[submission.track][1]
    return {
        "id": submission.id,
        "state": submission.state.value,
        "state_text": SAID[submission.state],
        "visibility": submission.visibility.value,
        "track": {"id": track.id, "title": track.title},
        "method": submission.method.name,
        "team": submission.team.name,
        "submitted": shown_time(submission.created_at),
        "sha256": submission.sha256,
        "size": shown_size(submission.size),
        "labels": submission.encoding,
        "progress": {"done": done, "total": total},
        "problems": evaluation.problems if evaluation else [],
        "problems_total": evaluation.problems_total if evaluation else 0,
        "warnings": evaluation.warnings if evaluation else [],
        "scores": _scores(wired, reading),
        "evaluator": evaluation.evaluator if evaluation else None,
        "scoring": evaluation.scoring if evaluation else None,
        "groundtruth": evaluation.groundtruth if evaluation else None,
        "attempt": f"{reading.attempt[0]} of {reading.attempt[1]}" if reading.attempt else "\N{EM DASH}",
    }


def _scores(wired: Wired, reading: Reading) -> dict[str, Any] | None:
    shown = service.shown_figures(wired, reading)
    if shown is None:
        return None
    benchmark, track = wired.tracks[reading.submission.track]
    colors = {one.name: one.color for one in benchmark.classes}
    titles = {"accuracy": "accuracy, %", "mean_accuracy": "mean accuracy, %", "fw_iou": "frequency-weighted IoU, %"}
    return {
        "miou": percent(shown.miou, 2),
        "official": percent(shown.official, 2) if track.official else None,
        "classes": [
            {"name": name, "color": colors[name], "iou": percent(iou, 1)} for name, iou in shown.classes.items()
        ],
        "extra": [{"title": titles[name], "text": percent(value, 1)} for name, value in shown.means.items()],
    }
