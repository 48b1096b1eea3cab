"""Pages of boards."""

from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path

import pytest
from starlette.testclient import TestClient

from app.submissions.disclosure import percent
from tests.app.world import World

DASH = "\N{EN DASH}"


def texts(cell: str, page: str) -> list[str]:
    """The texts of cells that begin like this, their markup removed."""
    found = re.findall(rf"{cell}[^>]*>(.*?)</t[dh]>", page, re.DOTALL)
    return [" ".join(re.sub(r"<[^>]+>", " ", one).split()) for one in found]


def test_the_home_page_names_every_track_and_the_best_of_each(small_world: World, client: TestClient) -> None:
    ada, bob = small_world.person("ada@example.org"), small_world.person("bob@example.org")
    best = small_world.scored(ada, method="Careful", quality=0.9, public=True)
    small_world.scored(bob, method="Sketch", quality=0.5, public=True)
    page = client.get("/").text
    for track in small_world.wired.tracks:
        assert f'href="/leaderboards/{track}"' in page
    assert f'<span class="score">{percent(small_world.results(best)["miou"], 2)}</span>' in page
    assert '<span class="by">Careful</span>' in page
    assert '<span class="by">Sketch</span>' not in page


@pytest.mark.parametrize("track", ["2d-standard", "3d-standard", "2d-val"])
def test_a_board_shows_ranks_names_and_figures_in_percent(small_world: World, client: TestClient, track: str) -> None:
    ada, bob = small_world.person("ada@example.org"), small_world.person("bob@example.org")
    made = [
        small_world.scored(ada, track=track, method="Careful", quality=0.9, public=True),
        small_world.scored(bob, track=track, method="Sketch", quality=0.5, public=True),
    ]
    page = client.get(f"/leaderboards/{track}").text
    ranks = [DASH, DASH] if track == "2d-val" else ["1", "2"]
    assert texts('<td class="rank"', page)[:2] == ranks
    assert texts('<th scope="row" class="method"', page)[:2] == ["Careful", "Sketch"]
    assert texts('<td class="number miou"', page)[:2] == [percent(small_world.results(one)["miou"], 2) for one in made]
    shown = [percent(one["iou"], 1) for one in small_world.results(made[0])["classes"].values()]
    row = page.split("<tr>")[2].split("</tr>")[0]
    official = [percent(small_world.results(made[0])["miou_13"], 2)] if track.startswith("3d") else []
    assert texts('<td class="number', row)[1:] == [*official, *shown]


def test_beside_synthetic_labels_a_banner_says_that_scores_are_not_comparable(client: TestClient) -> None:
    page = client.get("/leaderboards/2d-standard").text
    assert "WildScenes demo: the labels on this server are synthetic." in page
    assert set(texts('<td class="rank"', page)) == {DASH}


def test_without_ground_truth_a_board_says_so_and_the_papers_rows_are_ranked(
    make_world: Callable[..., World], open_client: Callable[[World], TestClient], sqlite_url: str
) -> None:
    page = open_client(make_world(sqlite_url, release=None)).get("/leaderboards/2d-standard").text
    assert "This server holds no ground truth for this track yet" in page
    assert texts('<td class="rank"', page) == ["1", "2", "3", "4", "5", "6"]


@pytest.mark.parametrize(("hidden", "said"), [(True, "The ground truth is hidden"), (False, "can be downloaded")])
def test_a_board_says_whether_its_labels_are_hidden(
    make_world: Callable[..., World],
    open_client: Callable[[World], TestClient],
    sqlite_url: str,
    open_release: Path,
    *,
    hidden: bool,
    said: str,
) -> None:
    world = make_world(sqlite_url) if hidden else make_world(sqlite_url, release=open_release)
    assert said in open_client(world).get("/leaderboards/2d-standard").text


def test_names_that_people_chose_cannot_become_markup(small_world: World, client: TestClient) -> None:
    small_world.scored(small_world.person(), method='"><img src=x>', public=True)
    for path in ("/", "/leaderboards/2d-standard"):
        page = client.get(path).text
        assert "<img src=x>" not in page
        assert "&#34;&gt;&lt;img src=x&gt;" in page
