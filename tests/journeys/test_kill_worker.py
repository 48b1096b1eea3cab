"""Workers and brokers are killed in the middle of a submission: it is scored once, from where it stopped."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest
from sqlalchemy import Engine, create_engine, text
from sqlalchemy.pool import NullPool

from app.database import Database
from app.tracks.service import import_release
from evaluator.benchmark import Benchmark

if TYPE_CHECKING:
    from tests.conftest import Broker, Start
    from tests.journeys.conftest import MakeServer, Noise, Server

TRACK = "2d-standard"
FRAMES = 120
SETTINGS = {
    "lease_seconds": 3,
    "heartbeat_seconds": 1,
    "sweep_seconds": 1,
    "resend_seconds": 3,
    "chunk_frames": 2,
    "scoring_threads": 1,
}


@pytest.fixture(scope="module")
def noise(make_noise: Callable[..., Noise]) -> Noise:
    return make_noise(FRAMES, (480, 360))


@pytest.fixture(scope="module")
def archive(noise: Noise, tmp_path_factory: pytest.TempPathFactory) -> Path:
    return noise.zip(tmp_path_factory.mktemp("long") / "long.zip")


@dataclass
class Stack:
    """PostgreSQL, a broker, the web and workers, each a process of its own."""

    server: Server
    broker: Broker
    engine: Engine
    folder: Path
    start: Start
    poll: Callable[..., Any]
    workers: list[subprocess.Popen[bytes]] = field(default_factory=list)

    def start_worker(self) -> subprocess.Popen[bytes]:
        """Start a worker in a session of its own."""
        told = [sys.executable, "-m", "celery", "-A", "workers.celery", "worker", "--concurrency", "1"]
        quiet = ["--loglevel", "info", "--without-gossip", "--without-mingle", "--queues", "scoring"]
        environment = {**os.environ, **self.server.environment}
        log = self.folder / "worker.log"
        self.workers.append(self.start([*told, *quiet], log, env=environment, start_new_session=True))
        return self.workers[-1]

    def kill_worker(self) -> None:
        """Kill the newest worker with its children, at once."""
        os.killpg(self.workers[-1].pid, signal.SIGKILL)
        self.workers[-1].wait()

    def row(self, query: str) -> Any:
        """The one row of a query."""
        with self.engine.connect() as connection:
            return connection.execute(text(query)).one()

    def chunks(self) -> dict[int, str]:
        """Every stored chunk with the transaction that wrote it."""
        with self.engine.connect() as connection:
            rows = connection.execute(text("SELECT start, xmin::text FROM chunks ORDER BY start"))
            return {row[0]: row[1] for row in rows}

    def stop_in_the_middle(self) -> int:
        """Stop the child that scores, between its first chunk and its last; the answer is its process id."""

        def begun() -> Any:
            return self.row("SELECT max(frames_done), max(worker) FROM evaluations WHERE state = 'running'")

        done = self.poll(lambda: (begun()[0] or 0) and begun(), pause=0.002, said=self.said)
        child = int(done[1].rpartition(":")[2])
        os.kill(child, signal.SIGSTOP)
        frames = self.row("SELECT frames_done FROM evaluations WHERE state = 'running'")[0]
        assert 0 < frames < FRAMES
        return child

    def said(self) -> str:
        """What the workers wrote last."""
        return (self.folder / "worker.log").read_text("utf-8", "replace")[-4000:]


@pytest.fixture
def stack(
    make_server: MakeServer,
    postgres_url: str,
    brokers: Callable[[], Broker],
    noise: Noise,
    wildscenes: Benchmark,
    start_program: Start,
    poll: Callable[..., Any],
    tmp_path: Path,
) -> Iterator[Stack]:
    """The service as it is hosted, with nothing of `wildscenes serve`."""
    broker = brokers()
    server = make_server(tmp_path, database_url=postgres_url, broker_url=broker.url, **SETTINGS)
    db = Database(postgres_url, pooled=False)
    import_release(db, tmp_path / "groundtruth", noise.groundtruth, wildscenes, now=datetime.now(UTC))
    engine = create_engine(postgres_url, poolclass=NullPool)
    made = Stack(server, broker, engine, tmp_path, start_program, poll)
    web = [sys.executable, "-m", "uvicorn", "app.asgi:app", "--port", server.url.rpartition(":")[2]]
    server.process = start_program(web, tmp_path / "web.log", env={**os.environ, **server.environment})
    try:
        made.start_worker()
        poll(server.answers, said=(tmp_path / "web.log").read_text)
        yield made
    finally:
        for worker in made.workers:
            if worker.poll() is None:
                os.killpg(worker.pid, signal.SIGKILL)
            worker.wait()
        server.process.kill()
        server.process.wait()
        broker.kill()


def check_scored_once(stack: Stack, noise: Noise, archive: Path, sent: str, token: str, attempts: int) -> None:
    """The submission has one evaluation and one score, in the digits of a run that nothing disturbed."""
    said = stack.server.settled(sent, token)
    assert said["state"] == "scored", (said, stack.said())
    counts = stack.row("SELECT (SELECT count(*) FROM evaluations), (SELECT count(*) FROM scores)")
    assert tuple(counts) == (1, 1)
    assert stack.row("SELECT attempts, fruitless, frames_done, state FROM evaluations") == (
        attempts,
        0,
        FRAMES,
        "scored",
    )
    assert list(stack.chunks()) == list(range(0, FRAMES, 2))
    local = archive.with_suffix(".json")
    stack.server.cli("evaluate", archive, "--track", TRACK, "--groundtruth", noise.groundtruth, "--json", local)
    assert stack.row("SELECT results FROM scores")[0] == json.loads(local.read_text("utf-8"))
    events = stack.server.get(f"/submissions/{sent}", token).text.count("frames scored")
    assert events == 1


def send(stack: Stack, archive: Path) -> tuple[str, str]:
    token = stack.server.token("ada")
    return stack.server.send(archive, token, track=TRACK, method="Long"), token


@pytest.mark.parametrize("killed", ["worker and child", "child only"])
def test_what_was_killed_in_the_middle_is_resumed_and_scored_once(
    stack: Stack, noise: Noise, archive: Path, killed: str
) -> None:
    sent, token = send(stack, archive)
    child = stack.stop_in_the_middle()
    before = stack.chunks()
    if killed == "child only":
        os.kill(child, signal.SIGKILL)
    else:
        stack.kill_worker()
        stack.start_worker()
    check_scored_once(stack, noise, archive, sent, token, attempts=2)
    assert before.items() <= stack.chunks().items()  # not a chunk was counted again
    assert stack.workers[-1].poll() is None


def test_a_broker_that_forgets_everything_loses_no_work(stack: Stack, noise: Noise, archive: Path) -> None:
    sent, token = send(stack, archive)
    child = stack.stop_in_the_middle()
    stack.broker.kill()
    waiting = stack.server.send(archive, token, track=TRACK, method="Sent while the broker is away")
    stack.broker.forget()
    stack.broker.start()
    os.kill(child, signal.SIGCONT)
    states = [stack.server.settled(one, token)["state"] for one in (sent, waiting)]
    assert states == ["scored", "scored"], stack.said()
    counts = stack.row("SELECT (SELECT count(*) FROM evaluations), (SELECT count(*) FROM scores)")
    assert tuple(counts) == (2, 2)
    figures = stack.row(
        "SELECT count(DISTINCT results::text), min(frames_done) FROM scores JOIN evaluations ON id = evaluation_id"
    )
    assert tuple(figures) == (1, FRAMES)


def test_a_worker_that_is_asked_to_stop_gives_its_work_back(stack: Stack, noise: Noise, archive: Path) -> None:
    sent, token = send(stack, archive)
    child = stack.stop_in_the_middle()
    worker = stack.workers[-1]
    before = stack.chunks()
    worker.send_signal(signal.SIGTERM)
    stack.poll(lambda: "shutdown" in stack.said().lower())
    os.kill(child, signal.SIGCONT)
    assert worker.wait(60) == 0, stack.said()
    asked = "SELECT state, attempts, fruitless, lease_until, error FROM evaluations"
    assert tuple(stack.row(asked)) == ("queued", 1, 0, None, "the worker was stopped in an orderly way")
    assert stack.server.get(f"/api/v1/submissions/{sent}", token).json()["state"] == "queued"
    stack.start_worker()
    check_scored_once(stack, noise, archive, sent, token, attempts=2)
    assert before.items() <= stack.chunks().items()
