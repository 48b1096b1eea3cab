"""Requests that nobody means well with: each gets an answer, none of them a 5xx."""

from __future__ import annotations

import socket
from typing import TYPE_CHECKING, Any

import pytest

if TYPE_CHECKING:
    from tests.journeys.conftest import Server

PART = b'--b\r\nContent-Disposition: form-data; name="%s"\r\n\r\n%s\r\n'
TEXTS = [
    "\0",
    "a\0b",
    "🦘" * 30,
    "👩\u200d👩\u200d👧",
    "m" * 9_999,
    "m" * 20_000,
    "'; DROP TABLE teams; --",
    "${7*7}",
    "\ufeff",
    "\x7f",
]
BYTES = [b"\xff\xfe", b"\xed\xa0\x80", b"\0"]
PLACES = """
/%00 /%ff // /;/ /static/%00 /static/..%2f..%2fetc%2fpasswd /static/%2e%2e/web.py
/leaderboards/%00 /leaderboards/%ff%fe /leaderboards/2d-standard%0d%0aX:1 /submit?track=%00&method=%ff
/submissions/%00 /submissions/1 /submissions/00000000-0000-0000-0000-00000000000g /submissions/{}
/api/v1/submissions/%00 /api/v1/submissions/nope /api/v1/submissions/?x=% /api/v1/%F0%9F%A6%98
/api/v1/leaderboards/%00 /api/v1/leaderboards/.csv /api/v1/leaderboards/%00.csv /api/v1/tracks/%00/facts
/api/v1/leaderboards/2d-standard.csv?%00=%00 /api/v1/tracks?&&==&% /?=&a[]=1&a[b]=2&%zz
/sign-in?next=%00 /sign-in?next=//evil.example /sign-in?next=%0d%0aSet-Cookie:x
"""
LONG = [f"{start}{'9' * 5000}" for start in ("/static/", "/leaderboards/", "/submit?", "/api/v1/submissions/")]
HEADERS: list[dict[str, bytes]] = [
    {"Authorization": b"Bearer "},
    {"Authorization": b"Bearer \xff\xfe"},
    {"Authorization": b"Basic YTpi"},
    {"Authorization": b"Bearer " + b"x" * 20_000},
    {"Cookie": b"wildscenes_session=\xff; =; ;;"},
    {"Cookie": b"wildscenes_session=" + b"x" * 5_000},
    {"Accept": b"\xff/\xfe;q=x"},
    {"Host": b""},
    {"Host": b"evil.example:99999"},
    {"Origin": b"null"},
    {"Origin": b"http://[::1"},
    {"Range": b"bytes=9-1"},
    {"If-None-Match": b"\xff"},
    {"If-Modified-Since": b"yesterday"},
    {"X-Forwarded-For": b"\0"},
]


@pytest.fixture(scope="module")
def server(demo_server: Server) -> Server:
    return demo_server


@pytest.fixture(scope="module")
def ada(server: Server) -> str:
    return server.token("odd")


def raw(server: Server, head: bytes, body: bytes = b"") -> int:
    """The status of a request sent byte by byte, as no client library would."""
    host, port = server.url.removeprefix("http://").split(":")
    with socket.create_connection((host, int(port)), timeout=60) as connection:
        connection.sendall(head + b"\r\nConnection: close\r\n\r\n" + body)
        answer = b""
        while (block := connection.recv(65536)) and b"\r\n" not in answer:
            answer += block
    return int((answer + block).split()[1])


def log_of(server: Server) -> str:
    """What the web wrote so far."""
    return (server.home / "logs" / "web.log").read_text("utf-8", "replace")


def test_odd_addresses_are_answered(server: Server) -> None:
    wrong = {}
    for method in (b"GET", b"POST", b"DELETE", b"PATCH", b"OPTIONS", b"HEAD"):
        for path in [*PLACES.split(), *LONG]:
            status = raw(server, method + b" " + path.encode() + b" HTTP/1.1\r\nHost: x")
            if not 200 <= status < 500:
                wrong[method, path] = status
    assert wrong == {}
    assert "Traceback" not in log_of(server)


def test_odd_headers_are_answered(server: Server, ada: str) -> None:
    wrong = {}
    for path in ("/", "/submissions", "/api/v1/tracks", "/static/site.css"):
        for headers in HEADERS:
            lines = b"".join(b"\r\n%s: %s" % (name.encode(), value) for name, value in headers.items())
            host = b"" if "Host" in headers else b"\r\nHost: x"
            for method in (b"GET", b"POST"):
                status = raw(server, method + b" " + path.encode() + b" HTTP/1.1" + host + lines)
                if not 200 <= status < 500:
                    wrong[method, path, lines] = status
    assert wrong == {}
    assert "Traceback" not in log_of(server)


@pytest.mark.parametrize("name", ["track", "method", "labels", "visibility", "file", "x" * 300])
def test_odd_fields_are_answered(server: Server, ada: str, name: str) -> None:
    wrong = {}
    for value in [*(text.encode() for text in TEXTS), *BYTES]:
        fields = {b"track": b"2d-standard", b"method": b"Odd", name.encode(): value}
        form = b"".join(PART % pair for pair in fields.items()) + b"--b--\r\n"
        for path, kind in (
            ("/api/v1/submissions", b"boundary=b"),
            ("/submit", b"boundary=b"),
            ("/submit", b"boundary="),
        ):
            headers: dict[str, Any] = {"Content-Type": b"multipart/form-data; " + kind}
            answer = server.ask("POST", path, ada, content=form, headers=headers)
            is_fine = answer.status_code in (202, 303) or 400 <= answer.status_code < 500
            if path.startswith("/api") and answer.is_error:
                is_fine &= answer.headers["content-type"] == "application/problem+json" and "code" in answer.json()
            if not is_fine:
                wrong[path, kind, value[:20]] = answer.status_code, answer.text[:200]
    assert wrong == {}
    assert "Traceback" not in log_of(server)


def test_odd_forms_are_answered_when_signing_in(server: Server) -> None:
    for text in TEXTS:
        answer = server.ask("POST", "/sign-in", data={"token": text, "next": text})
        assert answer.status_code in (401, 422), text
    for body in BYTES:
        for kind in (
            "application/x-www-form-urlencoded",
            "multipart/form-data; boundary=b",
            "multipart/form-data",
            "x/\0",
        ):
            status = raw(
                server,
                f"POST /sign-in HTTP/1.1\r\nHost: x\r\nContent-Type: {kind}\r\nContent-Length: {len(body)}".encode(),
                body,
            )
            assert 400 <= status < 500, (body, kind)
    assert "Traceback" not in log_of(server)
