"""What is wrong is said, all of it, in every place where a submitter may look; nothing is our fault."""

from __future__ import annotations

import io
import re
import socket
import zipfile
from collections.abc import Callable
from html import unescape
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
from PIL import Image

from evaluator.benchmark import Benchmark
from evaluator.groundtruth import GroundTruth
from evaluator.pack import encode_labels

if TYPE_CHECKING:
    from tests.journeys.conftest import Noise, Serve, Server

LARGEST = 400_000
TRACK = "2d-standard"


@pytest.fixture(scope="module")
def noise(make_noise: Callable[..., Noise]) -> Noise:
    return make_noise(44, (40, 30))


@pytest.fixture(scope="module")
def server(serve: Serve, noise: Noise) -> Server:
    return serve("--groundtruth", noise.groundtruth, max_upload_bytes=LARGEST)


@pytest.fixture(scope="module")
def ada(server: Server) -> str:
    return server.token("ada")


@pytest.fixture(scope="module")
def reader(server: Server) -> str:
    return server.token("reader", "read")


@pytest.fixture(scope="module")
def good(noise: Noise, tmp_path_factory: pytest.TempPathFactory) -> Path:
    return noise.zip(tmp_path_factory.mktemp("good") / "good.zip")


def spoilt(noise: Noise, path: Path) -> set[tuple[str, str]]:
    """Write a zip with forty things wrong, eight of each kind, and four good frames; the answer is what is wrong."""
    rng = np.random.default_rng(3)
    wrong = set()
    width, height = noise.size

    def png(labels: Any) -> bytes:
        stream = io.BytesIO()
        Image.fromarray(np.asarray(labels, np.uint8)).save(stream, "PNG")
        return stream.getvalue()

    with zipfile.ZipFile(path, "w") as archive:
        for number, (frame, sequence) in enumerate(noise.frames.items()):
            labels, member = rng.integers(0, 15, (height, width), np.uint8), f"{frame}.png"
            kind = number // 8
            if kind == 0:
                wrong.add((f"{sequence}/{member}", "missing_frame"))
                continue
            if kind == 1:
                data, code = png(labels[:-1]), "wrong_size"
            elif kind == 2:
                data, code = png(np.stack([labels] * 3, axis=-1)), "not_indices"
            elif kind == 3:
                labels[0, 0] = 77
                data, code = png(labels), "value_out_of_range"
            elif kind == 4:
                data, code = png(labels)[:-40], "unreadable"
            else:
                data, code = png(labels), ""
            archive.writestr(member, data)
            wrong |= {(member, code)} if code else set()
    return wrong


def test_forty_things_wrong_are_named_by_the_api_the_commands_and_the_page_alike(
    server: Server, ada: str, noise: Noise, tmp_path: Path
) -> None:
    archive, facts = tmp_path / "spoilt.zip", tmp_path / "facts.json"
    expected = spoilt(noise, archive)
    assert len(expected) == 40

    said = server.settled(server.send(archive, ada, track=TRACK, method="Spoilt", visibility="public"), ada)
    assert (said["state"], said["problems_total"], said["scores"], said["attempt"]) == ("rejected", 40, None, None)
    assert {(one["member"], one["code"]) for one in said["problems"]} == expected
    assert all(one["hint"] for one in said["problems"])
    sizes = [one for one in said["problems"] if one["code"] == "wrong_size"]
    assert {(one["expected"], one["found"]) for one in sizes} == {("40x30 (width x height)", "40x29")}

    facts.write_bytes(server.get(f"/api/v1/tracks/{TRACK}/facts").content)
    local = server.cli("validate", archive, "--track", TRACK, "--facts", facts, check=False)
    told = ("--track", TRACK, "--method", "Spoilt", "--server", server.url, "--token", ada, "--wait")
    remote = server.cli("submit", archive, *told, check=False)
    for done, text in ((local, local.stderr), (remote, remote.stdout)):
        assert done.returncode == 1
        assert set(re.findall(r"^(\S+\.png): (\w+)", text, re.MULTILINE)) == expected

    cookie, _, _ = server.ask("POST", "/sign-in", data={"token": ada}).headers["set-cookie"].partition(";")
    page = server.get(f"/submissions/{said['id']}", headers={"Cookie": cookie}).text
    rows = re.findall(r'data-label="Member"><code>(.*?)</code>.*?<code class="tag">(.*?)</code>', page, re.DOTALL)
    assert {(unescape(member), code) for member, code in rows} == expected
    assert len(rows) == 40
    assert server.get(f"/submissions/{said['id']}").status_code == 404
    board = server.get(f"/api/v1/leaderboards/{TRACK}").json()["rows"]
    assert [row for row in board if not row["baseline"]] == []


def test_labels_of_the_official_3d_training_are_warned_of_and_still_scored(
    server: Server, ada: str, noise: Noise, wildscenes: Benchmark, tmp_path: Path
) -> None:
    truth, track = GroundTruth(noise.groundtruth, wildscenes), wildscenes.track("3d-standard")
    values = wildscenes.encodings["mmdet3d13"].values
    table = np.array([values.index(name) if name in values else 0 for name in wildscenes.names] + [0] * 241, np.uint8)
    archive = tmp_path / "unmapped.zip"
    with zipfile.ZipFile(archive, "w", zipfile.ZIP_DEFLATED) as file:
        for frame in truth.frames(track):
            file.writestr(f"{frame.name}.label", encode_labels(table[truth.labels(track, frame)], "cloud"))
    said = {}
    for labels in ("benchmark", "mmdet3d13"):
        sent = server.send(archive, ada, track=track.id, method="Official", labels=labels)
        said[labels] = server.settled(sent, ada)
    assert [one["state"] for one in said.values()] == ["scored", "scored"]
    (warning,) = said["benchmark"]["warnings"]
    assert (warning["member"], warning["code"]) == (None, "looks_like_other_encoding")
    assert warning["hint"].endswith("send them again with labels=mmdet3d13.")
    assert said["benchmark"]["scores"]["classes"]["structure"] < 0.1
    assert said["mmdet3d13"]["warnings"] == []
    assert said["mmdet3d13"]["scores"]["classes"]["structure"] == 1.0


FIELDS = {"track": TRACK, "method": "Refused"}
WRONG_FIELDS: dict[str, tuple[dict[str, str], str, str]] = {
    "no track": ({"method": "m"}, "track_missing", "the field 'track' is missing; there are: 2d-standard, "),
    "unknown track": (FIELDS | {"track": "4d"}, "unknown_track", "there is no track '4d'; there are: 2d-standard, "),
    "no method": ({"track": TRACK}, "method_missing", "the field 'method' names your method; it is empty"),
    "blank method": (FIELDS | {"method": " \t "}, "method_missing", "the field 'method' names your method"),
    "long method": (FIELDS | {"method": "m" * 101}, "method_name", "a method's name has at most 100 visible"),
    "invisible": (FIELDS | {"method": "a\u202eb"}, "method_name", "a method's name has at most 100 visible"),
    "encoding": (FIELDS | {"labels": "coco"}, "unknown_encoding", "there is no label encoding 'coco'; there are: "),
    "visibility": (FIELDS | {"visibility": "us"}, "unknown_visibility", "the field 'visibility' is 'private' or"),
    "unknown field": (FIELDS | {"tack": "x"}, "invalid", "unknown fields: tack; known are: labels, method, track"),
}


def is_problem(answer: Any, status: int, code: str) -> str:
    """Check an error's form, and return what it says."""
    said = answer.json()
    assert answer.headers["content-type"] == "application/problem+json"
    assert (answer.status_code, said["status"], said["code"]) == (status, status, code)
    assert said["type"] == f"/errors/{code}"
    assert said["title"]
    return str(said["detail"])


@pytest.mark.parametrize("case", WRONG_FIELDS)
def test_a_wrong_field_is_named_and_nothing_is_kept(server: Server, ada: str, good: Path, case: str) -> None:
    fields, code, detail = WRONG_FIELDS[case]
    kept = server.uploads()
    files = {"file": ("good.zip", good.read_bytes())}
    answer = server.ask("POST", "/api/v1/submissions", ada, data=fields, files=files)
    assert is_problem(answer, 422, code).startswith(detail)
    assert server.uploads() == kept


def test_a_token_must_be_known_and_for_submitting(server: Server, ada: str, reader: str) -> None:
    sends: dict[str, Any] = {"data": FIELDS, "files": {"file": b"PK"}}
    missing = server.ask("POST", "/api/v1/submissions", **sends)
    is_problem(missing, 401, "unauthenticated")
    assert missing.headers["www-authenticate"] == "Bearer"
    is_problem(server.ask("POST", "/api/v1/submissions", f"{ada}x", **sends), 401, "bad_token")
    is_problem(server.ask("POST", "/api/v1/submissions", reader, **sends), 403, "token_scope")
    wrong = f"/api/v1/submissions/{'0' * 8}-0000-0000-0000-{'0' * 12}"
    is_problem(server.get(wrong, reader), 404, "not_found")


def test_a_form_needs_one_file_of_bearable_size(server: Server, ada: str, good: Path) -> None:
    kept = server.uploads()
    to = "/api/v1/submissions"
    alone = {name: (None, value) for name, value in FIELDS.items()}
    is_problem(server.ask("POST", to, ada, files=alone), 422, "file_missing")
    twice = [("file", ("a.zip", b"PK")), ("file", ("b.zip", b"PK"))]
    is_problem(server.ask("POST", to, ada, data=FIELDS, files=twice), 422, "two_files")
    is_problem(server.ask("POST", to, ada, data=FIELDS), 415, "not_multipart")
    is_problem(server.ask("POST", to, ada, json=FIELDS), 415, "not_multipart")
    is_problem(server.ask("POST", to, ada), 415, "not_multipart")
    cut = {"Content-Type": "multipart/form-data; boundary=b"}
    is_problem(server.ask("POST", to, ada, content=b"--b\r\nnonsense", headers=cut), 422, "bad_form")
    for size in (LARGEST + 1, LARGEST + 200_000):
        answer = server.ask("POST", to, ada, data=FIELDS, files={"file": bytes(size)})
        assert is_problem(answer, 413, "upload_too_large") == f"an upload has at most {LARGEST} bytes"
    assert server.uploads() == kept
    at_most = good.read_bytes().ljust(LARGEST, b"\0")
    answer = server.ask("POST", to, ada, data=FIELDS, files={"file": at_most})
    assert (answer.status_code, answer.json()["size"]) == (202, LARGEST)
    server.settled(answer.json()["id"], ada)


@pytest.mark.parametrize("begins", ["fields", "file"])
def test_a_cut_connection_leaves_no_file_and_a_cancelled_submission(
    server: Server, ada: str, poll: Callable[..., Any], begins: str
) -> None:
    kept, method = server.uploads(), f"Cut after {begins}"
    told = {"track": TRACK, "method": method} if begins == "fields" else {}
    fields = "".join(f'--b\r\nContent-Disposition: form-data; name="{n}"\r\n\r\n{v}\r\n' for n, v in told.items())
    file = '--b\r\nContent-Disposition: form-data; name="file"; filename="a.zip"\r\n\r\n'
    body = (fields + file).encode() + bytes(150_000)
    head = (
        f"POST /api/v1/submissions HTTP/1.1\r\nHost: x\r\nAuthorization: Bearer {ada}\r\n"
        f"Content-Type: multipart/form-data; boundary=b\r\nContent-Length: {2 * len(body)}\r\n\r\n"
    )
    host, port = server.url.removeprefix("http://").split(":")
    with socket.create_connection((host, int(port)), timeout=30) as connection:
        connection.sendall(head.encode() + body)
        poll(lambda: len(server.uploads()) > len(kept))
    poll(lambda: server.uploads() == kept)
    lines = server.cli("admin", "list", "--home", server.home).stdout.splitlines()
    ids = [line.split()[0] for line in lines if line.endswith(method)]
    states = [server.settled(one, ada) for one in ids]
    assert [(one["state"], one["sha256"], one["scores"]) for one in states] == (
        [("cancelled", None, None)] if begins == "fields" else []
    )
