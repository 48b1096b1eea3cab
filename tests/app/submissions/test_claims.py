"""Who may work on an evaluation."""

from __future__ import annotations

import time
from collections.abc import Callable
from datetime import timedelta
from uuid import UUID, uuid4

import pytest

from app.submissions import claims
from app.submissions.claims import Claim, LostClaim
from app.submissions.lifecycle import MAX_FRUITLESS, Stage, State
from app.submissions.models import Evaluation, Submission
from tests.app.world import NOON, World, at_once

LEASE = timedelta(seconds=30)


@pytest.fixture
def waiting(world: World) -> UUID:
    """A submission that waits."""
    return world.submit(world.person(), data=b"zip")


def claim(world: World, submission_id: UUID, worker: str = "w") -> Claim | None:
    evaluation_id = world.evaluation(submission_id).id
    return claims.claim(world.wired.db, evaluation_id, worker=worker, now=world.clock(), lease=LEASE)


def must_claim(world: World, submission_id: UUID) -> Claim:
    held = claim(world, submission_id)
    assert held is not None
    return held


def write(world: World, held: Claim, **values: object) -> None:
    with world.wired.db.begin() as session:
        claims.write(session, held, **values)


def release(world: World, held: Claim, *, counts: bool) -> None:
    claims.release(world.wired.db, held, now=world.clock(), reason="ValueError: no\nsecret", counts=counts)


def test_a_claim_marks_who_works_and_for_how_long(world: World, waiting: UUID) -> None:
    held = claim(world, waiting, worker="host:1")
    found = world.evaluation(waiting)
    assert held == Claim(found.id, 1)
    assert (found.state, found.attempts, found.fruitless, found.worker, found.started_at, found.lease_until) == (
        Stage.RUNNING,
        1,
        1,
        "host:1",
        NOON,
        NOON + LEASE,
    )
    assert world.submission(waiting).state is State.RUNNING
    assert world.events(waiting)[-1] == ("queued", "running", "claimed, attempt 1")


def test_of_threads_that_claim_an_evaluation_at_once_one_wins(world: World, waiting: UUID) -> None:
    evaluation_id = world.evaluation(waiting).id
    got = at_once([lambda: claim(world, waiting)] * 4)
    assert sorted(map(str, got)) == sorted([str(Claim(evaluation_id, 1)), "None", "None", "None"])
    assert world.evaluation(waiting).attempts == 1


def test_an_evaluation_whose_worker_is_alive_cannot_be_claimed(world: World, waiting: UUID) -> None:
    claim(world, waiting)
    world.clock.advance(30)
    assert claim(world, waiting) is None


def test_an_evaluation_whose_worker_fell_silent_can_be_claimed_again(world: World, waiting: UUID) -> None:
    held = must_claim(world, waiting)
    world.clock.advance(30.001)
    assert claim(world, waiting) == Claim(held.evaluation_id, 2)


def test_of_threads_that_claim_a_silent_workers_evaluation_one_wins(world: World, waiting: UUID) -> None:
    claim(world, waiting)
    world.clock.advance(31)
    got = at_once([lambda: claim(world, waiting)] * 4)
    assert [one for one in got if one is not None] == [Claim(world.evaluation(waiting).id, 2)]


def test_an_evaluation_that_is_unknown_or_over_cannot_be_claimed(world: World, waiting: UUID) -> None:
    assert claims.claim(world.wired.db, uuid4(), worker="w", now=world.clock(), lease=LEASE) is None
    write(world, must_claim(world, waiting), state=Stage.SCORED)
    world.clock.advance(1e6)
    assert claim(world, waiting) is None


def test_an_old_attempt_loses_its_claim_and_writes_nothing(world: World, waiting: UUID) -> None:
    old = must_claim(world, waiting)
    world.clock.advance(31)
    new = must_claim(world, waiting)
    with pytest.raises(LostClaim):
        write(world, old, frames_done=99)
    assert world.evaluation(waiting).frames_done == 0
    with pytest.raises(LostClaim):
        release(world, old, counts=True)
    assert world.evaluation(waiting).state is Stage.RUNNING
    write(world, new, frames_done=3)
    assert world.evaluation(waiting).frames_done == 3


def test_nothing_of_a_transaction_is_kept_when_its_claim_is_lost(world: World, waiting: UUID) -> None:
    old = must_claim(world, waiting)
    world.clock.advance(31)
    must_claim(world, waiting)

    def change_both() -> None:
        with world.wired.db.begin() as session:
            session.get_one(Submission, waiting).encoding = "raw19"
            session.flush()
            claims.write(session, old, frames_done=99)

    with pytest.raises(LostClaim):
        change_both()
    assert world.submission(waiting).encoding == "benchmark"


def test_nobody_writes_to_an_evaluation_that_is_over(world: World, waiting: UUID) -> None:
    held = must_claim(world, waiting)
    write(world, held, state=Stage.SCORED)
    with pytest.raises(LostClaim):
        write(world, held, frames_done=1)


def test_after_three_attempts_that_stored_nothing_there_is_no_fourth(world: World, waiting: UUID) -> None:
    for _ in range(MAX_FRUITLESS):
        must_claim(world, waiting)
        world.clock.advance(31)
    assert claim(world, waiting) is None


def test_a_claim_given_back_after_a_fault_counts_and_says_what_happened_without_its_details(
    world: World, waiting: UUID
) -> None:
    release(world, must_claim(world, waiting), counts=True)
    found = world.evaluation(waiting)
    assert (found.state, found.fruitless, found.lease_until, found.sent_at, found.error) == (
        Stage.QUEUED,
        1,
        None,
        None,
        "ValueError: no\nsecret",
    )
    assert world.events(waiting)[-1] == ("running", "queued", "ValueError")


def test_a_claim_given_back_by_a_stopped_worker_does_not_count(world: World, waiting: UUID) -> None:
    for _ in range(2 * MAX_FRUITLESS):
        release(world, must_claim(world, waiting), counts=False)
    assert (world.evaluation(waiting).fruitless, world.evaluation(waiting).attempts) == (0, 2 * MAX_FRUITLESS)


def test_a_stopped_worker_that_stored_something_earns_no_further_attempt(world: World, waiting: UUID) -> None:
    held = must_claim(world, waiting)
    write(world, held, fruitless=0)
    release(world, held, counts=False)
    assert world.evaluation(waiting).fruitless == 0


def test_a_move_that_the_table_lacks_is_refused_and_leaves_no_event(world: World, waiting: UUID) -> None:
    before = world.events(waiting)
    with (
        pytest.raises(ValueError, match="^a submission cannot go from queued to scored$"),
        world.wired.db.begin() as session,
    ):
        claims.move(session, session.get_one(Submission, waiting), State.SCORED, now=NOON, reason="")
    assert (world.submission(waiting).state, world.events(waiting)) == (State.QUEUED, before)


def test_a_later_evaluation_does_not_move_its_submission(world: World, waiting: UUID) -> None:
    later = Evaluation(
        submission_id=waiting,
        scoring=99,
        groundtruth="other",
        evaluator="",
        first=False,
        state=Stage.QUEUED,
        created_at=NOON,
    )
    with world.wired.db.begin() as session:
        session.add(later)
    assert claims.claim(world.wired.db, later.id, worker="w", now=NOON, lease=LEASE) == Claim(later.id, 1)
    assert world.submission(waiting).state is State.QUEUED


def until(holds: Callable[[], bool]) -> None:
    deadline = time.monotonic() + 20
    while not holds():
        assert time.monotonic() < deadline
        time.sleep(0.005)


def test_a_heartbeat_keeps_the_claim_of_a_worker_that_lives(
    make_world: Callable[..., World], database_url: str
) -> None:
    world = make_world(database_url, heartbeat_seconds=0.01, lease_seconds=30)
    waiting = world.submit(world.person(), data=b"zip")
    with claims.heartbeat(world.wired, must_claim(world, waiting)) as lost:
        world.clock.advance(29)
        until(lambda: world.evaluation(waiting).lease_until == world.clock() + LEASE)
        world.clock.advance(29)
        assert claim(world, waiting) is None
        assert not lost.is_set()


def test_a_heartbeat_tells_the_worker_that_its_claim_is_lost(
    make_world: Callable[..., World], database_url: str
) -> None:
    world = make_world(database_url, heartbeat_seconds=0.01, lease_seconds=30)
    waiting = world.submit(world.person(), data=b"zip")
    held = must_claim(world, waiting)
    with world.wired.db.begin() as session:
        session.get_one(Evaluation, held.evaluation_id).attempts = 2
    with claims.heartbeat(world.wired, held) as lost:
        assert lost.wait(20)
    assert world.evaluation(waiting).lease_until == NOON + LEASE
