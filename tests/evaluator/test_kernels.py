"""The PNG reader agrees with Pillow, whatever filter, writer or size; and refuses where Pillow errs."""

from __future__ import annotations

import io
import zlib
from typing import TYPE_CHECKING, Literal

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from numpy.typing import NDArray
from PIL import Image

from evaluator.buffer import Buffer
from evaluator.errors import Refused
from evaluator.labels import read_image

if TYPE_CHECKING:
    from tests.evaluator.conftest import Make

pytestmark = pytest.mark.usefixtures("either_path")

sides = st.tuples(st.integers(1, 12), st.integers(1, 70))
busy = sides.flatmap(lambda shape: arrays(np.uint8, shape))
calm = sides.flatmap(lambda shape: arrays(np.uint8, shape, elements=st.sampled_from([0, 7, 255]), fill=st.just(7)))
blocky = calm.map(lambda labels: np.repeat(np.repeat(labels, 3, 0), 5, 1)[:, :150])
pictures = st.one_of(busy, calm, blocky)


def filtered(labels: NDArray[np.uint8], kinds: list[int]) -> bytes:
    """The rows of a picture under these filters, as the specification's section 9 writes them down."""
    rows, above = [], np.zeros(labels.shape[1], np.int64)
    for row, kind in zip(labels.astype(np.int64), kinds, strict=True):
        left, corner = np.concatenate([[0], row[:-1]]), np.concatenate([[0], above[:-1]])
        guess = left + above - corner
        a, b, c = abs(guess - left), abs(guess - above), abs(guess - corner)
        paeth = np.where((a <= b) & (a <= c), left, np.where(b <= c, above, corner))
        predicted = [0 * row, left, above, (left + above) // 2, paeth][kind]
        rows.append(bytes([kind]) + ((row - predicted) % 256).astype(np.uint8).tobytes())
        above = row
    return b"".join(rows)


@settings(max_examples=200)
@given(pictures, st.data())
def test_every_filter_is_undone(make: type[Make], labels: NDArray[np.uint8], data: st.DataObject) -> None:
    kinds = data.draw(st.lists(st.integers(0, 4), min_size=len(labels), max_size=len(labels)))
    whole = make.raw_png((labels.shape[1], labels.shape[0]), filtered(labels, kinds))
    np.testing.assert_array_equal(np.asarray(Image.open(io.BytesIO(whole))), labels)  # the test's own filters are right
    np.testing.assert_array_equal(read_image(whole, "a.png"), labels)


@given(st.lists(pictures, min_size=2, max_size=4))
def test_what_a_buffer_held_before_shows_nowhere(make: type[Make], many: list[NDArray[np.uint8]]) -> None:
    buffer = Buffer()
    for labels in many:
        np.testing.assert_array_equal(read_image(make.png(labels), "a.png", labels.shape, buffer), labels)


@pytest.mark.parametrize("optimize", [False, True])
@pytest.mark.parametrize("level", [0, 1, 6, 9])
@given(pictures)
def test_every_level_of_pillow_is_read(level: int, optimize: Literal[True, False], labels: NDArray[np.uint8]) -> None:
    stream = io.BytesIO()
    Image.fromarray(labels).save(stream, "PNG", compress_level=level, optimize=optimize)
    np.testing.assert_array_equal(read_image(stream.getvalue(), "a.png"), labels)


def pillow(data: bytes) -> NDArray[np.uint8] | None:
    try:
        with Image.open(io.BytesIO(data), formats=["PNG"]) as image:
            return np.asarray(image, np.uint8) if image.mode in ("L", "P") else None
    except (OSError, SyntaxError, ValueError, zlib.error):
        return None


@settings(max_examples=500)
@given(
    blocky,
    st.lists(st.tuples(st.integers(8, 4000), st.integers(0, 255)), min_size=1, max_size=3),
    st.sampled_from(["mended", "as it is"]),
)
def test_damage_is_refused_or_read_as_pillow_reads_it(
    make: type[Make], labels: NDArray[np.uint8], changes: list[tuple[int, int]], checksum: str
) -> None:
    whole = bytearray(make.png(labels))
    for position, value in changes:
        whole[position % len(whole)] = value
    if checksum == "mended":  # a checksum that fits damage hides it from everything but the reading itself
        at = whole.find(b"IDAT")
        length = int.from_bytes(whole[at - 4 : at], "big") if at > 4 else 0
        end = at + 4 + length
        if at > 4 and end + 4 <= len(whole):
            whole[end : end + 4] = zlib.crc32(whole[at:end]).to_bytes(4, "big")
    try:
        found = read_image(bytes(whole), "a.png")
    except Refused:
        return
    expected = pillow(bytes(whole))
    assert expected is not None
    np.testing.assert_array_equal(found, expected)


@given(blocky)
def test_what_opencv_writes_is_read(labels: NDArray[np.uint8]) -> None:
    cv2 = pytest.importorskip("cv2", reason="OpenCV, whose writer differs from Pillow's, is not installed")
    written, whole = cv2.imencode(".png", labels)
    assert written
    np.testing.assert_array_equal(read_image(whole.tobytes(), "a.png"), labels)
