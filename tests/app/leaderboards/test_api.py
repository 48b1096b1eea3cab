"""REST routes of boards."""

from __future__ import annotations

import csv
import io
from typing import Any
from uuid import UUID

import pytest
from starlette.testclient import TestClient

from tests.app.world import World

BOARD = "/api/v1/leaderboards/3d-standard"
ABOUT = ["rank", "method", "team", "submission_id", "permalink", "submitted_at", "baseline", "attempt"]


@pytest.fixture
def published(small_world: World) -> str:
    return str(small_world.scored(small_world.person(), track="3d-standard", public=True))


def table(text: str) -> list[dict[str, str]]:
    return list(csv.DictReader(io.StringIO(text, newline="")))


def test_a_board_says_what_it_is_scored_against(small_world: World, client: TestClient, published: str) -> None:
    said = client.get(BOARD).json()
    digest = small_world.evaluation(UUID(published)).groundtruth
    assert {name: said[name] for name in said if name != "rows"} == {
        "track": "3d-standard",
        "benchmark": "wildscenes",
        "groundtruth": {
            "digest": digest,
            "title": "WildScenes demo",
            "visibility": "hidden",
            "comparable": False,
            "frames": 10,
        },
    }


def test_a_row_of_ours_and_one_of_the_paper_have_the_same_fields(
    small_world: World, client: TestClient, published: str
) -> None:
    rows: list[dict[str, Any]] = client.get(BOARD).json()["rows"]
    kept = small_world.results(UUID(published))
    assert rows[0] == {
        "rank": 1,
        "method": "Forest",
        "team": "ada",
        "submission_id": published,
        "permalink": f"http://testserver/submissions/{published}",
        "submitted_at": "2026-03-01T12:00:00Z",
        "baseline": False,
        "source": None,
        "note": None,
        "inputs": None,
        "training_data": None,
        "paper": None,
        "code": None,
        "attempt": {"k": 1, "n": 1},
        "miou": round(kept["miou"], 4),
        "miou_13": round(kept["miou_13"], 4),
        "classes": {name: round(one["iou"], 3) for name, one in kept["classes"].items()},
    }
    paper = next(row for row in rows if row["baseline"])
    assert set(paper) == set(rows[0])
    assert list(paper["classes"]) == list(rows[0]["classes"])
    assert (paper["rank"], paper["submitted_at"], paper["submission_id"], paper["attempt"]) == (
        None,
        "2025",
        None,
        None,
    )


def test_the_csv_has_the_figures_of_the_json(client: TestClient, published: str) -> None:
    said, answer = client.get(BOARD).json(), client.get(f"{BOARD}.csv")
    assert answer.headers["content-type"] == "text/csv; charset=utf-8"
    assert answer.headers["content-disposition"] == 'inline; filename="3d-standard.csv"'
    lines = table(answer.text)
    assert list(lines[0]) == [*ABOUT, "miou", "miou_13", *said["rows"][0]["classes"]]
    for line, row in zip(lines, said["rows"], strict=True):
        figures = {"miou": row["miou"], "miou_13": row["miou_13"], **row["classes"]}
        assert {name: line[name] for name in figures} == {n: "" if v is None else str(v) for n, v in figures.items()}


@pytest.mark.parametrize(
    ("accept", "kind"),
    [
        ("text/csv", "text/csv; charset=utf-8"),
        ("text/csv, */*;q=0.1", "text/csv; charset=utf-8"),
        ("application/json", "application/json"),
        ("*/*", "application/json"),
        ("text/csv, application/json", "application/json"),
        ("", "application/json"),
    ],
)
def test_a_client_gets_the_format_that_it_asks_for(client: TestClient, accept: str, kind: str) -> None:
    assert client.get(BOARD, headers={"Accept": accept}).headers["content-type"] == kind


@pytest.mark.parametrize("path", ["/api/v1/leaderboards/4d", "/api/v1/leaderboards/4d.csv"])
def test_an_unknown_board_is_a_problem(client: TestClient, path: str) -> None:
    answer = client.get(path)
    assert (answer.status_code, answer.json()["code"]) == (404, "unknown_track")


def test_a_method_named_like_a_formula_does_not_become_one(small_world: World, client: TestClient) -> None:
    small_world.scored(small_world.person(), track="3d-standard", method="=1+1", public=True)
    assert table(client.get(f"{BOARD}.csv").text)[0]["method"] == "'=1+1"
    assert client.get(BOARD).json()["rows"][0]["method"] == "=1+1"
