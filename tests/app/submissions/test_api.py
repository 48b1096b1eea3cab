"""REST routes of submissions."""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Mapping
from datetime import UTC, datetime
from pathlib import Path
from typing import Any
from uuid import UUID

import pytest
from sqlalchemy import select
from starlette.testclient import TestClient

from app.accounts.models import Scope
from app.submissions import evaluation
from app.submissions.lifecycle import State
from app.submissions.models import Submission
from evaluator import SCORING_VERSION, __version__
from tests.app.world import World

SUBMISSIONS = "/api/v1/submissions"
ROOT = "http://testserver"


@pytest.fixture
def headers(small_world: World) -> dict[str, str]:
    return {"Authorization": f"Bearer {small_world.token()}"}


def uploads(world: World) -> list[Path]:
    folder = world.wired.settings.uploads
    return sorted(folder.iterdir()) if folder.is_dir() else []


def rows(world: World) -> list[Submission]:
    with world.wired.db.read() as session:
        return list(session.scalars(select(Submission).order_by(Submission.created_at, Submission.id)))


def form(*parts: tuple[str, bytes], boundary: str = "XX") -> tuple[bytes, dict[str, str]]:
    """A form's body and the header that goes with it, its parts in this order."""
    made = b""
    for name, content in parts:
        filename = '; filename="my.zip"' if name == "file" else ""
        made += f'--{boundary}\r\nContent-Disposition: form-data; name="{name}"{filename}\r\n\r\n'.encode()
        made += content + b"\r\n"
    return made + f"--{boundary}--\r\n".encode(), {"Content-Type": f"multipart/form-data; boundary={boundary}"}


def send(client: TestClient, headers: Mapping[str, str], *parts: tuple[str, bytes], query: str = "") -> Any:
    body, kind = form(*parts)
    return client.post(SUBMISSIONS + query, content=body, headers={**headers, **kind})


TRACK, METHOD = ("track", b"2d-standard"), ("method", b"Forest")


def test_a_form_becomes_a_submission_that_waits(
    small_world: World, client: TestClient, headers: dict[str, str]
) -> None:
    answer = send(client, headers, TRACK, METHOD, ("file", b"zip"))
    [row] = rows(small_world)
    here = f"{SUBMISSIONS}/{row.id}"
    assert (answer.status_code, answer.headers["location"]) == (202, here)
    said = answer.json()
    assert datetime.fromisoformat(said.pop("submitted_at")) == small_world.clock().astimezone(UTC)
    assert said == {
        "id": str(row.id),
        "state": "queued",
        "visibility": "private",
        "track": "2d-standard",
        "method": "Forest",
        "team": "ada",
        "labels": "benchmark",
        "sha256": hashlib.sha256(b"zip").hexdigest(),
        "size": 3,
        "progress": {"done": 0, "total": 0},
        "problems": [],
        "problems_total": 0,
        "warnings": [],
        "scores": None,
        "evaluator": __version__,
        "scoring": SCORING_VERSION,
        "groundtruth": small_world.evaluation(row.id).groundtruth,
        "attempt": None,
        "links": {
            "self": f"{ROOT}{here}",
            "html": f"{ROOT}/submissions/{row.id}",
            "leaderboard": f"{ROOT}/leaderboards/2d-standard",
        },
        "method_created": True,
    }
    assert [path.read_bytes() for path in uploads(small_world)] == [b"zip"]


@pytest.mark.parametrize(
    "order",
    [
        (TRACK, METHOD, ("labels", b"raw19"), ("visibility", b"public"), ("file", b"zip")),
        (("file", b"zip"), TRACK, METHOD, ("labels", b"raw19"), ("visibility", b"public")),
        (TRACK, METHOD, ("file", b"zip"), ("labels", b"raw19"), ("visibility", b"public")),
        (TRACK, ("method", b"Old name"), ("file", b"zip"), METHOD, ("visibility", b"public"), ("labels", b"raw19")),
    ],
    ids=["before", "after", "some after", "changed after"],
)
def test_fields_count_wherever_they_stand_in_the_form(
    small_world: World, client: TestClient, headers: dict[str, str], order: tuple[tuple[str, bytes], ...]
) -> None:
    said = send(client, headers, *order).json()
    assert (said["state"], said["track"], said["method"], said["labels"], said["visibility"]) == (
        "queued",
        "2d-standard",
        "Forest",
        "raw19",
        "public",
    )
    assert said["method_created"]
    assert [path.read_bytes() for path in uploads(small_world)] == [b"zip"]
    assert [row.id for row in rows(small_world) if row.state is State.QUEUED] == [UUID(said["id"])]


def test_fields_may_stand_in_the_address(client: TestClient, headers: dict[str, str]) -> None:
    said = send(client, headers, ("file", b"zip"), query="?track=2d-val&method=Forest").json()
    assert (said["track"], said["method"], said["method_created"]) == ("2d-val", "Forest", True)


@pytest.mark.parametrize(
    ("parts", "status", "code"),
    [
        ([METHOD, ("file", b"zip")], 422, "track_missing"),
        ([TRACK, ("file", b"zip")], 422, "method_missing"),
        ([TRACK, METHOD], 422, "file_missing"),
        ([], 422, "file_missing"),
        ([("track", b"4d"), METHOD, ("file", b"zip")], 422, "unknown_track"),
        ([TRACK, METHOD, ("labels", b"cityscapes"), ("file", b"zip")], 422, "unknown_encoding"),
        ([TRACK, METHOD, ("visibility", b"secret"), ("file", b"zip")], 422, "unknown_visibility"),
        ([TRACK, METHOD, ("file", b"zip"), ("visibility", b"secret")], 422, "unknown_visibility"),
        ([TRACK, METHOD, ("colour", b"green"), ("file", b"zip")], 422, "invalid"),
        ([TRACK, METHOD, ("file", b"zip"), ("colour", b"green")], 422, "invalid"),
        ([TRACK, METHOD, ("file", b"zip"), ("file", b"zip")], 422, "two_files"),
        ([TRACK, METHOD, ("file", b"z" * 1001)], 413, "upload_too_large"),
        ([("file", b"zip")], 422, "track_missing"),
    ],
)
def test_a_form_that_cannot_be_accepted_is_refused_by_name_and_leaves_nothing(
    make_world: Callable[..., World],
    open_client: Callable[[World], TestClient],
    sqlite_url: str,
    parts: list[tuple[str, bytes]],
    status: int,
    code: str,
) -> None:
    world = make_world(sqlite_url, max_upload_bytes=1000)
    answer = send(open_client(world), {"Authorization": f"Bearer {world.token()}"}, *parts)
    assert (answer.status_code, answer.json()["code"]) == (status, code)
    assert uploads(world) == []
    assert {row.state for row in rows(world)} <= {State.CANCELLED}


def test_an_upload_that_stops_in_the_middle_leaves_nothing_and_counts_nothing(
    small_world: World, client: TestClient, headers: dict[str, str]
) -> None:
    body, kind = form(TRACK, METHOD, ("file", b"z" * 3_000_000))
    answer = client.post(SUBMISSIONS, content=body[:2_500_000], headers={**headers, **kind})
    assert (answer.status_code, answer.json()["code"]) == (422, "bad_form")
    assert uploads(small_world) == []
    assert [row.state for row in rows(small_world)] == [State.CANCELLED]


def test_what_is_no_form_is_refused(client: TestClient, headers: dict[str, str]) -> None:
    answer = client.post(SUBMISSIONS, content=b"PK", headers={**headers, "Content-Type": "application/zip"})
    assert (answer.status_code, answer.json()["code"]) == (415, "not_multipart")


@pytest.mark.parametrize("token", [None, "read"])
def test_who_may_not_submit_is_refused_before_anything_is_kept(
    small_world: World, client: TestClient, token: str | None
) -> None:
    secret = small_world.token(scope=Scope.READ)
    headers = {"Authorization": f"Bearer {secret}"} if token else {}
    answer = send(client, headers, TRACK, METHOD, ("file", b"zip"))
    expected = (403, "token_scope") if token else (401, "unauthenticated")
    assert (answer.status_code, answer.json()["code"]) == expected
    assert (rows(small_world), uploads(small_world)) == ([], [])


def test_a_refused_submission_says_what_is_wrong(
    small_world: World, client: TestClient, headers: dict[str, str]
) -> None:
    submission_id = send(client, headers, TRACK, METHOD, ("file", b"<html>")).json()["id"]
    evaluation.run(small_world.wired, small_world.evaluation(UUID(submission_id)).id)
    said = client.get(f"{SUBMISSIONS}/{submission_id}", headers=headers).json()
    assert (said["state"], said["scores"], said["problems_total"]) == ("rejected", None, 1)
    assert [(one["member"], one["code"]) for one in said["problems"]] == [(None, "not_a_zip")]


def test_a_scored_submission_is_published_by_its_team_alone(
    small_world: World, client: TestClient, headers: dict[str, str]
) -> None:
    submission_id = send(client, headers, TRACK, METHOD, ("file", small_world.predictions("2d-standard"))).json()["id"]
    here = f"{SUBMISSIONS}/{submission_id}"
    assert client.post(f"{here}/publish", headers=headers).status_code == 409
    evaluation.run(small_world.wired, small_world.evaluation(UUID(submission_id)).id)
    other = {"Authorization": f"Bearer {small_world.token('bob@example.org')}"}
    assert client.post(f"{here}/publish", headers=other).status_code == 404
    assert client.get(here).status_code == 404
    answer = client.post(f"{here}/publish", headers=headers)
    assert (answer.status_code, answer.json()["visibility"], answer.json()["attempt"]) == (
        200,
        "public",
        {"k": 1, "n": 1},
    )
    assert client.get(here).json() == answer.json()


def scores(world: World, client: TestClient, track: str) -> tuple[dict[str, Any], dict[str, Any]]:
    """What the API says of a public submission's scores, and what is kept of it."""
    submission_id = world.scored(world.person(), track=track, public=True)
    return client.get(f"{SUBMISSIONS}/{submission_id}").json()["scores"], world.results(submission_id)


def kept_in_full(kept: dict[str, Any], *means: str) -> dict[str, Any]:
    ious = {name: one["iou"] for name, one in kept["classes"].items()}
    return {"miou": kept["miou"], "classes": ious, **{name: kept[name] for name in means}}


@pytest.mark.parametrize(("track", "means"), [("2d-standard", ()), ("3d-standard", ("miou_13",))])
def test_scores_on_hidden_labels_are_rounded(
    small_world: World, client: TestClient, track: str, means: tuple[str, ...]
) -> None:
    said, kept = scores(small_world, client, track)
    ious = {n: v if v is None else round(v, 3) for n, v in kept_in_full(kept)["classes"].items()}
    assert said == {"miou": round(kept["miou"], 4), "classes": ious, **{n: round(kept[n], 4) for n in means}}
    assert said["miou"] != kept["miou"]


@pytest.mark.parametrize(("track", "means"), [("2d-val", ()), ("3d-val", ("miou_13",))])
def test_scores_on_practice_tracks_are_shown_in_full(
    small_world: World, client: TestClient, track: str, means: tuple[str, ...]
) -> None:
    said, kept = scores(small_world, client, track)
    assert said == kept_in_full(kept, *means)


def test_scores_on_open_labels_are_shown_in_full(
    make_world: Callable[..., World],
    open_client: Callable[[World], TestClient],
    sqlite_url: str,
    open_release: Path,
) -> None:
    world = make_world(sqlite_url, release=open_release)
    said, kept = scores(world, open_client(world), "3d-standard")
    assert said == kept_in_full(kept, "miou_13")
