"""What the queue may ask a worker for."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

from app.queue import EVALUATE, make_celery
from app.settings import Settings

ROOT = Path(__file__).parents[2]


def run(code: str, home: Path, **environment: str) -> str:
    """What a fresh Python prints: a worker's module is set up once in a process, from its environment."""
    done = subprocess.run(
        [sys.executable, "-W", "error", "-c", code],
        cwd=ROOT,
        env={**os.environ, "WILDSCENES_HOME": str(home), "WILDSCENES_DATABASE_URL": "", **environment},
        capture_output=True,
        text=True,
        timeout=120,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    return done.stdout.strip()


def test_a_worker_knows_the_task_that_the_web_sends(tmp_path: Path) -> None:
    code = """
from workers.celery import celery
celery.loader.import_default_modules()
print(sorted(name for name in celery.tasks if not name.startswith("celery.")))
"""
    assert run(code, tmp_path) == str([EVALUATE])


def test_a_worker_listens_where_the_web_sends(tmp_path: Path) -> None:
    url = "redis+socket:///somewhere/broker.sock"
    code = "from workers.celery import celery; print(celery.conf.broker_url, celery.conf.task_default_queue)"
    web = make_celery(Settings(broker_url=url)).conf
    assert run(code, tmp_path, WILDSCENES_BROKER_URL=url) == f"{web.broker_url} {web.task_default_queue}"


def test_each_process_has_a_service_of_its_own(tmp_path: Path) -> None:
    """A database connection must not cross a fork."""
    code = """
import os
from workers.celery import wired
mine = wired()
assert wired() is mine
child = os.fork()
if child == 0:
    os._exit(0 if wired() is not mine and wired() is wired() else 1)
print(os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]))
"""
    assert run(code, tmp_path) == "0"


def test_a_worker_that_is_asked_to_stop_tells_its_children(tmp_path: Path) -> None:
    code = """
import os
from celery import signals
from workers.celery import draining
assert not draining.is_set()
child = os.fork()
if child == 0:
    os._exit(0 if draining.wait(30) else 1)
signals.worker_shutting_down.send("worker")
print(os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]))
"""
    assert run(code, tmp_path) == "0"


SWEEPING = """
import os, threading
from datetime import timedelta
from app.database import migrate
from app.settings import Settings
from workers import celery as worker

migrate(Settings().database)
service = worker.wire()
{setup}
threading.Timer({stop}, worker.draining.set).start()
worker._sweep_for_ever()
print("drained")
"""

WAITING_FOR_LONG = """
from datetime import datetime, UTC
from uuid import uuid4
from app.accounts.models import Role, Scope
from app.accounts.service import create_person, create_token, identify_token
from app.methods.models import Method
from app.submissions.lifecycle import Stage, State, Visibility
from app.submissions.models import Evaluation, Submission
long_ago = datetime(2020, 1, 1, tzinfo=UTC)
create_person(service.db, email="ada@example.org", role=Role.MEMBER, now=long_ago)
who = identify_token(service.db, create_token(service.db, email="ada@example.org", scope=Scope.SUBMIT, now=long_ago))
with service.db.begin() as session:
    method = Method(team_id=who.team_id, name="M", created_at=long_ago)
    session.add(method)
    session.flush()
    sent = Submission(
        benchmark="wildscenes", track="2d-standard", team_id=who.team_id, uploader_id=who.person_id,
        method_id=method.id, encoding="benchmark", state=State.QUEUED, visibility=Visibility.PRIVATE,
        created_at=long_ago,
    )
    session.add(sent)
    session.flush()
    session.add(Evaluation(
        submission_id=sent.id, scoring=1, groundtruth="g", evaluator="", first=True, state=Stage.QUEUED,
        created_at=long_ago,
    ))
"""

SOON = {
    "WILDSCENES_SWEEP_SECONDS": "0.05",
    "WILDSCENES_DEAF_SECONDS": "0.2",
    "WILDSCENES_BROKER_URL": "redis+socket:///nonexistent/broker.sock",
}


DROPPED = """
with service.db.begin() as session:
    session.connection().exec_driver_sql("DROP TABLE scores")
    session.connection().exec_driver_sql("DROP TABLE chunks")
    session.connection().exec_driver_sql("DROP TABLE evaluations")
"""


@pytest.mark.parametrize("setup", ["", DROPPED], ids=["nothing to do", "tables are missing"])
def test_the_sweeper_goes_on_until_the_worker_stops_also_after_a_fault(tmp_path: Path, setup: str) -> None:
    said = run(SWEEPING.format(setup=setup, stop=1), tmp_path, **SOON)
    assert said.splitlines()[-1] == "drained"
    assert (said.count("sweep failed") > 1) is bool(setup)


def test_an_idle_worker_beside_work_that_waits_leaves_to_be_started_again(tmp_path: Path) -> None:
    code = SWEEPING.format(setup=WAITING_FOR_LONG, stop=60)
    done = subprocess.run(
        [sys.executable, "-c", code],
        cwd=ROOT,
        env={**os.environ, "WILDSCENES_HOME": str(tmp_path), "WILDSCENES_DATABASE_URL": "", **SOON},
        capture_output=True,
        text=True,
        timeout=50,
        check=False,
    )
    assert (done.returncode, "drained" in done.stdout) == (1, False)
    assert "this worker hears nothing" in done.stdout


@pytest.mark.skipif(sys.platform != "linux", reason="the kernel bounds anonymous memory on Linux only")
def test_a_process_that_scores_runs_out_of_memory_before_the_machine_does(tmp_path: Path) -> None:
    code = """
from workers.celery import prepare_child
prepare_child()
kept = bytearray(100_000_000)
try:
    bytearray(3_000_000_000)
except MemoryError:
    print("bounded")
"""
    assert run(code, tmp_path, WILDSCENES_SCORING_MEMORY_BYTES="2000000000") == "bounded"


def test_a_process_that_scores_is_ended_after_a_time(tmp_path: Path) -> None:
    code = "from workers.celery import celery; print(celery.conf.task_time_limit)"
    assert run(code, tmp_path, WILDSCENES_SCORING_SECONDS="77") == "77"
