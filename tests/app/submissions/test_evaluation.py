"""The scoring of one submission."""

from __future__ import annotations

import io
import zipfile
from collections.abc import Callable, Iterator
from dataclasses import replace
from datetime import timedelta
from typing import Any
from uuid import UUID

import pytest
from sqlalchemy import select

from app.submissions import claims, evaluation
from app.submissions.lifecycle import Stage, State
from app.submissions.models import Chunk, Score
from evaluator import SCORING_VERSION, __version__
from tests.app.world import NOON, World, at_once


@pytest.fixture
def world(make_world: Callable[..., World], database_url: str) -> World:
    """Ten frames on `2d-standard`, scored in chunks of three."""
    return make_world(database_url, chunk_frames=3)


def chunks(world: World, submission_id: UUID) -> list[tuple[int, int, list[str]]]:
    with world.wired.db.read() as session:
        mine = select(Chunk).where(Chunk.evaluation_id == world.evaluation(submission_id).id).order_by(Chunk.start)
        return [(row.start, row.length, row.frames) for row in session.scalars(mine)]


def run(world: World, submission_id: UUID, *, draining: Callable[[], bool] = lambda: False) -> None:
    evaluation.run(world.wired, world.evaluation(submission_id).id, draining=draining)


def after(calls: int, act: Callable[[], bool] = lambda: True) -> Callable[[], bool]:
    """False so many times, then what `act` says."""
    told: Iterator[bool] = iter([False] * calls)
    return lambda: next(told, None) is None and act()


def figures(world: World, submission_id: UUID) -> dict[str, Any]:
    return world.results(submission_id)


def without_one(data: bytes) -> bytes:
    """An archive whose first frame is missing."""
    out = io.BytesIO()
    with zipfile.ZipFile(io.BytesIO(data)) as whole, zipfile.ZipFile(out, "w") as part:
        for member in whole.namelist()[1:]:
            part.writestr(member, whole.read(member))
    return out.getvalue()


@pytest.mark.parametrize("track", ["2d-standard", "3d-standard"])
def test_a_perfect_submission_scores_one_in_every_class(world: World, track: str) -> None:
    submission_id = world.submit(world.person(), track=track, quality=1.0)
    world.clock.advance(5)
    run(world, submission_id)
    said = figures(world, submission_id)
    scored = [world.wired.tracks[track][0].names[i] for i in world.wired.tracks[track][1].scored]
    perfect = {"iou": 1.0, "precision": 1.0, "recall": 1.0, "f1": 1.0}
    assert (said["miou"], said["classes"]) == (1.0, dict.fromkeys(scored, perfect))
    found = world.evaluation(submission_id)
    assert (found.state, found.frames_done, found.frames_total, found.fruitless, found.attempts) == (
        Stage.SCORED,
        10,
        10,
        0,
        1,
    )
    assert (found.scoring, found.evaluator, found.groundtruth) == (SCORING_VERSION, __version__, said["groundtruth"])
    assert (found.created_at, found.started_at, found.finished_at) == (NOON, world.clock(), world.clock())
    assert (found.lease_until, found.error, found.problems, found.problems_total) == (None, None, [], 0)
    size = len(world.predictions(track, 1.0))
    assert world.events(submission_id) == [
        ("receiving", "receiving", "upload begun"),
        ("receiving", "queued", f"{size} bytes received"),
        ("queued", "running", "claimed, attempt 1"),
        ("running", "scored", "10 frames scored"),
    ]


def test_a_message_that_is_delivered_twice_scores_once(world: World) -> None:
    submission_id = world.scored(world.person())
    events = world.events(submission_id)
    run(world, submission_id)
    assert (world.events(submission_id), world.evaluation(submission_id).attempts) == (events, 1)


def test_workers_that_get_one_message_at_once_score_once(world: World) -> None:
    submission_id = world.submit(world.person())
    assert at_once([lambda: run(world, submission_id)] * 3) == [None] * 3
    assert world.evaluation(submission_id).attempts == 1
    assert [event[1] for event in world.events(submission_id)] == ["receiving", "queued", "running", "scored"]


def test_a_submission_with_problems_is_rejected_with_all_of_them_and_has_no_score(world: World) -> None:
    submission_id = world.scored(world.person(), data=without_one(world.predictions("2d-standard")))
    found = world.evaluation(submission_id)
    assert (world.submission(submission_id).state, found.state, found.problems_total) == (
        State.REJECTED,
        Stage.REJECTED,
        1,
    )
    [problem] = found.problems
    assert (problem["code"], set(problem)) == ("missing_frame", {"member", "code", "expected", "found", "hint"})
    assert world.events(submission_id)[-1] == ("running", "rejected", "1 problems")
    with world.wired.db.read() as session:
        assert session.get(Score, found.id) is None


def test_a_file_that_is_no_zip_is_rejected_as_such(world: World) -> None:
    submission_id = world.scored(world.person(), data=b"<html>")
    assert [one["code"] for one in world.evaluation(submission_id).problems] == ["not_a_zip"]


def test_a_worker_that_is_stopped_keeps_what_it_stored_and_gives_its_attempt_back(world: World) -> None:
    submission_id = world.submit(world.person())
    run(world, submission_id, draining=after(2))
    found = world.evaluation(submission_id)
    assert (found.state, found.frames_done, found.frames_total, found.fruitless) == (Stage.QUEUED, 6, 10, 0)
    assert [(start, length) for start, length, _ in chunks(world, submission_id)] == [(0, 3), (3, 3)]
    assert world.events(submission_id)[-1] == ("running", "queued", "the worker was stopped in an orderly way")


@pytest.mark.parametrize("chunk_frames", [3, 2, 4, 100])
def test_a_resumed_evaluation_gives_the_figures_of_one_that_was_never_stopped(world: World, chunk_frames: int) -> None:
    """Also when the host has changed the size of chunks in between."""
    who = world.person()
    whole, resumed = world.scored(who), world.submit(who)
    run(world, resumed, draining=after(2))
    kept = chunks(world, resumed)
    world.wired = replace(world.wired, settings=world.wired.settings.model_copy(update={"chunk_frames": chunk_frames}))
    run(world, resumed)
    assert world.submission(resumed).state is State.SCORED
    assert figures(world, resumed) == figures(world, whole)
    assert chunks(world, resumed)[:2] == kept
    frames = [name for _, _, names in chunks(world, resumed) for name in names]
    assert frames == [name for _, _, names in chunks(world, whole) for name in names]


def test_frames_that_one_attempt_has_stored_are_not_counted_again(world: World) -> None:
    submission_id = world.submit(world.person())
    run(world, submission_id, draining=after(3))
    asked: list[int] = []
    run(world, submission_id, draining=lambda: bool(asked.append(1)))  # type: ignore[func-returns-value]
    assert len(asked) == 1  # once before the only chunk that was left


def test_a_worker_that_lost_its_claim_stops_and_writes_nothing_more(world: World) -> None:
    submission_id = world.submit(world.person())

    def another_takes_over() -> bool:
        world.clock.advance(world.wired.settings.lease_seconds + 1)
        held = claims.claim(
            world.wired.db,
            world.evaluation(submission_id).id,
            worker="another",
            now=world.clock(),
            lease=timedelta(seconds=30),
        )
        assert held is not None
        return False

    run(world, submission_id, draining=after(1, another_takes_over))
    found = world.evaluation(submission_id)
    assert (found.state, found.worker, found.attempts, found.frames_done) == (Stage.RUNNING, "another", 2, 3)
    assert len(chunks(world, submission_id)) == 1


def test_a_fault_of_ours_counts_as_an_attempt_and_its_details_stay_with_us(world: World) -> None:
    submission_id = world.submit(world.person())
    world.wired.storage.delete(world.submission(submission_id).upload_key or "")
    with pytest.raises(FileNotFoundError):
        run(world, submission_id)
    found = world.evaluation(submission_id)
    assert (found.state, found.fruitless) == (Stage.QUEUED, 1)
    assert found.error == f"FileNotFoundError: {world.submission(submission_id).upload_key}"
    assert world.events(submission_id)[-1] == ("running", "queued", "FileNotFoundError")


def test_what_is_odd_about_a_submission_is_kept_as_a_warning(world: World) -> None:
    data = io.BytesIO(world.predictions("2d-standard"))
    with zipfile.ZipFile(data, "a") as archive:
        archive.writestr("README.txt", "hello")
    submission_id = world.scored(world.person(), data=data.getvalue())
    assert [(one["member"], one["code"]) for one in world.evaluation(submission_id).warnings] == [
        ("README.txt", "unknown_member")
    ]
