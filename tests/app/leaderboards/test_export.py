"""Boards as files that other programs read."""

from __future__ import annotations

import csv
import io
from datetime import UTC, datetime
from typing import Any
from uuid import UUID

import pytest

from app.leaderboards.export import as_csv
from app.leaderboards.schemas import BoardOut, RowOut
from app.submissions.schemas import AttemptOut

ID = UUID(int=7)
ROW: dict[str, Any] = {
    "rank": 1,
    "method": "Forest",
    "team": "ada",
    "submission_id": ID,
    "permalink": f"http://testserver/submissions/{ID}",
    "submitted_at": datetime(2026, 3, 1, 12, tzinfo=UTC),
    "baseline": False,
    "source": None,
    "note": None,
    "inputs": None,
    "training_data": None,
    "paper": None,
    "code": None,
    "attempt": AttemptOut(k=2, n=3),
    "miou": 0.5123,
    "miou_13": 0.4107,
    "classes": {"bush": 0.25, "mud": None},
}
PAPER = ROW | {
    "rank": None,
    "method": "SegNet",
    "team": "WildScenes",
    "submission_id": None,
    "permalink": None,
    "submitted_at": "2025",
    "baseline": True,
    "attempt": None,
    "miou": None,
    "miou_13": None,
}


def table(*rows: dict[str, Any]) -> list[list[str]]:
    board = BoardOut(
        track="3d-standard", benchmark="w", groundtruth=None, rows=[RowOut.model_validate(row) for row in rows]
    )
    return list(csv.reader(io.StringIO(as_csv(board), newline="")))


def test_a_board_is_a_header_and_a_line_a_row_with_undefined_figures_left_empty() -> None:
    about = ["rank", "method", "team", "submission_id", "permalink", "submitted_at", "baseline", "attempt"]
    link = f"http://testserver/submissions/{ID}"
    noon = "2026-03-01T12:00:00Z"
    assert table(ROW, PAPER) == [
        [*about, "miou", "miou_13", "bush", "mud"],
        ["1", "Forest", "ada", str(ID), link, noon, "false", "2 of 3", "0.5123", "0.4107", "0.25", ""],
        ["", "SegNet", "WildScenes", "", "", "2025", "true", "", "", "", "0.25", ""],
    ]


@pytest.mark.parametrize("start", ["=1+1", "+1", "-1", "@SUM(A1)", "\tx", "\rx"])
def test_a_name_that_a_spreadsheet_would_take_for_a_formula_is_quoted(start: str) -> None:
    assert table(ROW | {"method": start, "team": start})[1][1:3] == [f"'{start}", f"'{start}"]


def test_names_with_commas_quotes_and_line_breaks_stay_one_cell() -> None:
    assert table(ROW | {"method": 'a, "b"\nc'})[1][1] == 'a, "b"\nc'


def test_a_board_without_rows_has_a_header_alone() -> None:
    assert len(table()) == 1
