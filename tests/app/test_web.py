"""What every answer has: headers that keep browsers safe, and errors that say what to do."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import pytest
from sqlalchemy import text
from starlette.testclient import TestClient

from app.web import SECURITY
from tests.app.world import World

MISSING = "/api/v1/submissions/00000000-0000-0000-0000-000000000000"


def break_database(world: World) -> None:
    with world.wired.db.begin() as session:
        session.execute(text("DROP TABLE groundtruth_releases"))


def safe(headers: Any) -> dict[str, str]:
    return {name: headers.get(name) for name in SECURITY}


def test_the_headers_forbid_scripts_frames_and_forms_of_other_sites() -> None:
    assert SECURITY == {
        "Content-Security-Policy": (
            "default-src 'self'; base-uri 'none'; form-action 'self'; frame-ancestors 'none'; object-src 'none'"
        ),
        "X-Content-Type-Options": "nosniff",
        "Referrer-Policy": "same-origin",
        "Cross-Origin-Opener-Policy": "same-origin",
    }


@pytest.mark.parametrize(
    ("method", "path", "status"),
    [
        ("GET", "/", 200),
        ("GET", "/api/v1/tracks", 200),
        ("GET", "/static/site.css", 200),
        ("GET", "/static/missing.css", 404),
        ("GET", "/missing", 404),
        ("GET", "/api/v1/missing", 404),
        ("GET", "/submissions", 401),
        ("POST", "/api/v1/submissions", 401),
        ("DELETE", "/api/v1/tracks", 405),
        ("POST", "/", 405),
        ("GET", "/submissions/no-id", 422),
        ("GET", "/api/v1/submissions/no-id", 422),
        ("GET", "/static/../web.py", 404),
        ("GET", "/static/%2e%2e/web.py", 404),
    ],
)
def test_every_answer_has_the_headers(client: TestClient, method: str, path: str, status: int) -> None:
    answer = client.request(method, path)
    assert (answer.status_code, safe(answer.headers)) == (status, SECURITY)


@pytest.mark.parametrize("path", ["/", "/leaderboards/2d-standard", "/api/v1/tracks"])
def test_an_answer_about_a_fault_of_ours_has_them_too_and_tells_nothing(
    small_world: World, client: TestClient, path: str
) -> None:
    break_database(small_world)
    answer = client.get(path)
    assert (answer.status_code, safe(answer.headers)) == (500, SECURITY)
    assert "Our fault" in answer.text
    for secret in ("sqlite", "groundtruth_releases", "Traceback", str(small_world.wired.settings.home)):
        assert secret not in answer.text


def test_a_fault_of_ours_is_a_problem_with_a_code(small_world: World, client: TestClient) -> None:
    break_database(small_world)
    answer = client.get("/api/v1/tracks")
    assert (answer.headers["content-type"], answer.json()) == (
        "application/problem+json",
        {
            "type": "/errors/internal_error",
            "title": "Our fault",
            "status": 500,
            "detail": "Something unexpected happened on our side; it was logged. Please try again.",
            "code": "internal_error",
        },
    )


@pytest.mark.parametrize(
    ("method", "path", "said"),
    [
        (
            "GET",
            "/api/v1/missing",
            {"title": "Not Found", "status": 404, "detail": "There is nothing at this address.", "code": "not_found"},
        ),
        (
            "DELETE",
            "/api/v1/tracks",
            {
                "title": "Method Not Allowed",
                "status": 405,
                "detail": "This address does not take that method.",
                "code": "method_not_allowed",
            },
        ),
        (
            "GET",
            MISSING,
            {
                "title": "Not found",
                "status": 404,
                "detail": "there is no such submission, or it is private",
                "code": "not_found",
            },
        ),
        (
            "POST",
            "/api/v1/submissions",
            {
                "title": "Sign in or send a token",
                "status": 401,
                "detail": "send 'Authorization: Bearer <token>', or sign in",
                "code": "unauthenticated",
            },
        ),
        (
            "GET",
            "/api/v1/tracks/4d/facts",
            {"title": "Not found", "status": 404, "detail": "there is no track '4d'", "code": "unknown_track"},
        ),
    ],
)
def test_an_error_of_the_api_is_a_problem_as_rfc_9457_describes_it(
    client: TestClient, method: str, path: str, said: dict[str, Any]
) -> None:
    answer = client.request(method, path)
    assert answer.headers["content-type"] == "application/problem+json"
    assert (answer.status_code, answer.json()) == (said["status"], {"type": f"/errors/{said['code']}", **said})
    challenge = "Bearer" if said["status"] == 401 else None
    assert answer.headers.get("www-authenticate") == challenge


def test_a_field_that_is_wrong_is_listed_with_what_was_expected(client: TestClient) -> None:
    answer = client.get("/api/v1/submissions/no-id")
    said = answer.json()
    assert (said["status"], said["code"], [one["member"] for one in said["errors"]]) == (
        422,
        "invalid",
        ["submission_id"],
    )
    assert set(said["errors"][0]) == {"member", "code", "expected", "found", "hint"}


def test_an_error_of_a_page_is_a_page(client: TestClient) -> None:
    answer = client.get("/leaderboards/<script>")
    assert (answer.status_code, answer.headers["content-type"]) == (404, "text/html; charset=utf-8")
    assert "&lt;script&gt;" in answer.text
    assert "<script>" not in answer.text


CHANGES = ["/submit", "/sign-in", "/sign-out", "/api/v1/submissions", f"{MISSING}/publish", f"{MISSING[7:]}/publish"]
FOREIGN = [
    {"Sec-Fetch-Site": "cross-site"},
    {"Sec-Fetch-Site": "same-site"},
    {"Sec-Fetch-Site": "cross-site", "Origin": "http://testserver"},
    {"Origin": "http://evil.example"},
    {"Origin": "http://testserver.evil.example"},
    {"Origin": "http://testserver:8080"},
    {"Origin": "null"},
    {"Origin": "http://["},
    {"Origin": ""},
]


@pytest.fixture
def signed_in(small_world: World, client: TestClient) -> TestClient:
    client.post("/sign-in", data={"token": small_world.token()})
    return client


@pytest.mark.parametrize("path", CHANGES)
def test_what_another_site_makes_a_browser_send_is_refused(signed_in: TestClient, path: str) -> None:
    for headers in FOREIGN:
        answer = signed_in.post(path, headers=headers)
        assert (answer.status_code, safe(answer.headers)) == (403, SECURITY), headers
        assert "this request came from another site" in answer.text


def test_a_session_outlives_what_another_site_asked_for(signed_in: TestClient) -> None:
    signed_in.post("/sign-out", headers={"Sec-Fetch-Site": "cross-site"})
    assert signed_in.get("/submissions").status_code == 200


@pytest.mark.parametrize(
    "headers",
    [
        {},
        {"Sec-Fetch-Site": "same-origin", "Origin": "http://testserver"},
        {"Sec-Fetch-Site": "none"},
        {"Origin": "http://testserver"},
    ],
    ids=str,
)
def test_what_this_sites_own_pages_send_passes(signed_in: TestClient, headers: dict[str, str]) -> None:
    assert signed_in.post("/sign-out", headers=headers).status_code == 303


def test_a_bearer_token_proves_that_no_other_site_is_behind_a_request(small_world: World, client: TestClient) -> None:
    headers = {"Sec-Fetch-Site": "cross-site", "Authorization": f"Bearer {small_world.token()}"}
    assert client.post(f"{MISSING}/publish", headers=headers).status_code == 404


def test_another_kind_of_authorization_proves_nothing(signed_in: TestClient) -> None:
    """A browser adds a proxy's password to what any site makes it send."""
    headers = {"Sec-Fetch-Site": "cross-site", "Authorization": "Basic YWRhOnNlY3JldA=="}
    assert signed_in.post("/sign-out", headers=headers).status_code == 403


def test_pages_can_be_reached_from_other_sites(client: TestClient) -> None:
    assert client.get("/", headers={"Sec-Fetch-Site": "cross-site"}).status_code == 200


@pytest.mark.parametrize("header", ["Bearer wsc_unknown", "bearer x", "Bearer"])
def test_a_token_that_nobody_holds_is_refused_even_where_visitors_may_look(
    open_client: Callable[[World], TestClient], small_world: World, header: str
) -> None:
    answer = open_client(small_world).get(MISSING, headers={"Authorization": header})
    assert (answer.status_code, answer.json()["code"]) == (401, "bad_token")
