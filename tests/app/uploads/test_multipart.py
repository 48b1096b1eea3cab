"""A form as it arrives, in whatever blocks the network cuts it into."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator, Iterable, Sequence
from itertools import pairwise

import pytest
from fastapi import Request
from hypothesis import given, settings
from hypothesis import strategies as st

from app.errors import Invalid, Refusal, TooLarge, UnsupportedMedia
from app.uploads.multipart import (
    FORM_OVERHEAD,
    MAX_FIELD,
    MAX_FIELDS,
    Field,
    FileBegins,
    FileBytes,
    FileEnds,
    Part,
    parts,
)

BOUNDARY = "b0undary"
ROOM = 1 << 20


def form(*sections: tuple[str, str | None, bytes], boundary: str = BOUNDARY) -> bytes:
    """The body of name, file name and content of each part, as curl writes it."""
    made = []
    for name, filename, content in sections:
        said = f'Content-Disposition: form-data; name="{name}"'
        said += f'; filename="{filename}"\r\nContent-Type: application/zip' if filename is not None else ""
        made.append(f"--{boundary}\r\n{said}\r\n\r\n".encode() + content + b"\r\n")
    return b"".join(made) + f"--{boundary}--\r\n".encode()


def read(
    blocks: Iterable[bytes],
    *,
    content_type: str = f"multipart/form-data; boundary={BOUNDARY}",
    max_bytes: int = ROOM,
    length: str | None = None,
) -> list[Part]:
    """The parts of a body that comes in these blocks, neighbouring bytes of the file joined."""
    headers = [(b"content-type", content_type.encode("latin-1"))]
    headers += [(b"content-length", length.encode("latin-1"))] if length is not None else []
    waiting = [*blocks, b""]

    async def receive() -> dict[str, object]:
        block = waiting.pop(0)
        return {"type": "http.request", "body": block, "more_body": bool(waiting)}

    async def collect(stream: AsyncIterator[Part]) -> list[Part]:
        return [part async for part in stream]

    request = Request({"type": "http", "method": "POST", "headers": headers}, receive)
    got: list[Part] = []
    for part in asyncio.run(collect(parts(request, max_bytes=max_bytes))):
        if isinstance(part, FileBytes) and got and isinstance(got[-1], FileBytes):
            got[-1] = FileBytes(got[-1].data + part.data)
        else:
            got.append(part)
    return got


def refusal(blocks: Sequence[bytes], **how: str) -> Refusal:
    with pytest.raises(Refusal) as caught:
        read(blocks, **how)  # type: ignore[arg-type]
    return caught.value


def cut(body: bytes, at: Iterable[int]) -> list[bytes]:
    return [body[start:end] for start, end in pairwise(sorted({0, *(n % len(body) for n in at), len(body)}))]


SAMPLE = form(("track", None, b"2d-val"), ("method", None, "Wäld".encode()), ("file", "my.zip", b"PK\r\n--b0undar"))
SAMPLE_PARTS = [
    Field("track", "2d-val"),
    Field("method", "Wäld"),
    FileBegins("my.zip"),
    FileBytes(b"PK\r\n--b0undar"),
    FileEnds(),
]
nearly = st.lists(
    st.sampled_from(
        [b"\r\n", b"--", b"\r", b"\n", b"\r\n--", b"--b0und", b"\r\n--b0undar", b"b0undary", b"\x00", b"PK"]
    ),
    max_size=12,
).map(b"".join)
content = nearly.filter(lambda data: f"\r\n--{BOUNDARY}".encode() not in b"\r\n" + data)


@settings(deadline=None, max_examples=200)
@given(st.lists(st.integers(0, 10_000), max_size=30))
def test_any_cut_of_a_body_into_blocks_gives_the_same_parts(at: list[int]) -> None:
    assert read(cut(SAMPLE, at)) == SAMPLE_PARTS


def test_a_body_that_comes_byte_by_byte_gives_the_same_parts() -> None:
    assert read([bytes([one]) for one in SAMPLE]) == SAMPLE_PARTS


@settings(deadline=None, max_examples=200)
@given(content, st.lists(st.integers(0, 10_000), max_size=8))
def test_a_file_full_of_bytes_that_nearly_are_a_boundary_arrives_unchanged(data: bytes, at: list[int]) -> None:
    middle: list[Part] = [FileBytes(data)] if data else []
    assert read(cut(form(("file", "a.zip", data)), at)) == [FileBegins("a.zip"), *middle, FileEnds()]


@pytest.mark.parametrize("boundary", ["-" * 60, "a b", "'()+_,-./:=?", "x"])
def test_unusual_boundaries_that_the_standard_allows_are_understood(boundary: str) -> None:
    body = form(("track", None, b"t"), boundary=boundary)
    assert read([body], content_type=f'multipart/form-data; boundary="{boundary}"') == [Field("track", "t")]


@settings(deadline=None, max_examples=100)
@given(st.integers(0, len(SAMPLE) - 5), st.lists(st.integers(0, 10_000), max_size=4))
def test_a_body_that_is_cut_short_is_refused_wherever_it_ends(end: int, at: list[int]) -> None:
    assert refusal(cut(SAMPLE[:end], at) if end else []).code == "bad_form"


@settings(deadline=None, max_examples=200)
@given(st.lists(st.sampled_from([*(bytes([b]) for b in b"\r\n-:;\x00\xff a"), b"--b0undary", *SAMPLE.split(b" ")])))
def test_a_damaged_body_is_refused_or_read_but_never_breaks_the_server(pieces: list[bytes]) -> None:
    try:
        read(pieces)
    except Invalid as refused:
        assert refused.code == "bad_form"


def test_what_stands_before_or_after_the_form_is_no_part_of_it() -> None:
    assert read([b"\r\n", form(("track", None, b"t")), b"\r\nand a tail"]) == [Field("track", "t")]


@pytest.mark.parametrize(
    "content_type",
    ["", "application/json", "application/x-www-form-urlencoded", "multipart/form-data", "multipart/mixed; boundary=x"],
)
def test_a_body_of_another_type_is_refused_with_its_reason(content_type: str) -> None:
    refused = refusal([SAMPLE], content_type=content_type)
    assert (type(refused), refused.code) == (UnsupportedMedia, "not_multipart")


def test_a_boundary_that_is_too_long_is_refused() -> None:
    assert refusal([b""], content_type=f"multipart/form-data; boundary={'x' * 5000}").code == "bad_form"


@pytest.mark.parametrize(
    ("body", "code"),
    [
        (form(("track", None, b"x" * (MAX_FIELD + 1))), "bad_form"),
        (form(*[(f"f{n}", None, b"") for n in range(MAX_FIELDS + 1)]), "bad_form"),
        (form(("method", None, b"\xff\xfe")), "bad_form"),
        (b"--b0undary\r\n" + b"X" * 100_000 + b": 1\r\n\r\n\r\n--b0undary--\r\n", "bad_form"),
        (b"--b0undary\r\n" + b"A: b\r\n" * 1000 + b"\r\n\r\n--b0undary--\r\n", "bad_form"),
        (b"", "bad_form"),
    ],
    ids=["long field", "many fields", "not UTF-8", "long header", "many headers", "empty"],
)
def test_a_form_with_too_much_of_something_is_refused(body: bytes, code: str) -> None:
    assert refusal(cut(body, range(0, 100_000, 1000)) if body else []).code == code


def test_a_field_of_the_longest_length_is_read() -> None:
    longest = "ä" * (MAX_FIELD // 2)
    assert read([form(("method", None, longest.encode()))]) == [Field("method", longest)]


def test_a_form_that_says_it_is_too_large_is_refused_before_a_byte_is_read() -> None:
    with pytest.raises(TooLarge) as caught:
        read([], max_bytes=10, length=str(10 + FORM_OVERHEAD + 1))
    assert caught.value.detail == "an upload has at most 10 bytes"


def test_a_form_that_does_not_say_its_size_is_refused_once_it_is_too_large() -> None:
    body = form(("file", "a.zip", b"x" * (FORM_OVERHEAD + 11)))
    with pytest.raises(TooLarge):
        read(cut(body, range(0, len(body), 5000)), max_bytes=10)


@pytest.mark.parametrize("length", ["", "-1", "many", "\N{SUPERSCRIPT TWO}", "0x10"])
def test_a_size_that_is_no_number_is_not_believed(length: str) -> None:
    assert read([SAMPLE], length=length) == SAMPLE_PARTS
