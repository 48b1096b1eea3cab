"""Signing in and out in a browser."""

from __future__ import annotations

from collections.abc import Callable
from urllib.parse import urljoin, urlsplit

import pytest
from hypothesis import example, given
from hypothesis import strategies as st
from starlette.testclient import TestClient

from app.accounts.identity import COOKIE
from app.accounts.pages import own_path
from tests.app.world import World

AWAY = [
    "https://evil.example/",
    "//evil.example",
    "/\\evil.example",
    "\\\\evil.example",
    "javascript:alert(1)",
    "evil.example",
    "",
    "/\t/evil.example",
    "/\n//evil.example",
    " //evil.example",
]


@pytest.mark.parametrize("address", ["/", "/submissions", "/submit?track=2d-val#file", "/ä"])
def test_a_path_of_this_site_is_kept(address: str) -> None:
    assert own_path(address) == address


@pytest.mark.parametrize("address", AWAY)
def test_an_address_elsewhere_becomes_the_home_page(address: str) -> None:
    assert own_path(address) == "/"


@example("/\\/evil.example")
@example("/.//evil.example")
@given(st.text(st.sampled_from("/\\.:@?#\t\n\r aé\x00\u2028"), max_size=8).map(lambda tail: "/" + tail))
def test_no_path_leads_a_browser_away(address: str) -> None:
    as_browsers_read = own_path(address).replace("\\", "/")
    assert urlsplit(urljoin("http://here.example/sign-in", as_browsers_read)).netloc == "here.example"


def test_a_token_opens_a_session_with_a_cookie_that_scripts_and_other_sites_do_not_get(
    small_world: World, client: TestClient
) -> None:
    token = small_world.token()
    answer = client.post("/sign-in", data={"token": f" {token} ", "next": "/submissions"})
    assert (answer.status_code, answer.headers["location"]) == (303, "/submissions")
    name, *attributes = [part.strip() for part in answer.headers["set-cookie"].split(";")]
    assert name.startswith(f"{COOKIE}=")
    assert token not in name
    assert sorted(attributes) == ["HttpOnly", "Max-Age=1209600", "Path=/", "SameSite=lax"]
    assert "Signed in as" in client.get("/").text


def test_on_a_site_with_tls_the_cookie_travels_encrypted_only(
    make_world: Callable[..., World], sqlite_url: str, open_client: Callable[[World], TestClient]
) -> None:
    world = make_world(sqlite_url, base_url="https://scenes.example")
    answer = open_client(world).post("/sign-in", data={"token": world.token()})
    assert "Secure" in [part.strip() for part in answer.headers["set-cookie"].split(";")]


@pytest.mark.parametrize("address", AWAY)
def test_signing_in_leads_nobody_away(small_world: World, client: TestClient, address: str) -> None:
    answer = client.post("/sign-in", data={"token": small_world.token(), "next": address})
    assert (answer.status_code, answer.headers["location"]) == (303, "/")
    form = client.get("/sign-in", params={"next": address}).text
    assert '<input type="hidden" name="next" value="/">' in form


@pytest.mark.parametrize("token", ["wsc_unknown", "", "\x00", "ä" * 200])
def test_an_unknown_token_shows_the_form_again_with_the_reason(client: TestClient, token: str) -> None:
    answer = client.post("/sign-in", data={"token": token, "next": "/submissions"})
    assert (answer.status_code, COOKIE in answer.cookies) == (401, False)
    assert "this token is unknown or was revoked" in answer.text
    assert '<input type="hidden" name="next" value="/submissions">' in answer.text


def test_signing_out_ends_the_session_on_the_server_too(small_world: World, client: TestClient) -> None:
    client.post("/sign-in", data={"token": small_world.token()})
    kept = client.cookies[COOKIE]
    answer = client.post("/sign-out")
    assert (answer.status_code, answer.headers["location"], COOKIE in client.cookies) == (303, "/", False)
    client.cookies.set(COOKIE, kept)
    assert client.get("/submissions").status_code == 401


def test_a_session_ends_after_fourteen_days(small_world: World, client: TestClient) -> None:
    client.post("/sign-in", data={"token": small_world.token()})
    small_world.clock.advance(14 * 86400 - 1)
    assert client.get("/submissions").status_code == 200
    small_world.clock.advance(1)
    assert client.get("/submissions").status_code == 401


def test_signing_out_without_a_session_is_harmless(client: TestClient) -> None:
    assert client.post("/sign-out").status_code == 303
