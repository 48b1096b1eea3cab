"""What nobody but maintainers may learn of hidden labels, on any page, route or export."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator
from itertools import chain
from pathlib import Path
from typing import Any
from uuid import UUID

import pytest
from starlette.testclient import TestClient

from app.accounts.service import identify_token
from evaluator.groundtruth import GroundTruth
from tests.app.world import World

SECRET = {
    "precision",
    "recall",
    "f1",
    "confusion",
    "matrix",
    "matrices",
    "counts",
    "totals",
    "labels_digest",
    "tp",
    "fp",
}


def addresses(submission_id: UUID, track: str) -> list[str]:
    return [
        "/",
        f"/leaderboards/{track}",
        f"/submissions/{submission_id}",
        f"/submit?track={track}",
        f"/api/v1/submissions/{submission_id}",
        f"/api/v1/leaderboards/{track}",
        f"/api/v1/leaderboards/{track}.csv",
        f"/api/v1/tracks/{track}/facts",
        "/api/v1/tracks",
        "/api/v1/openapi.json",
    ]


def keys(said: Any) -> Iterator[str]:
    """Every key in a JSON document."""
    if isinstance(said, dict):
        yield from said
        yield from chain.from_iterable(keys(one) for one in said.values())
    elif isinstance(said, list):
        yield from chain.from_iterable(keys(one) for one in said)


def counts(kept: dict[str, Any]) -> set[str]:
    """The numbers of the result's confusion: cells, rows, columns; above 256, since colours have the others."""
    matrix = kept["confusion"]
    cells = {n for row in matrix for n in row}
    sums = {sum(row) for row in matrix} | {sum(column) for column in zip(*matrix, strict=True)}
    return {str(n) for n in cells | sums | {sum(map(sum, matrix))} if n > 256}


def precise(kept: dict[str, Any]) -> set[str]:
    """Every figure beyond the digits that may be shown, as a fraction and as percent."""
    figures = [kept[name] for name in ("miou", "miou_13", "accuracy", "mean_accuracy", "fw_iou") if name in kept]
    figures += [value for one in kept["classes"].values() for value in one.values()]
    exact = [value for value in figures if value is not None and round(value, 4) != value]
    return {text[:7] for value in exact for text in (repr(value), repr(100 * value)) if len(text) > 7}


def numbers(text: str) -> set[str]:
    """The numbers of a text that stand alone: no parts of ids, digests and names of frames."""
    joined = re.sub(r"(?<=\d),(?=\d{3}\b)", "", text)  # 1,234 as pages write it
    return {one for form in (text, joined) for one in re.findall(r"(?<![\w.#-])\d+(?:\.\d+)?(?![\w-])", form)}


@pytest.fixture(params=["2d-standard", "3d-winter-to-summer"])
def track(request: pytest.FixtureRequest) -> str:
    return str(request.param)


@pytest.fixture
def published(small_world: World, track: str) -> UUID:
    return small_world.scored(small_world.person(), track=track, public=True)


def test_no_count_and_no_figure_beyond_its_digits_is_shown_anywhere(
    small_world: World, client: TestClient, track: str, published: UUID
) -> None:
    kept = small_world.results(published)
    counted, exact = counts(kept), precise(kept)
    assert len(counted) > 3
    assert len(exact) > 40
    frame_facts = set()  # the number of pixels or points of a frame is public
    for address in addresses(published, track):
        text = client.get(address).text
        assert client.get(address).status_code == 200
        if address.endswith("/facts"):
            frames = client.get(address).json()["modalities"][track[:2]]["frames"]
            frame_facts = {str(n) for frame in frames for n in frame["shape"]}
        assert numbers(text) & counted <= frame_facts, address
        assert [figure for figure in exact if figure in text] == [], address


def test_the_search_for_figures_would_find_them_on_an_open_release(
    make_world: Callable[..., World],
    open_client: Callable[[World], TestClient],
    sqlite_url: str,
    open_release: Path,
) -> None:
    world = make_world(sqlite_url, release=open_release)
    submission_id = world.scored(world.person(), public=True)
    kept = world.results(submission_id)
    text = open_client(world).get(f"/api/v1/submissions/{submission_id}").text
    assert repr(kept["miou"])[:7] in precise(kept)
    assert [figure for figure in precise(kept) if figure in text]
    assert numbers(str(kept["confusion"])) & counts(kept)


def test_no_answer_has_a_key_for_what_must_not_be_shown(
    small_world: World, client: TestClient, track: str, published: UUID
) -> None:
    for address in addresses(published, track):
        if address.startswith("/api") and not address.endswith("csv"):
            assert set(keys(client.get(address).json())) & SECRET == set(), address


def test_the_owner_sees_no_more_of_hidden_labels_than_everybody(
    small_world: World, client: TestClient, track: str
) -> None:
    token = small_world.token()
    mine = small_world.scored(identify_token(small_world.wired.db, token), track=track)
    exact = precise(small_world.results(mine))
    for address in (f"/api/v1/submissions/{mine}", f"/submissions/{mine}", "/submissions"):
        answer = client.get(address, headers={"Authorization": f"Bearer {token}"})
        assert (answer.status_code, [figure for figure in exact if figure in answer.text]) == (200, []), address


def test_the_facts_of_a_track_are_frames_sizes_and_train_shares_only(
    small_world: World, client: TestClient, track: str
) -> None:
    said = client.get(f"/api/v1/tracks/{track}/facts").json()
    modality, found = small_world.wired.tracks[track][1].modality_id, small_world.wired.tracks[track]
    [release] = small_world.wired.settings.releases.iterdir()
    truth = GroundTruth(release, found[0])
    assert said == {
        "format": 1,
        "benchmark": "wildscenes",
        "title": "WildScenes demo",
        "groundtruth": truth.digest,
        "open": False,
        "synthetic": True,
        "comparable": False,
        "modalities": {
            modality: {
                "frames": [
                    {"name": f.name, "sequence": f.sequence, "split": f.split, "shape": list(f.shape)}
                    for f in truth.frames(found[1])
                ],
                "train_shares": truth.facts.modalities[modality].train_shares,
            }
        },
    }
    manifest = truth.release.model_dump()
    text = client.get(f"/api/v1/tracks/{track}/facts").text
    assert not [one["sha256"] for frames in manifest["modalities"].values() for one in frames if one["sha256"] in text]
    assert not numbers(text) & {str(n) for totals in manifest["totals"].values() for n in totals.values() if n > 256}
