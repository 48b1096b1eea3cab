"""Pages of boards: the home page with every track, and one page a board."""

from __future__ import annotations

from typing import Any

from fastapi import APIRouter, Request, Response

from app.leaderboards import service
from app.leaderboards.ranking import Row
from app.leaderboards.schemas import permalink
from app.leaderboards.service import Board
from app.submissions.disclosure import percent
from app.web import Wiring, render
from app.wiring import Wired

router = APIRouter(include_in_schema=False)

HEAT_STEPS = 10


@router.get("/")
def home(request: Request, wired: Wiring) -> Response:
    """What the benchmark is, its tracks, and how to submit."""
    boards = [service.board(wired, track_id) for track_id in wired.tracks]
    first = next(iter(wired.tracks))
    context = {
        "tracks": [_card(board) for board in boards],
        "shell": [
            f"wildscenes pack predictions/ --track {first} -o my.zip",
            f"wildscenes validate my.zip --track {first}",
            'curl -H "Authorization: Bearer $TOKEN" \\',
            f'  -F track={first} -F method="My method" \\',
            f"  -F file=@my.zip {wired.settings.base_url.rstrip('/')}/api/v1/submissions",
        ],
    }
    return render(request, "home.html", context)


@router.get("/leaderboards/{track}")
def leaderboard(request: Request, track: str, wired: Wiring) -> Response:
    """One board."""
    board = service.board(wired, track)
    scored = [board.benchmark.classes[i] for i in board.track.scored]
    mean = board.track.modality.official_mean
    context = {
        "track": {**_about(board), "title": board.track.title, "modality": board.track.modality.title},
        "classes": scored,
        "rows": _rows(wired, board),
        "official_name": mean.title if mean else None,
        "exports": [
            {"title": "CSV", "href": f"/api/v1/leaderboards/{track}.csv"},
            {"title": "JSON", "href": f"/api/v1/leaderboards/{track}"},
        ],
        "citation": board.benchmark.citation,
    }
    return render(request, "leaderboard.html", context)


def _about(board: Board) -> dict[str, Any]:
    return {
        "id": board.track.id,
        "trained_on": board.track.protocol.trained_on,
        "sequences": list(board.track.protocol.test_sequences),
        "frames": board.frames or None,
        "ranked": board.track.protocol.ranked,
        "groundtruth": ("open" if board.facts.open else "hidden") if board.facts and board.frames else None,
    }


def _card(board: Board) -> dict[str, Any]:
    best = next((row for row in board.rows if row.rank == 1), None)
    return {
        **_about(board),
        "title": board.track.title,
        "modality": board.track.modality.title,
        "protocol_title": board.track.protocol.title,
        "methods": len(board.rows),
        "best": {"method": best.method, "miou": percent(best.shown.miou, 2)} if best else None,
    }


def _rows(wired: Wired, board: Board) -> list[dict[str, Any]]:
    rivals = [row for row in board.rows if row.rank is not None] or board.rows
    names = [board.benchmark.names[i] for i in board.track.scored]
    best = {name: _best([row.shown.classes[name] for row in rivals]) for name in names}
    best_miou = _best([row.shown.miou for row in rivals])
    return [
        {
            "rank": row.rank,
            "method": row.method,
            "team": row.team,
            "permalink": permalink(wired, row),
            "date": f"{row.submitted_at:%Y-%m-%d}" if row.submitted_at else str(row.year or ""),
            "baseline": row.baseline,
            "source": row.source,
            "note": row.note,
            "inputs": row.inputs,
            "training_data": row.training_data,
            "attempt": f"{row.attempt[0]} of {row.attempt[1]}" if row.attempt else "",
            "miou": {
                "text": percent(row.shown.miou, 2),
                "best": row in rivals and _same(row.shown.miou, best_miou, 2),
            },
            "official": {"text": percent(row.shown.official, 2)} if board.track.official else None,
            "cells": [_cell(row, name, best[name], among=row in rivals) for name in names],
        }
        for row in board.rows
    ]


def _cell(row: Row, name: str, best: float | None, *, among: bool) -> dict[str, Any]:
    value = row.shown.classes[name]
    return {
        "text": percent(value, 1),
        "best": among and _same(value, best, 1),
        "heat": None if value is None else int(value * HEAT_STEPS),
    }


def _best(values: list[float | None]) -> float | None:
    return max((value for value in values if value is not None), default=None)


def _same(value: float | None, best: float | None, digits: int) -> bool:
    """Whether a figure reads like the best one."""
    return value is not None and best is not None and percent(value, digits) == percent(best, digits)
