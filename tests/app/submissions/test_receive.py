"""Uploads that end in another way than they should."""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from dataclasses import replace
from typing import Any
from uuid import UUID

import pytest
from sqlalchemy import select
from starlette.testclient import TestClient

from app.main import make_app
from app.queue import Queue
from app.submissions.lifecycle import State
from app.submissions.models import Submission
from tests.app.world import World

FORM = {"track": "2d-standard", "method": "Forest"}


def states(world: World) -> list[State]:
    with world.wired.db.read() as session:
        return list(session.scalars(select(Submission.state).order_by(Submission.created_at)))


def kept(world: World) -> list[bytes]:
    return [path.read_bytes() for path in world.wired.settings.uploads.iterdir()]


async def send_some(world: World, blocks: list[bytes]) -> list[dict[str, Any]]:
    """What the server answers to somebody who sends these blocks and then goes away."""
    said: list[dict[str, Any]] = []
    messages = [{"type": "http.request", "body": block, "more_body": True} for block in blocks]
    messages.append({"type": "http.disconnect"})

    async def receive() -> dict[str, Any]:
        return messages.pop(0)

    async def send(message: Any) -> None:
        said.append(message)

    scope = {
        "type": "http",
        "asgi": {"version": "3.0"},
        "http_version": "1.1",
        "method": "POST",
        "scheme": "http",
        "path": "/api/v1/submissions",
        "raw_path": b"/api/v1/submissions",
        "query_string": b"",
        "headers": [
            (b"host", b"testserver"),
            (b"authorization", f"Bearer {world.token()}".encode()),
            (b"content-type", b"multipart/form-data; boundary=XX"),
        ],
    }
    await make_app(world.wired)(scope, receive, send)
    return said


def test_somebody_who_goes_away_in_the_middle_leaves_nothing_behind(small_world: World) -> None:
    fields = "".join(
        f'--XX\r\nContent-Disposition: form-data; name="{name}"\r\n\r\n{value}\r\n' for name, value in FORM.items()
    )
    start = f'{fields}--XX\r\nContent-Disposition: form-data; name="file"; filename="a.zip"\r\n\r\n'.encode()
    asyncio.run(send_some(small_world, [start, b"z" * 1_500_000, b"z" * 1_500_000]))
    assert (states(small_world), kept(small_world)) == ([State.CANCELLED], [])


class BrokenQueue(Queue):
    """A queue with a fault that nobody thought of."""

    def send(self, evaluation_id: UUID) -> bool:
        raise RuntimeError(evaluation_id)


def test_a_fault_after_a_submission_was_queued_does_not_take_its_bytes_away(
    small_world: World, open_client: Callable[[World], TestClient]
) -> None:
    world = World(
        replace(small_world.wired, queue=BrokenQueue(small_world.wired.settings)),
        small_world.clock,
        small_world.predictions,
    )
    headers = {"Authorization": f"Bearer {world.token()}"}
    answer = open_client(world).post("/api/v1/submissions", data=FORM, files={"file": b"zip"}, headers=headers)
    assert answer.status_code == 500
    assert (states(world), kept(world)) == ([State.QUEUED], [b"zip"])


@pytest.mark.parametrize("size", [0, 1, (1 << 20) - 1, 1 << 20, (1 << 20) + 1, 3 << 20])
def test_an_upload_of_any_size_arrives_unchanged(small_world: World, client: TestClient, size: int) -> None:
    data = bytes(range(251)) * (size // 251 + 1)
    headers = {"Authorization": f"Bearer {small_world.token()}"}
    answer = client.post("/api/v1/submissions", data=FORM, files={"file": data[:size]}, headers=headers)
    assert (answer.status_code, kept(small_world)) == (202, [data[:size]])
