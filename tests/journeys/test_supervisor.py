"""What `wildscenes serve` starts is started again when it dies, and ends with it."""

from __future__ import annotations

import os
import signal
import socket
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest

if TYPE_CHECKING:
    from tests.conftest import DataSet
    from tests.journeys.conftest import Predict, Serve, Server

TRACK = "2d-val"
CHILDREN = {"broker": "valkey-server", "worker": "workers.celery", "web": "app.asgi:app"}
QUICK = {"lease_seconds": 3, "heartbeat_seconds": 1, "sweep_seconds": 1, "resend_seconds": 3}


def command_of(pid: int) -> str:
    """How a process was started; empty when it is gone or about to be."""
    try:
        return Path(f"/proc/{pid}/cmdline").read_bytes().replace(b"\0", b" ").decode("utf-8", "replace")
    except OSError:
        return ""


def child(server: Server, descendants: Callable[[int], set[int]], name: str) -> int:
    """The process id of one of the three children, the oldest of its group; 0 when it does not run."""
    assert server.process is not None
    found = {pid for pid in descendants(server.process.pid) if CHILDREN[name] in command_of(pid)}
    leaders = [pid for pid in found if os.getpgid(pid) == pid]
    return leaders[0] if leaders else 0


@pytest.fixture(scope="module")
def server(serve: Serve, demo: DataSet) -> Server:
    return serve("--groundtruth", demo.groundtruth, **QUICK)


@pytest.fixture(scope="module")
def ada(server: Server) -> str:
    return server.token("ada")


@pytest.mark.parametrize("killed", CHILDREN)
def test_a_killed_child_is_started_again_and_the_submission_is_scored(
    server: Server,
    ada: str,
    predict: Predict,
    poll: Callable[..., Any],
    descendants: Callable[[int], set[int]],
    killed: str,
) -> None:
    archive, before = predict(TRACK), child(server, descendants, killed)
    early = server.send(archive, ada, track=TRACK, method=f"Sent before the {killed} was killed")
    os.kill(before, signal.SIGKILL)
    poll(lambda: child(server, descendants, killed) not in (0, before))
    poll(server.answers)
    late = server.send(archive, ada, track=TRACK, method=f"Sent after the {killed} was killed")
    said = [server.settled(one, ada) for one in (early, late)]
    assert [one["state"] for one in said] == ["scored", "scored"]
    assert said[0]["scores"] == said[1]["scores"]


def test_nothing_is_left_of_a_killed_server_and_its_home_is_served_again_until_ctrl_c(
    serve: Serve,
    demo: DataSet,
    predict: Predict,
    poll: Callable[..., Any],
    descendants: Callable[[int], set[int]],
    tmp_path: Path,
) -> None:
    server = serve("--groundtruth", demo.groundtruth, home=tmp_path, **QUICK)
    assert server.process is not None
    ada = server.token("ada")
    sent = server.send(predict(TRACK), ada, track=TRACK, method="Before the power cut", visibility="public")
    children = descendants(server.process.pid)
    assert {name for name, part in CHILDREN.items() if any(part in command_of(pid) for pid in children)} == set(
        CHILDREN
    )
    server.process.kill()
    server.process.wait()
    poll(lambda: not any(command_of(pid) for pid in children))

    again = serve(home=tmp_path, **QUICK)
    assert again.process is not None
    assert again.settled(sent, ada)["state"] == "scored"
    children = descendants(again.process.pid)
    again.process.send_signal(signal.SIGINT)
    assert again.process.wait(60) == 0, again.output.read_text("utf-8")
    assert [pid for pid in children if command_of(pid)] == []
    assert again.output.read_text("utf-8").endswith("stopping …\n")
    with socket.socket() as probe:
        assert probe.connect_ex(("127.0.0.1", int(again.url.rpartition(":")[2]))) != 0
