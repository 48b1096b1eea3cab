"""REST routes of boards."""

from __future__ import annotations

from typing import Any

from fastapi import APIRouter, Request, Response

from app.leaderboards import service
from app.leaderboards.export import as_csv
from app.leaderboards.schemas import BoardOut, board_out
from app.web import Wiring

router = APIRouter(prefix="/api/v1/leaderboards", tags=["leaderboards"])

CSV = "text/csv; charset=utf-8"
_CSV_TOO: dict[int | str, dict[str, Any]] = {200: {"content": {"text/csv": {}}}}


@router.get("/{track}.csv", responses=_CSV_TOO, response_class=Response)
def read_csv(track: str, wired: Wiring) -> Response:
    """A leaderboard as CSV."""
    return _csv(track, board_out(wired, service.board(wired, track)))


@router.get("/{track}", responses=_CSV_TOO, response_model=BoardOut)
def read_board(track: str, request: Request, wired: Wiring) -> BoardOut | Response:
    """A leaderboard as JSON, or as CSV where `Accept` prefers that."""
    said = board_out(wired, service.board(wired, track))
    accepted = request.headers.get("accept", "")
    return _csv(track, said) if "text/csv" in accepted and "json" not in accepted else said


def _csv(track: str, said: BoardOut) -> Response:
    return Response(as_csv(said), media_type=CSV, headers={"Content-Disposition": f'inline; filename="{track}.csv"'})
