"""The queue of evaluations."""

from __future__ import annotations

import base64
import json
import socket
import time
from collections.abc import Callable
from pathlib import Path
from typing import Protocol
from uuid import uuid4

import pytest
from redis import Redis

from app.queue import Queue, broker_url, make_celery
from app.settings import Settings


class Broker(Protocol):
    """What the fixture `brokers` makes."""

    url: str
    socket: Path


def test_a_message_names_the_task_and_the_evaluation_and_nothing_else(brokers: Callable[[], Broker]) -> None:
    broker, evaluation_id = brokers(), uuid4()
    assert Queue(Settings(broker_url=broker.url)).send(evaluation_id)
    with Redis(unix_socket_path=str(broker.socket)) as client:
        [raw] = client.lrange("scoring", 0, -1)
    message = json.loads(raw)
    assert message["headers"]["task"] == "wildscenes.evaluate"
    assert json.loads(base64.b64decode(message["body"]))[:2] == [[str(evaluation_id)], {}]


@pytest.mark.parametrize("url", ["redis+socket:///nonexistent/broker.sock", "redis://127.0.0.1:1/0"])
def test_when_nobody_listens_one_quick_try_is_made(url: str) -> None:
    queue = Queue(Settings(broker_url=url))
    started = time.monotonic()
    assert [queue.send(uuid4()) for _ in range(3)] == [False] * 3
    assert time.monotonic() - started < 3


def test_a_broker_that_accepts_and_says_nothing_is_given_a_second(short_folder: Path) -> None:
    with socket.socket(socket.AF_UNIX) as silent:
        path = short_folder / "silent.sock"
        silent.bind(str(path))
        silent.listen(5)
        started = time.monotonic()
        assert not Queue(Settings(broker_url=f"redis+socket://{path}")).send(uuid4())
        assert 0.5 < time.monotonic() - started < 4


def test_the_embedded_brokers_socket_is_in_the_home_folder(tmp_path: Path) -> None:
    assert broker_url(Settings(home=tmp_path)) == f"redis+socket://{tmp_path}/broker.sock"


def test_workers_forget_nothing_and_keep_no_results() -> None:
    """Settings without which a killed worker or broker loses work."""
    conf = make_celery(Settings(broker_url="redis://broker")).conf
    assert {
        name: conf[name]
        for name in (
            "task_acks_late",
            "task_reject_on_worker_lost",
            "task_ignore_result",
            "result_backend",
            "accept_content",
            "worker_prefetch_multiplier",
            "worker_cancel_long_running_tasks_on_connection_loss",
        )
    } == {
        "task_acks_late": True,
        "task_reject_on_worker_lost": False,
        "task_ignore_result": True,
        "result_backend": None,
        "accept_content": ["json"],
        "worker_prefetch_multiplier": 1,
        "worker_cancel_long_running_tasks_on_connection_loss": False,
    }
