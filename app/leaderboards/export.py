"""Boards as files that other programs read."""

from __future__ import annotations

import csv
import io

from app.leaderboards.schemas import BoardOut

_FORMULA = ("=", "+", "-", "@", "\t", "\r")


def as_csv(board: BoardOut) -> str:
    """A board as CSV (RFC 4180): one line a row, one column a class, fractions, empty where undefined."""
    stream = io.StringIO()
    classes = list(board.rows[0].classes) if board.rows else []
    means = ["miou", *(board.rows[0].model_extra or {} if board.rows else {})]
    about = ["rank", "method", "team", "submission_id", "permalink", "submitted_at", "baseline", "attempt"]
    writer = csv.writer(stream)
    writer.writerow([*about, *means, *classes])
    for row in board.rows:
        said = row.model_dump(mode="json")
        attempt = f"{row.attempt.k} of {row.attempt.n}" if row.attempt else ""
        values = [*(said[name] for name in about[:-1]), attempt, *(said[name] for name in means)]
        writer.writerow([_safe(value) for value in [*values, *row.classes.values()]])
    return stream.getvalue()


def _safe(value: object) -> object:
    """A text that no spreadsheet takes for a formula."""
    if isinstance(value, bool):
        return str(value).lower()
    return f"'{value}" if isinstance(value, str) and value.startswith(_FORMULA) else value
