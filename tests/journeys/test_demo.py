"""The demo: one command on an empty folder, one line to paste, and a score that nobody mistakes for WildScenes."""

from __future__ import annotations

import json
import re
import subprocess
from typing import TYPE_CHECKING

import pytest

from evaluator.benchmark import Benchmark

if TYPE_CHECKING:
    from tests.journeys.conftest import Serve, Server

NOTICE = "the labels on this server are synthetic. Scores here are not comparable with the paper"


@pytest.fixture(scope="module")
def server(serve: Serve) -> Server:
    return serve("--demo")


def test_the_printed_line_submits_a_sample_that_is_scored_and_ranked(server: Server) -> None:
    said = server.output.read_text("utf-8")
    (line,) = re.findall(r"^curl .*$", said, re.MULTILINE)
    (token,) = re.findall(r"^Token of the demo account .*: (wsc_\S+)$", said, re.MULTILINE)
    done = subprocess.run(["sh", "-c", f"{line} -sS -w '\n%{{http_code}}'"], capture_output=True, text=True, check=True)
    body, _, status = done.stdout.rpartition("\n")
    made = json.loads(body)
    assert (status, made["state"], made["method"]) == ("202", "queued", "My first method")
    assert server.settled(made["id"], token)["state"] == "scored"
    rows = server.get("/api/v1/leaderboards/2d-standard").json()["rows"]
    assert "My first method" in [row["method"] for row in rows if row["rank"]]


def test_the_boards_hold_three_samples_each_and_the_papers_rows_beside_them(
    server: Server, wildscenes: Benchmark, poll: object
) -> None:
    token = (server.home / "demo" / "token").read_text("utf-8")
    for track in ("2d-standard", "3d-standard"):

        def samples(track: str = track) -> list[tuple[str, int]]:
            rows = server.get(f"/api/v1/leaderboards/{track}").json()["rows"]
            return [(row["method"], row["rank"]) for row in rows if row["rank"] and row["method"] != "My first method"]

        assert callable(poll)
        poll(lambda samples=samples: len(samples()) == 3)
        assert [method for method, _ in samples()] == ["Nearly there", "Careful", "Sketch"]
        rows = server.get(f"/api/v1/leaderboards/{track}").json()["rows"]
        printed = {one.title for one in wildscenes.baselines if one.track == track}
        assert {row["method"] for row in rows if row["baseline"]} == printed
        assert {row["rank"] for row in rows if row["baseline"]} == {None}
    assert server.get("/submissions", token).status_code == 200


def test_every_page_says_that_the_labels_are_synthetic(server: Server, wildscenes: Benchmark) -> None:
    token = (server.home / "demo" / "token").read_text("utf-8")
    row = next(row for row in server.get("/api/v1/leaderboards/2d-standard").json()["rows"] if row["permalink"])
    boards = [f"/leaderboards/{track}" for track in wildscenes.all_tracks]
    for path in ("/", "/submit", "/sign-in", "/submissions", "/nowhere", row["permalink"], *boards):
        for who in (None, token):
            page = server.get(path, who)
            assert NOTICE in page.text, path
            assert page.headers["content-type"] == "text/html; charset=utf-8"
            assert page.status_code in ((200,) if path != "/nowhere" else (404,)) or who is None
