"""What repeats until it succeeds."""

from __future__ import annotations

import base64
import json
from collections.abc import Callable
from datetime import timedelta
from functools import partial
from pathlib import Path
from typing import Protocol
from uuid import UUID

import pytest
from redis import Redis

from app.errors import Conflict
from app.submissions import claims, evaluation, service
from app.submissions.lifecycle import MAX_FRUITLESS, Stage, State
from app.submissions.models import Evaluation
from app.submissions.sweeper import sweep
from tests.app.world import World, at_once

HALF_A_DAY = timedelta(hours=12)


class Broker(Protocol):
    """What the fixture `brokers` makes."""

    url: str
    socket: Path

    def start(self) -> None: ...
    def kill(self) -> None: ...


@pytest.fixture(scope="module")
def shared_broker(brokers: Callable[[], Broker]) -> Broker:
    return brokers()


@pytest.fixture
def broker(shared_broker: Broker) -> Broker:
    """A broker of this module's own, empty."""
    with Redis(unix_socket_path=str(shared_broker.socket)) as client:
        client.flushall()
    return shared_broker


@pytest.fixture
def heard(make_world: Callable[..., World], database_url: str, broker: Broker) -> World:
    """A service whose queue can be looked into."""
    return make_world(database_url, broker_url=broker.url)


def queued(broker: Broker) -> list[UUID]:
    """The evaluations whose messages wait, the oldest first."""
    with Redis(unix_socket_path=str(broker.socket)) as client:
        waiting = [json.loads(raw) for raw in client.lrange("scoring", 0, -1)][::-1]
    return [UUID(json.loads(base64.b64decode(one["body"]))[0][0]) for one in waiting]


def claim(world: World, submission_id: UUID) -> None:
    evaluation_id = world.evaluation(submission_id).id
    assert claims.claim(world.wired.db, evaluation_id, worker="w", now=world.clock(), lease=HALF_A_DAY)


def test_a_received_submission_is_sent_once_and_again_only_after_a_while_but_then_for_ever(
    heard: World, broker: Broker
) -> None:
    submission_id = heard.submit(heard.person(), data=b"zip")
    mine = heard.evaluation(submission_id).id
    assert queued(broker) == [mine]
    for rounds in range(2, 6):
        heard.clock.advance(heard.wired.settings.resend_seconds)
        sweep(heard.wired)
        assert queued(broker) == [mine] * (rounds - 1)
        heard.clock.advance(0.001)
        sweep(heard.wired)
        sweep(heard.wired)
        assert queued(broker) == [mine] * rounds
    found = heard.evaluation(submission_id)
    assert (found.state, found.attempts, found.fruitless) == (Stage.QUEUED, 0, 0)


def test_sweepers_of_several_workers_send_a_waiting_evaluation_once(heard: World, broker: Broker) -> None:
    submission_id = heard.submit(heard.person(), data=b"zip")
    heard.clock.advance(31)
    assert at_once([lambda: sweep(heard.wired)] * 4) == [0] * 4
    assert queued(broker) == [heard.evaluation(submission_id).id] * 2


def test_while_the_broker_is_away_a_submission_waits_and_is_sent_once_it_is_back(heard: World, broker: Broker) -> None:
    who = heard.person()
    broker.kill()
    try:
        submissions = [heard.submit(who, data=b"zip") for _ in range(2)]
        for _ in range(4):
            heard.clock.advance(31)
            sweep(heard.wired)
        assert [heard.evaluation(one).state for one in submissions] == [Stage.QUEUED] * 2
    finally:
        broker.start()
    assert queued(broker) == []
    heard.clock.advance(31)
    sweep(heard.wired)
    assert sorted(queued(broker)) == sorted(heard.evaluation(one).id for one in submissions)


def test_the_work_of_a_silent_worker_is_sent_to_another(heard: World, broker: Broker) -> None:
    submission_id = heard.submit(heard.person(), data=b"zip")
    mine = heard.evaluation(submission_id).id
    claims.claim(heard.wired.db, mine, worker="w", now=heard.clock(), lease=timedelta(seconds=30))
    heard.clock.advance(31)
    sweep(heard.wired)
    assert queued(broker) == [mine, mine]


def test_the_work_of_a_worker_that_lives_is_left_alone(heard: World, broker: Broker) -> None:
    submission_id = heard.submit(heard.person(), data=b"zip")
    claim(heard, submission_id)
    heard.clock.advance(3600)
    sweep(heard.wired)
    assert queued(broker) == [heard.evaluation(submission_id).id]


def test_a_scored_submission_is_never_sent_again(heard: World, broker: Broker) -> None:
    heard.scored(heard.person())
    heard.clock.advance(1e6)
    assert sweep(heard.wired) == 0
    assert len(queued(broker)) == 1


def test_what_waits_for_too_long_is_counted_for_workers_that_hear_nothing(world: World) -> None:
    who = world.person()
    for _ in range(2):
        world.submit(who, data=b"zip")
    world.clock.advance(world.wired.settings.deaf_seconds)
    assert sweep(world.wired) == 0
    world.clock.advance(0.001)
    assert sweep(world.wired) == 2


@pytest.mark.parametrize("end", ["crashes", "falls silent"])
def test_after_three_attempts_that_stored_nothing_it_has_failed_and_says_so(world: World, end: str) -> None:
    submission_id = world.submit(world.person())
    world.wired.storage.delete(world.submission(submission_id).upload_key or "")
    for _ in range(MAX_FRUITLESS):
        sweep(world.wired)
        assert world.submission(submission_id).state is not State.FAILED
        if end == "crashes":
            with pytest.raises(FileNotFoundError):
                evaluation.run(world.wired, world.evaluation(submission_id).id)
        else:
            claim(world, submission_id)
            world.clock.advance(86400)
    sweep(world.wired)
    found = world.evaluation(submission_id)
    assert (found.state, found.finished_at, found.lease_until) == (Stage.FAILED, world.clock(), None)
    last = "queued" if end == "crashes" else "running"
    assert world.events(submission_id)[-1] == (last, "failed", "3 attempts in a row stored nothing")
    evaluation.run(world.wired, found.id)
    assert world.submission(submission_id).state is State.FAILED


def test_the_third_attempt_may_take_its_time(world: World) -> None:
    submission_id = world.submit(world.person(), data=b"zip")
    for _ in range(MAX_FRUITLESS):
        world.clock.advance(86400)
        claim(world, submission_id)
    sweep(world.wired)
    assert world.submission(submission_id).state is State.RUNNING


def test_a_failed_submission_that_is_run_again_starts_afresh_and_is_scored(heard: World, broker: Broker) -> None:
    submission_id = heard.submit(heard.person())
    for _ in range(MAX_FRUITLESS):
        claim(heard, submission_id)
        heard.clock.advance(86400)
    sweep(heard.wired)
    service.rerun(heard.wired, submission_id)
    mine = heard.evaluation(submission_id)
    assert (mine.state, mine.fruitless, mine.sent_at) == (Stage.QUEUED, 0, heard.clock())
    assert queued(broker) == [mine.id] * 2
    evaluation.run(heard.wired, mine.id)
    assert [event[1] for event in heard.events(submission_id)][-4:] == ["failed", "queued", "running", "scored"]


def test_an_upload_that_fell_silent_is_given_up(world: World) -> None:
    begun = world.begin(world.person())
    world.clock.advance(world.wired.settings.receiving_seconds)
    sweep(world.wired)
    assert world.submission(begun.id).state is State.RECEIVING
    world.clock.advance(0.001)
    sweep(world.wired)
    found = world.submission(begun.id)
    assert (found.state, found.deadline) == (State.CANCELLED, None)
    assert world.events(begun.id)[-1] == ("receiving", "cancelled", "the upload fell silent")


def test_an_upload_whose_bytes_still_come_is_not_given_up(world: World) -> None:
    begun = world.begin(world.person())
    for _ in range(3):
        world.clock.advance(200)
        service.still_receiving(world.wired, begun.id)
        sweep(world.wired)
    assert world.submission(begun.id).state is State.RECEIVING


def test_bytes_that_arrive_after_their_upload_was_given_up_are_refused(world: World) -> None:
    begun = world.begin(world.person())
    world.clock.advance(301)
    sweep(world.wired)
    with pytest.raises(Conflict):
        service.still_receiving(world.wired, begun.id)
    with pytest.raises(Conflict) as caught:
        world.arrive(begun, b"zip")
    assert caught.value.detail == "this upload was given up; send it again"
    assert world.submission(begun.id).state is State.CANCELLED
    with world.wired.db.read() as session:
        assert session.query(Evaluation).count() == 0


def test_arriving_and_being_given_up_at_once_ends_in_one_of_the_two(world: World) -> None:
    who = world.person()
    for _ in range(4):
        begun = world.begin(who)
        world.clock.advance(301)
        race: list[Callable[[], object]] = [partial(world.arrive, begun, b"zip"), partial(sweep, world.wired)]
        got = at_once(race)
        state = world.submission(begun.id).state
        assert (state, type(got[0])) in [(State.QUEUED, type(None)), (State.CANCELLED, Conflict)]
