"""REST routes of tracks."""

from __future__ import annotations

from collections.abc import Callable

import pytest
from starlette.testclient import TestClient

from tests.app.world import World

LINKS = "http://testserver/api/v1"


def test_every_track_is_listed_in_the_order_of_the_definition(small_world: World, client: TestClient) -> None:
    said = client.get("/api/v1/tracks").json()
    assert [one["id"] for one in said] == list(small_world.wired.tracks)
    assert len(said) == 12


def test_a_track_says_what_it_is_trained_on_tested_on_and_scored(small_world: World, client: TestClient) -> None:
    said = {one["id"]: one for one in client.get("/api/v1/tracks").json()}
    benchmark, track = small_world.wired.tracks["3d-winter-to-summer"]
    [release] = small_world.wired.settings.releases.iterdir()
    dropped = {"fence", "gravel", "other-terrain", "sky", "water"}
    assert said["3d-winter-to-summer"] == {
        "id": "3d-winter-to-summer",
        "benchmark": "wildscenes",
        "title": track.title,
        "modality": "3d",
        "protocol": "winter-to-summer",
        "trained_on": track.protocol.trained_on,
        "test_sequences": ["V-03", "K-03"],
        "classes": [name for name in benchmark.names if name not in dropped],
        "ranked": True,
        "frames": 4,
        "groundtruth": release.name,
        "links": {
            "facts": f"{LINKS}/tracks/3d-winter-to-summer/facts",
            "leaderboard": f"{LINKS}/leaderboards/3d-winter-to-summer",
        },
    }
    assert [one["id"] for one in said.values() if not one["ranked"]] == ["2d-val", "3d-val"]


def test_without_ground_truth_tracks_are_listed_and_say_so(
    make_world: Callable[..., World], open_client: Callable[[World], TestClient], sqlite_url: str
) -> None:
    client = open_client(make_world(sqlite_url, release=None))
    assert {(one["frames"], one["groundtruth"]) for one in client.get("/api/v1/tracks").json()} == {(None, None)}
    answer = client.get("/api/v1/tracks/2d-standard/facts")
    assert (answer.status_code, answer.json()["code"]) == (404, "no_groundtruth")


@pytest.mark.parametrize("track", ["4d", "2d-standard.csv", "%00", "x" * 3000])
def test_facts_of_an_unknown_track_are_a_problem_of_bounded_length(client: TestClient, track: str) -> None:
    answer = client.get(f"/api/v1/tracks/{track}/facts")
    assert (answer.status_code, answer.json()["code"]) == (404, "unknown_track")
    assert len(answer.text) < 400
