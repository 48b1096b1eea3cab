"""Boards as the database has them."""

from __future__ import annotations

from collections.abc import Callable
from datetime import timedelta
from pathlib import Path
from typing import Any

import pytest

from app.errors import NotFound
from app.leaderboards.service import board
from app.submissions import service
from app.submissions.disclosure import rounded
from app.submissions.lifecycle import Stage
from app.submissions.models import Evaluation, Score
from tests.app.world import NOON, World


def ours(world: World, track: str = "2d-standard") -> list[tuple[int | None, str, str, tuple[int, int] | None]]:
    return [(row.rank, row.method, row.team, row.attempt) for row in board(world.wired, track).rows if not row.baseline]


def test_published_submissions_stand_on_their_board_ranked_by_miou(world: World) -> None:
    ada, bob = world.person("ada@example.org"), world.person("bob@example.org")
    world.scored(ada, method="Sketch", quality=0.5, public=True)
    world.scored(bob, method="Careful", quality=0.9, public=True)
    world.scored(bob, method="Private", quality=1.0)
    world.scored(bob, method="Elsewhere", track="2d-val", public=True)
    world.submit(bob, method="Waiting", public=True)
    assert ours(world) == [(1, "Careful", "bob", (1, 1)), (2, "Sketch", "ada", (1, 1))]
    assert ours(world, "3d-standard") == []


def test_a_row_says_when_it_was_submitted_and_what_may_be_shown(world: World) -> None:
    submission_id = world.scored(world.person(), track="3d-standard", public=True)
    kept = world.results(submission_id)
    [row] = [one for one in board(world.wired, "3d-standard").rows if not one.baseline]
    assert (row.submission_id, row.submitted_at, row.year) == (submission_id, NOON, None)
    assert (row.shown.miou, row.shown.official) == (rounded(kept["miou"], 4), rounded(kept["miou_13"], 4))
    assert row.shown.classes == {name: rounded(one["iou"], 3) for name, one in kept["classes"].items()}


def test_the_last_published_attempt_of_a_method_stands_even_when_it_is_worse(world: World) -> None:
    who = world.person()
    best = world.scored(who, quality=0.95, public=True)
    world.clock.advance(60)
    world.scored(who, quality=0.99)
    world.clock.advance(60)
    last = world.scored(who, quality=0.6)
    service.publish(world.wired, last, who=who)
    assert [row.submission_id for row in board(world.wired, "2d-standard").rows if not row.baseline] == [last]
    assert ours(world) == [(1, "Forest", "ada", (3, 3))]
    service.hide(world.wired, last)
    assert [row.submission_id for row in board(world.wired, "2d-standard").rows if not row.baseline] == [best]
    assert ours(world) == [(1, "Forest", "ada", (1, 3))]


def test_equal_figures_share_a_rank_and_the_earlier_submission_is_first(world: World) -> None:
    ada, bob, eve = (world.person(f"{name}@example.org") for name in ("ada", "bob", "eve"))
    for who, quality in ((bob, 0.8), (ada, 0.8), (eve, 0.5)):
        world.scored(who, quality=quality, public=True)
        world.clock.advance(60)
    assert [(rank, team) for rank, _, team, _ in ours(world)] == [(1, "bob"), (1, "ada"), (3, "eve")]


def test_beside_synthetic_labels_the_papers_rows_have_no_rank(world: World) -> None:
    world.scored(world.person(), quality=0.2, public=True)
    found = board(world.wired, "2d-standard")
    assert not found.comparable
    assert [row.rank for row in found.rows if row.baseline] == [None] * 6
    assert found.rows[0].rank == 1
    paper = [row.shown.miou for row in found.rows if row.baseline]
    assert paper == sorted(paper, key=lambda miou: -(miou or 0))


def test_without_ground_truth_the_papers_rows_are_ranked(make_world: Callable[..., World], sqlite_url: str) -> None:
    world = make_world(sqlite_url, release=None)
    found = board(world.wired, "2d-standard")
    assert (found.facts, found.frames, [row.rank for row in found.rows]) == (None, 0, [1, 2, 3, 4, 5, 6])
    assert {(row.year, row.team, row.baseline) for row in found.rows} == {(2025, "WildScenes", True)}


def test_the_practice_list_has_no_ranks(world: World) -> None:
    ada, bob = world.person("ada@example.org"), world.person("bob@example.org")
    world.scored(ada, track="2d-val", quality=0.5, public=True)
    world.scored(bob, track="2d-val", quality=0.9, public=True)
    assert [(rank, team) for rank, _, team, _ in ours(world, "2d-val")] == [(None, "bob"), (None, "ada")]


def test_a_new_evaluation_replaces_the_figures_once_it_is_scored_and_not_before(world: World) -> None:
    submission_id = world.scored(world.person(), public=True)
    first = world.evaluation(submission_id)
    again: dict[str, Any] = {
        "submission_id": submission_id,
        "groundtruth": first.groundtruth,
        "evaluator": "",
        "first": False,
    }
    later = Evaluation(scoring=99, state=Stage.RUNNING, created_at=NOON + timedelta(days=1), **again)
    with world.wired.db.begin() as session:
        session.add(later)
    before = [row.shown.miou for row in board(world.wired, "2d-standard").rows if not row.baseline]
    assert before == [rounded(world.results(submission_id)["miou"], 4)]
    with world.wired.db.begin() as session:
        results = world.results(submission_id) | {"miou": 0.125}
        session.add(Score(evaluation_id=later.id, miou=0.125, results=results))
    assert [row.shown.miou for row in board(world.wired, "2d-standard").rows if not row.baseline] == [0.125]


def test_a_board_that_does_not_exist_is_not_found_and_the_others_are_named(small_world: World) -> None:
    with pytest.raises(NotFound) as caught:
        board(small_world.wired, "4d")
    assert (caught.value.code, caught.value.detail.split("; ")[0]) == ("unknown_track", "there is no track '4d'")
    assert all(track in caught.value.detail for track in small_world.wired.tracks)


def test_on_an_open_release_figures_stand_in_full(
    make_world: Callable[..., World], sqlite_url: str, open_release: Path
) -> None:
    world = make_world(sqlite_url, release=open_release)
    submission_id = world.scored(world.person(), public=True)
    [row] = [one for one in board(world.wired, "2d-standard").rows if not one.baseline]
    kept = world.results(submission_id)
    assert row.shown.miou == kept["miou"]
    assert row.shown.classes == {name: one["iou"] for name, one in kept["classes"].items()}


def test_figures_of_another_ground_truth_stand_on_no_board(world: World) -> None:
    submission_id = world.scored(world.person(), public=True)
    assert len(ours(world, "2d-standard")) == 1
    with world.wired.db.begin() as session:
        session.get_one(Evaluation, world.evaluation(submission_id).id).groundtruth = "another"
    assert ours(world, "2d-standard") == []
