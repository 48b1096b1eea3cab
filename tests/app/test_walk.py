"""Every address of the site, asked for with whatever a stranger may send: no answer is a fault of ours."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from typing import Any
from uuid import UUID

import pytest
import schemathesis
from fastapi.routing import APIRoute
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from schemathesis.checks import not_a_server_error
from starlette.testclient import TestClient

from app.main import make_app
from app.settings import Settings
from app.submissions import service
from app.wiring import wire
from tests.app.world import World

BOUNDED = settings(
    deadline=None,
    max_examples=12,
    suppress_health_check=[HealthCheck.function_scoped_fixture, HealthCheck.too_slow],
)
NASTY = [
    "",
    "%00",
    "%ff",
    "%2e%2e%2f",
    "..",
    "'\"<script>",
    "2d-standard.csv",
    "x" * 5000,
    "%F0%9F%8C%B2",
    "{{7*7}}",
    "-1",
    "null",
    "00000000-0000-0000-0000-000000000000",
]


def pages() -> list[str]:
    """The path of every route that is read, those for people too; what the code declares, on no database at all."""
    app = make_app(wire(Settings(database_url="sqlite://")))
    paths = [route.path for included in app.routes for route in _leaves(included) if "GET" in (route.methods or set())]
    assert len(paths) >= 11
    return sorted(set(paths))


def _leaves(route: Any) -> Iterator[APIRoute]:
    if isinstance(route, APIRoute):
        yield route
    for one in getattr(getattr(route, "original_router", route), "routes", []):
        yield from _leaves(one)


@pytest.fixture
def peopled(small_world: World) -> World:
    """A service with one submission of each kind."""
    who = small_world.person()
    small_world.scored(who, public=True)
    small_world.scored(who, track="3d-val", data=b"no zip")
    small_world.submit(who)
    small_world.begin(who)
    return small_world


@pytest.fixture
def visitor(peopled: World, open_client: Callable[[World], TestClient]) -> TestClient:
    return open_client(peopled)


@pytest.fixture
def maintainer(peopled: World, open_client: Callable[[World], TestClient]) -> TestClient:
    client = open_client(peopled)
    client.post("/sign-in", data={"token": peopled.token("eve@example.org")})
    return client


@pytest.mark.parametrize("path", pages())
def test_no_page_and_no_route_breaks_whatever_stands_in_its_address(
    peopled: World, visitor: TestClient, maintainer: TestClient, path: str
) -> None:
    real = {"{track}": "3d-val", "{submission_id}": str(_ids(peopled)[0])}

    @BOUNDED
    @given(
        st.sampled_from([*NASTY, "real"]),
        st.dictionaries(st.sampled_from(["track", "method", "next", "q", "\x00"]), st.text(max_size=50), max_size=3),
        st.sampled_from(["*/*", "text/csv", "", "application/json;q=x", ";;;,,"]),
        st.sampled_from([{}, {"Authorization": "Bearer x"}, {"Cookie": "wildscenes_session=x"}]),
    )
    def ask(piece: str, query: dict[str, str], accept: str, proof: dict[str, str]) -> None:
        address = path
        for name, value in real.items():
            address = address.replace(name, value if piece == "real" else piece)
        for client in (visitor, maintainer):
            answer = client.get(address, params=query, headers={"Accept": accept, **proof})
            assert answer.status_code < 500, (address, query, answer.text)

    ask()


def _ids(world: World) -> Sequence[UUID]:
    return [one.id for one, _ in service.newest(world.wired)]


def _sound(found: Any) -> Any:
    return found.ok()


def test_no_route_of_the_api_breaks_under_requests_made_from_its_schema(peopled: World) -> None:
    api = schemathesis.openapi.from_asgi("/api/v1/openapi.json", make_app(peopled.wired))
    proof = {"Authorization": f"Bearer {peopled.token('bob@example.org')}"}
    asked: dict[str, int] = {}
    for operation in (_sound(found) for found in api.get_all_operations()):

        @BOUNDED
        @given(operation.as_strategy(), st.sampled_from([{}, proof]))
        def ask(case: Any, headers: dict[str, str]) -> None:
            case.call_and_validate(checks=[not_a_server_error], headers=headers)
            asked[case.operation.label] = asked.get(case.operation.label, 0) + 1

        ask()
    assert sorted(asked) == [
        "GET /api/v1/leaderboards/{track}",
        "GET /api/v1/leaderboards/{track}.csv",
        "GET /api/v1/submissions/{submission_id}",
        "GET /api/v1/tracks",
        "GET /api/v1/tracks/{track}/facts",
        "POST /api/v1/submissions",
        "POST /api/v1/submissions/{submission_id}/publish",
    ]
