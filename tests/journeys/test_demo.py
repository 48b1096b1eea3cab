"""The demo: one command on an empty folder, one line to paste, and a score that nobody mistakes for WildScenes."""

from __future__ import annotations

import json
import re
import subprocess
from collections.abc import Callable
from typing import TYPE_CHECKING, Any

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
    assert (status, made["method"]) == ("202", "My first method")
    assert server.settled(made["id"], token)["state"] == "scored"
    rows = server.get("/api/v1/leaderboards/2d-standard").json()["rows"]
    assert "My first method" in [row["method"] for row in rows if row["rank"]]


def test_the_boards_hold_three_samples_each_and_the_papers_rows_beside_them(
    server: Server, wildscenes: Benchmark, poll: Callable[..., Any]
) -> None:
    for track in ("2d-standard", "3d-standard"):

        def rows(track: str = track) -> list[dict[str, Any]]:
            found: list[dict[str, Any]] = server.get(f"/api/v1/leaderboards/{track}").json()["rows"]
            return [row for row in found if row["method"] != "My first method"]

        poll(lambda rows=rows: len([row for row in rows() if row["rank"]]) == 3)
        assert [row["method"] for row in rows()[:3]] == ["Nearly there", "Careful", "Sketch"]
        printed = {one.title for one in wildscenes.baselines if one.track == track}
        assert {row["method"] for row in rows()[3:]} == printed
        assert {(row["rank"], row["baseline"]) for row in rows()[3:]} == {(None, True)}


def test_every_page_says_that_the_labels_are_synthetic(server: Server, wildscenes: Benchmark) -> None:
    token = (server.home / "demo" / "token").read_text("utf-8")
    (first, *_) = server.get("/api/v1/leaderboards/2d-standard").json()["rows"]
    boards = [f"/leaderboards/{track}" for track in wildscenes.all_tracks]
    for path in ("/", "/submit", "/sign-in", "/submissions", "/nowhere", first["permalink"], *boards):
        for who in (None, token):
            page = server.get(path, who)
            expected = 404 if path == "/nowhere" else 401 if (path, who) == ("/submissions", None) else 200
            assert (page.status_code, page.headers["content-type"]) == (expected, "text/html; charset=utf-8"), path
            assert NOTICE in page.text, path
