"""A label file gives exactly its indices, or is refused with what is wrong and what to do."""

from __future__ import annotations

import struct
import zlib
from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import array_shapes, arrays
from numpy.typing import NDArray
from PIL import Image

from evaluator.benchmark import LOW_BITS
from evaluator.errors import HINTS, Code, Refused
from evaluator.labels import HEADER_BYTES, MAX_PIXELS, check_image_start, member_limit, read_cloud, read_image

if TYPE_CHECKING:
    from tests.evaluator.conftest import Make

pytestmark = pytest.mark.usefixtures("either_path")


Said = dict[str, str | None]
"""A problem or a warning as JSON."""

SHAPE = (2, 3)
LABELS = np.array([[0, 1, 2], [3, 4, 255]], np.uint8)
ROWS = b"\0\0\1\2" + b"\0\3\4\xff"  # LABELS, each row after the number of its filter
INTACT, MEMBER = "an intact PNG file", "V-01/1-2.png"


def problem(code: Code, expected: str | None = None, found: str | None = None, hint: str | None = None) -> Said:
    return {"member": MEMBER, "code": code.value, "expected": expected, "found": found, "hint": hint or HINTS[code]}


def refused(
    read: Callable[[bytes, str, tuple[int, ...] | None], object], data: bytes, shape: tuple[int, ...] | None = SHAPE
) -> Said:
    with pytest.raises(Refused) as caught:
        read(data, MEMBER, shape)
    return caught.value.problem.as_json()


@given(arrays(np.uint8, array_shapes(min_dims=2, max_dims=2, max_side=40)))
def test_grey_values_of_8_bits_are_the_labels(make: type[Make], labels: NDArray[np.uint8]) -> None:
    found = read_image(make.png(labels), "1-2.png", labels.shape)
    assert found.dtype == np.uint8
    np.testing.assert_array_equal(found, labels)


@pytest.mark.parametrize("bits", [1, 2, 4, 8])
@given(data=st.data())
def test_the_indices_of_a_palette_are_the_labels_whatever_its_colours(
    make: type[Make], bits: int, data: st.DataObject
) -> None:
    shape = data.draw(array_shapes(min_dims=2, max_dims=2, max_side=20))
    labels = data.draw(arrays(np.uint8, shape, elements=st.integers(0, 2**bits - 1)))
    png = make.png(labels, bits=bits)
    assert png[24:26] == bytes([bits, 3])
    np.testing.assert_array_equal(read_image(png, "1-2.png", shape), labels)


@pytest.mark.parametrize(
    ("mode", "found"), [("RGB", "8-bit RGB"), ("RGBA", "8-bit RGB with alpha"), ("LA", "8-bit greyscale with alpha")]
)
def test_a_picture_in_colours_is_told_to_save_indices(make: type[Make], mode: str, found: str | None) -> None:
    assert refused(read_image, make.png(LABELS, mode=mode)) == problem(
        Code.NOT_INDICES, "8-bit greyscale or a palette of indices", found
    )
    assert "painted" in HINTS[Code.NOT_INDICES]


@pytest.mark.parametrize(("depth", "row"), [(1, b"\0\0"), (2, b"\0\0"), (4, b"\0\0\0"), (16, bytes(7))])
def test_grey_of_other_than_8_bits_is_told_to_use_8(make: type[Make], depth: int, row: bytes) -> None:
    assert refused(read_image, make.raw_png((3, 2), row * 2, depth=depth)) == problem(
        Code.NOT_INDICES,
        "8-bit greyscale or a palette of indices",
        f"{depth}-bit greyscale",
        "Save the indices with 8 bits a pixel.",
    )


@pytest.mark.parametrize(("colour", "depth", "found"), [(3, 16, "16-bit palette"), (5, 8, "8-bit unknown")])
def test_a_header_that_png_does_not_know_has_no_indices(
    make: type[Make], colour: int, depth: int, found: str | None
) -> None:
    assert refused(read_image, make.raw_png((3, 2), ROWS, colour=colour, depth=depth)) == problem(
        Code.NOT_INDICES, "8-bit greyscale or a palette of indices", found
    )


def test_an_interlaced_picture_is_refused(make: type[Make]) -> None:
    assert refused(read_image, make.raw_png((3, 2), ROWS, interlaced=True)) == problem(
        Code.INTERLACED, "a PNG without interlacing", "Adam7 interlacing"
    )


def test_a_picture_of_another_size_is_told_got_and_expected(make: type[Make]) -> None:
    assert refused(read_image, make.png(np.zeros((4, 5)))) == problem(Code.WRONG_SIZE, "3x2 (width x height)", "5x4")


def test_a_picture_with_sides_swapped_is_told_to_transpose(make: type[Make]) -> None:
    assert refused(read_image, make.png(LABELS.T)) == problem(
        Code.WRONG_SIZE,
        "3x2 (width x height)",
        "2x3",
        "Transpose the array before you save it: height and width are swapped.",
    )


def test_without_a_known_size_any_size_is_read_up_to_a_bound_that_pillow_keeps(make: type[Make]) -> None:
    np.testing.assert_array_equal(read_image(make.png(LABELS), MEMBER), LABELS)
    assert refused(read_image, make.raw_png((1 << 14, (1 << 13) + 1), b""), None) == problem(
        Code.WRONG_SIZE, "at most 134217728 pixels", "16384x8193"
    )
    assert 2 * (Image.MAX_IMAGE_PIXELS or 0) > MAX_PIXELS


@pytest.mark.parametrize(("data", "found"), [(b"", "bytes …"), (b"GIF89a", "bytes 47494638…")])
def test_a_file_that_is_no_png_is_unreadable(data: bytes, found: str | None) -> None:
    assert refused(read_image, data) == problem(Code.UNREADABLE, "a PNG file", found)


def test_a_png_that_is_cut_off_anywhere_is_unreadable(make: type[Make]) -> None:
    whole = make.raw_png((3, 2), ROWS)
    for size in range(8, len(whole)):
        found = refused(read_image, whole[:size])
        assert found in [
            problem(Code.UNREADABLE, INTACT, "the file is cut off"),
            problem(Code.UNREADABLE, INTACT, "the file ends inside a chunk"),
        ]


def test_a_wrong_checksum_names_the_chunk(make: type[Make]) -> None:
    whole = bytearray(make.raw_png((3, 2), ROWS))
    whole[whole.index(b"IDAT") + 9] ^= 1
    assert refused(read_image, bytes(whole)) == problem(
        Code.UNREADABLE, INTACT, "the checksum of chunk b'IDAT' is wrong"
    )


@pytest.mark.parametrize(
    ("pixels", "found"),
    [
        (ROWS[:-1], "its pixel data is cut off: 7 of 8 bytes"),
        (ROWS + b"\0", "it has more pixel data than its size asks for"),
        (ROWS * 100_000, "it has more pixel data than its size asks for"),
        (b"", "its pixel data is cut off: 0 of 8 bytes"),
    ],
)
def test_pixel_data_that_does_not_fit_the_size_is_unreadable(
    make: type[Make], pixels: bytes, found: str | None
) -> None:
    assert refused(read_image, make.raw_png((3, 2), pixels)) == problem(Code.UNREADABLE, INTACT, found)


def png_of(make: type[Make], *chunks: tuple[bytes, bytes]) -> bytes:
    return b"\x89PNG\r\n\x1a\n" + b"".join(make.chunk(kind, body) for kind, body in chunks)


HEADER = (b"IHDR", struct.pack(">IIBBBBB", 3, 2, 8, 0, 0, 0, 0))
DATA, END = (b"IDAT", zlib.compress(ROWS)), (b"IEND", b"")
FIRST, SECOND = (b"IDAT", DATA[1][:5]), (b"IDAT", DATA[1][5:])


@pytest.mark.parametrize(
    ("chunks", "found"),
    [
        ([DATA, HEADER, END], "it does not begin with a header"),
        ([(b"IHDR", HEADER[1] + b"\0"), DATA, END], "it does not begin with a header"),
        ([HEADER, HEADER, DATA, END], "it has two headers"),
        ([HEADER, END], "it has no pixel data"),
        ([HEADER, FIRST, (b"tEXt", b"a\0b"), SECOND, END], "its pixel data is interrupted"),
        ([HEADER, (b"IDAT", DATA[1][:-2]), END], "its pixel data is cut off: 8 of 8 bytes"),
        ([HEADER, DATA, (b"IDAT", b"more"), END], "bytes follow its pixel data"),
        ([HEADER, (b"IDAT", DATA[1] + b"more"), END], "bytes follow its pixel data"),
        ([(b"IHDR", struct.pack(">IIBBBBB", 0, 2, 8, 0, 0, 0, 0)), DATA, END], "its header is not valid"),
        ([(b"IHDR", struct.pack(">IIBBBBB", 3, 2, 8, 0, 1, 0, 0)), DATA, END], "its header is not valid"),
        ([HEADER, DATA], "the file is cut off"),
    ],
)
def test_a_png_whose_parts_are_out_of_order_is_unreadable(
    make: type[Make], chunks: list[tuple[bytes, bytes]], found: str | None
) -> None:
    assert refused(read_image, png_of(make, *chunks)) == problem(Code.UNREADABLE, INTACT, found)


def test_pixel_data_that_cannot_be_inflated_is_unreadable(make: type[Make]) -> None:
    found = refused(read_image, png_of(make, HEADER, (b"IDAT", b"\x78\x9c\xff\xff\xff"), END))
    assert str(found["found"]).startswith("its pixel data cannot be inflated (Error -3 ")
    assert found == problem(Code.UNREADABLE, INTACT, found["found"])


def test_a_row_filter_that_png_does_not_know_is_unreadable(make: type[Make]) -> None:
    found = refused(read_image, make.raw_png((3, 2), b"\x09" + ROWS[1:]))
    assert found == problem(Code.UNREADABLE, INTACT, found["found"])


def test_bytes_after_the_end_of_the_picture_are_unreadable(make: type[Make]) -> None:
    assert refused(read_image, make.raw_png((3, 2), ROWS) + b"PK") == problem(
        Code.UNREADABLE, INTACT, "bytes follow the end of the picture"
    )


@pytest.mark.parametrize(
    "extra",
    [
        [(b"tEXt", b"Comment\0hello"), (b"zTXt", b"Comment\0\0" + zlib.compress(bytes(1 << 20)))],
        [(b"iCCP", b"broken"), (b"tRNS", b"\0\1"), (b"gAMA", b"odd")],
        [(b"acTL", struct.pack(">II", 1, 0)), (b"fcTL", struct.pack(">IIIIIHHBB", 0, 3, 2, 0, 0, 1, 1, 0, 0))],
    ],
)
def test_chunks_that_say_nothing_of_the_pixels_are_ignored(make: type[Make], extra: list[tuple[bytes, bytes]]) -> None:
    np.testing.assert_array_equal(read_image(png_of(make, HEADER, *extra, DATA, END), MEMBER, SHAPE), LABELS)


def test_of_an_animation_only_the_picture_counts(make: type[Make]) -> None:
    frame = (b"fdAT", bytes(4) + zlib.compress(bytes(8)))
    found = read_image(png_of(make, HEADER, (b"acTL", struct.pack(">II", 2, 0)), DATA, frame, END), MEMBER, SHAPE)
    np.testing.assert_array_equal(found, LABELS)


def test_pixel_data_in_several_pieces_is_one(make: type[Make]) -> None:
    found = read_image(png_of(make, HEADER, FIRST, (b"IDAT", b""), SECOND, (b"IDAT", b""), END), MEMBER, SHAPE)
    np.testing.assert_array_equal(found, LABELS)


@given(st.data())
def test_no_damage_gives_other_labels_or_anything_but_a_refusal(make: type[Make], data: st.DataObject) -> None:
    whole = bytearray(make.png(LABELS, bits=8))
    for _ in range(data.draw(st.integers(1, 3))):
        whole[data.draw(st.integers(0, len(whole) - 1))] = data.draw(st.integers(0, 255))
    try:
        found = read_image(bytes(whole), MEMBER, SHAPE)
    except Refused as refusal:
        assert refusal.problem.member == MEMBER
    else:
        np.testing.assert_array_equal(found, LABELS)


@pytest.mark.parametrize("size", [0, 20, HEADER_BYTES - 1])
def test_a_start_too_short_to_tell_is_not_judged(make: type[Make], size: int) -> None:
    check_image_start(make.png(LABELS.T)[:size], MEMBER, SHAPE)


def test_the_start_of_a_png_is_enough_to_refuse_its_kind_and_size(make: type[Make]) -> None:
    for whole in (make.png(LABELS, mode="RGB"), make.png(LABELS.T)):
        assert refused(check_image_start, whole[:HEADER_BYTES]) == refused(read_image, whole)
    check_image_start(make.png(LABELS)[:HEADER_BYTES], MEMBER, SHAPE)


@given(arrays(np.uint32, st.integers(0, 50)))
def test_the_lower_16_bits_of_a_point_are_its_label(make: type[Make], points: NDArray[np.uint32]) -> None:
    found = read_cloud(make.cloud(points), "1-2.label", points.shape)
    assert found.dtype == np.uint32
    np.testing.assert_array_equal(found & LOW_BITS, points % 65536)


def test_a_cloud_with_fewer_points_is_told_to_map_labels_back() -> None:
    assert refused(read_cloud, bytes(4 * 7), (10,)) == problem(Code.WRONG_POINT_COUNT, "10 points", "7 points")
    assert "voxel" in HINTS[Code.WRONG_POINT_COUNT]


@pytest.mark.parametrize(("size", "found"), [(10, "10 bytes"), (20, "5 points")])
def test_a_cloud_of_one_or_two_bytes_a_point_is_told_to_write_four(size: int, found: str | None) -> None:
    hint = "Write four bytes a point, little-endian uint32."
    assert refused(read_cloud, bytes(size), (10,)) == problem(Code.WRONG_POINT_COUNT, "10 points", found, hint)


def test_a_cloud_of_half_a_point_is_unreadable_where_no_size_is_known() -> None:
    assert refused(read_cloud, bytes(6), None) == problem(Code.UNREADABLE, "four bytes a point", "6 bytes")
    assert read_cloud(bytes(8), MEMBER).tolist() == [0, 0]


@given(st.integers(1, 64), st.integers(1, 64), st.integers(0, 9))
def test_any_png_of_the_right_size_is_within_its_limit(make: type[Make], height: int, width: int, seed: int) -> None:
    noise = np.random.default_rng(seed).integers(0, 256, (height, width))
    assert len(make.png(noise)) <= member_limit((height, width))


def test_a_cloud_is_as_large_as_its_limit() -> None:
    assert member_limit((10,)) == 40
