"""From a zip to a row: by curl, over the API and the boards, with the digits that the local command prints."""

from __future__ import annotations

import csv
import io
import json
from decimal import ROUND_HALF_EVEN, Decimal
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest

from evaluator.benchmark import Benchmark

if TYPE_CHECKING:
    from tests.conftest import DataSet
    from tests.journeys.conftest import Predict, Server

NOBODY = "00000000-0000-0000-0000-000000000000"


@pytest.fixture(scope="module")
def server(demo_server: Server) -> Server:
    return demo_server


@pytest.fixture(scope="module")
def ada(server: Server) -> str:
    server.cli("admin", "create-user", "ada@example.org", "--home", server.home)
    return server.cli("admin", "create-token", "ada@example.org", "--home", server.home).stdout.strip()


@pytest.fixture(scope="module")
def bob(server: Server) -> str:
    return server.token("bob")


def half_even(value: float | None, digits: int) -> float | None:
    """What a hidden release may show of a figure."""
    if value is None:
        return None
    return float(Decimal(repr(value)).quantize(Decimal(10) ** -digits, ROUND_HALF_EVEN))


def scored_locally(server: Server, archive: Path, track: str, groundtruth: Path) -> dict[str, Any]:
    """The figures that `wildscenes evaluate` writes, rounded as the server must."""
    said = archive.with_suffix(".json")
    server.cli("evaluate", archive, "--track", track, "--groundtruth", groundtruth, "--json", said)
    figures = json.loads(said.read_text("utf-8"))
    official = {"miou_13": half_even(figures["miou_13"], 4)} if "miou_13" in figures else {}
    classes = {name: half_even(one["iou"], 3) for name, one in figures["classes"].items()}
    return {"miou": half_even(figures["miou"], 4), "classes": classes, **official}


@pytest.mark.parametrize("track", ["2d-standard", "3d-standard"])
def test_a_zip_sent_by_curl_becomes_a_row_with_the_digits_of_the_local_command(
    server: Server, ada: str, demo: DataSet, predict: Predict, wildscenes: Benchmark, track: str
) -> None:
    archive, method = predict(track), f"Réseau {track}"
    status, made = server.curl(archive, ada, track=track, method=method, labels="benchmark", visibility="public")
    assert (status, made["method_created"], made["visibility"]) == (202, True, "public")
    said = server.settled(made["id"], ada)
    expected = scored_locally(server, archive, track, demo.groundtruth)
    assert (said["state"], said["problems"], said["warnings"]) == ("scored", [], [])
    assert said["scores"] == expected
    assert said["progress"] == {"done": 10, "total": 10}
    assert 0.1 < said["scores"]["miou"] < 0.9

    board = server.get(f"/api/v1/leaderboards/{track}").json()
    about = board["groundtruth"]
    assert (about["visibility"], about["comparable"], about["frames"]) == ("hidden", False, 10)
    ranked = [row for row in board["rows"] if row["rank"] is not None]
    assert ranked == [
        {
            "rank": 1,
            "method": method,
            "team": "ada",
            "submission_id": said["id"],
            "permalink": f"{server.url}/submissions/{said['id']}",
            "submitted_at": said["submitted_at"],
            "baseline": False,
            "source": None,
            "note": None,
            "inputs": None,
            "training_data": None,
            "paper": None,
            "code": None,
            "attempt": {"k": 1, "n": 1},
            **expected,
        }
    ]
    beside = [row for row in board["rows"] if row["rank"] is None]
    printed = {one.title for one in wildscenes.baselines if one.track == track}
    assert {row["method"] for row in beside} == printed != set()
    assert all(row["baseline"] and row["attempt"] is None and row["permalink"] is None for row in beside)
    assert board["rows"] == ranked + beside

    answer = server.get(f"/api/v1/leaderboards/{track}.csv")
    assert answer.headers["content-type"] == "text/csv; charset=utf-8"
    assert server.get(f"/api/v1/leaderboards/{track}", headers={"Accept": "text/csv"}).text == answer.text
    lines = list(csv.DictReader(io.StringIO(answer.text)))
    assert [line["method"] for line in lines] == [row["method"] for row in board["rows"]]
    classes = {name: "" if iou is None else repr(iou) for name, iou in expected["classes"].items()}
    official = {"miou_13": repr(expected["miou_13"])} if "miou_13" in expected else {}
    same = {name: ranked[0][name] for name in ("method", "team", "submission_id", "permalink", "submitted_at")}
    assert lines[0] == {
        "rank": "1",
        **same,
        "baseline": "false",
        "attempt": "1 of 1",
        "miou": repr(expected["miou"]),
        **official,
        **classes,
    }


def test_a_private_submission_is_nobody_elses_until_it_is_published(
    server: Server, ada: str, bob: str, predict: Predict
) -> None:
    track = "2d-winter-to-summer"

    def on_the_board() -> list[tuple[str, dict[str, int]]]:
        rows = server.get(f"/api/v1/leaderboards/{track}").json()["rows"]
        return [(row["submission_id"], row["attempt"]) for row in rows if not row["baseline"]]

    first = server.send(predict(track, 0.9), ada, track=track, method="Quiet")
    assert server.settled(first, ada)["visibility"] == "private"
    own, unknown = f"/api/v1/submissions/{first}", f"/api/v1/submissions/{NOBODY}"
    assert on_the_board() == []
    assert server.get(unknown, bob).status_code == 404
    for stranger in (None, bob):
        answer = server.get(own, stranger)
        assert (answer.status_code, answer.json()) == (404, server.get(unknown, stranger).json())
        assert server.get(f"/submissions/{first}", stranger).status_code == 404
    assert server.ask("POST", f"{own}/publish", bob).status_code == 404
    assert server.ask("POST", f"{own}/publish").status_code == 401

    published = server.ask("POST", f"{own}/publish", ada)
    assert (published.status_code, published.json()["visibility"]) == (200, "public")
    assert server.get(own).json()["scores"] == published.json()["scores"] is not None
    assert on_the_board() == [(first, {"k": 1, "n": 1})]

    second = server.send(predict(track, 0.6), ada, track=track, method="Quiet")
    server.settled(second, ada)
    assert on_the_board() == [(first, {"k": 1, "n": 2})]
    server.ask("POST", f"/api/v1/submissions/{second}/publish", ada)
    assert on_the_board() == [(second, {"k": 2, "n": 2})]  # the one published last, though it is worse


def test_the_submit_command_waits_and_prints_the_digits_of_the_local_one(
    server: Server, bob: str, demo: DataSet, predict: Predict
) -> None:
    track = "3d-summer-to-summer"
    archive = predict(track)
    told = ("--track", track, "--method", "By command", "--server", server.url, "--token", bob, "--public", "--wait")
    lines = server.cli("submit", archive, *told).stdout.splitlines()
    expected = scored_locally(server, archive, track, demo.groundtruth)
    assert lines[0].startswith(f"{server.url}/submissions/")
    assert lines[1] == f"scored: By command on {track}"
    shown = {name: "-" if iou is None else f"{100 * iou:.1f}" for name, iou in expected["classes"].items()}
    assert dict(line.split() for line in lines[2:]) == {**shown, "mIoU": f"{100 * expected['miou']:.2f}"}
    rows = server.get(f"/api/v1/leaderboards/{track}").json()["rows"]
    assert [(row["method"], row["miou"]) for row in rows if row["rank"]] == [("By command", expected["miou"])]


def test_the_public_facts_of_a_track_let_a_submitter_check_a_zip_alone(
    server: Server, predict: Predict, tmp_path: Path
) -> None:
    facts = tmp_path / "facts.json"
    facts.write_bytes(server.get("/api/v1/tracks/2d-standard/facts").content)
    whole, part = predict("2d-standard"), predict("2d-winter-to-summer")
    good = server.cli("validate", whole, "--track", "2d-standard", "--facts", facts)
    assert good.stdout == "valid for 2d-standard\n"
    bad = server.cli("validate", part, "--track", "2d-standard", "--facts", facts, "--json", check=False)
    said = json.loads(bad.stdout)
    assert (bad.returncode, said["valid"], said["problems_total"]) == (1, False, 6)
    assert {one["code"] for one in said["problems"]} == {"missing_frame"}
    assert "confusion" not in facts.read_text("utf-8")
