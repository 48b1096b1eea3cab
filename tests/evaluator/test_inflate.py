"""Inflating gives the same bytes and the same reasons with libdeflate as without."""

from __future__ import annotations

import itertools
import zlib

import pytest
from hypothesis import given
from hypothesis import strategies as st

from evaluator.inflate import InflateError, crc32, inflate_member, inflate_pixels

pytestmark = pytest.mark.usefixtures("either_path")


def raw(data: bytes, level: int = 6) -> bytes:
    stream = zlib.compressobj(level, zlib.DEFLATED, -15)
    return stream.compress(data) + stream.flush()


@given(st.binary(max_size=2000), st.integers(0, 9))
def test_a_member_comes_back_whatever_its_level(data: bytes, level: int) -> None:
    assert inflate_member(raw(data, level), len(data)) == data
    assert crc32(data) == zlib.crc32(data)


@given(st.binary(max_size=2000), st.integers(0, 9), st.lists(st.integers(0, 2000), max_size=4))
def test_pixel_data_comes_back_however_it_is_cut(data: bytes, level: int, cuts: list[int]) -> None:
    whole = zlib.compress(data, level)
    ends = sorted({min(cut, len(whole)) for cut in cuts} | {0, len(whole)})
    parts = [whole[a:b] for a, b in itertools.pairwise(ends)]
    assert inflate_pixels(parts, len(data)) == data


def reason(function: object, *given_: object) -> str:
    with pytest.raises(InflateError) as caught:
        function(*given_)  # type: ignore[operator]
    return str(caught.value)


def test_a_member_says_what_is_wrong_with_it() -> None:
    packed = raw(b"abc" * 100)
    assert reason(inflate_member, packed, 299) == "it holds more than 299 bytes"
    assert reason(inflate_member, packed, 301) == "it holds 300 bytes instead of 301"
    assert reason(inflate_member, packed[:-2], 300).startswith("it ends early: ")
    assert reason(inflate_member, b"\xff" + packed[1:], 300) == "Error -3 while decompressing data: invalid block type"


def test_pixel_data_says_what_is_wrong_with_it() -> None:
    packed = zlib.compress(b"abc" * 100)
    assert reason(inflate_pixels, [packed], 299) == "it has more pixel data than its size asks for"
    assert reason(inflate_pixels, [packed], 301) == "its pixel data is cut off: 300 of 301 bytes"
    assert reason(inflate_pixels, [packed[:-1]], 300) == "its pixel data is cut off: 300 of 300 bytes"
    assert reason(inflate_pixels, [packed, b"more"], 300) == "bytes follow its pixel data"
    wrong = packed[:-1] + bytes([packed[-1] ^ 1])
    said = "its pixel data cannot be inflated (Error -3 while decompressing data: incorrect data check)"
    assert reason(inflate_pixels, [wrong], 300) == said
    assert reason(inflate_pixels, [b""], 300) == "its pixel data is cut off: 0 of 300 bytes"


@given(st.binary(max_size=300), st.data())
def test_damage_is_never_taken_for_the_data(data: bytes, draw: st.DataObject) -> None:
    whole = bytearray(zlib.compress(data))
    at = draw.draw(st.integers(0, len(whole) - 1))
    whole[at] ^= draw.draw(st.integers(1, 255))
    try:
        found = inflate_pixels([bytes(whole)], len(data))
    except InflateError:
        return
    assert found == data  # a changed bit that means nothing, such as the level in the header
