"""PNG and .label bytes, which nobody vouches for, as arrays of label values."""

from __future__ import annotations

import io
import struct
import warnings
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from evaluator.buffer import PADDING, Buffer, window
from evaluator.compiled import kernels
from evaluator.errors import Code, Problem, Refused
from evaluator.inflate import Bytes, InflateError, crc32, inflate_pixels

PNG_SIGNATURE = b"\x89PNG\r\n\x1a\n"
HEADER_BYTES = 33
"""Of a PNG: its signature and the whole of its first chunk."""
GREY, PALETTE = 0, 3
FEWEST_CHUNKS, CHUNK_BYTES = 4096, 256
"""A PNG may have so many chunks, and another for so many bytes: each takes time to look at."""
PALETTE_BYTES = range(3, 769, 3)
PAETH = 4
"""The last of a PNG row's filters."""
COLOUR_TYPES = {0: "greyscale", 2: "RGB", 3: "palette", 4: "greyscale with alpha", 6: "RGB with alpha"}
MAX_PIXELS = 1 << 27
"""The bound where no size is known beforehand; Pillow takes no more than 178 million pixels."""


@dataclass(frozen=True)
class Header:
    """What a PNG says of itself."""

    width: int
    height: int
    depth: int
    colour: int
    interlaced: bool

    @property
    def row_bytes(self) -> int:
        """Bytes of one filtered row: the filter's number and the packed pixels."""
        return 1 + (self.width * self.depth + 7) // 8


def member_limit(shape: tuple[int, ...]) -> int:
    """How many bytes a label file of this shape may hold at the most.

    Args:
        shape: (height, width) of an image, (points,) of a cloud.

    Returns:
        Exactly four bytes a point; for a PNG its raw pixels, uncompressed, and room for other chunks.
    """
    if len(shape) == 1:
        return 4 * shape[0]
    raw = shape[0] * (shape[1] + 1)
    return raw + raw // 64 + (1 << 20)


def read_image(
    data: Bytes, member: str, shape: tuple[int, ...] | None = None, buffer: Buffer | None = None
) -> NDArray[np.uint8]:
    """Decode a label map, in which grey values or palette indices are the labels.

    Args:
        data: a PNG file.
        member: its name, for the problem that is raised.
        shape: the (height, width) that it must have; any when omitted.
        buffer: where the labels go; memory of their own when omitted.

    Returns:
        Shape (height, width), in the buffer's memory, good until that is used again.

    Raises:
        Refused: it is no PNG, is damaged, has another size, or its pixels are not indices.
    """
    if bytes(data[: len(PNG_SIGNATURE)]) != PNG_SIGNATURE:
        raise Refused(Problem(Code.UNREADABLE, member, expected="a PNG file", found=f"bytes {bytes(data[:4]).hex()}…"))
    try:
        header, pixels = _walk(data)
    except _DamagedError as error:
        raise Refused(Problem(Code.UNREADABLE, member, expected="an intact PNG file", found=str(error))) from error
    _check_header(header, member, shape)
    try:
        raw = inflate_pixels(pixels, header.height * header.row_bytes)
        rows = np.frombuffer(raw, np.uint8).reshape(header.height, header.row_bytes)
        if rows[:, 0].max() > PAETH:
            raise _DamagedError("a row's filter is unknown")
    except (InflateError, _DamagedError) as error:
        raise Refused(Problem(Code.UNREADABLE, member, expected="an intact PNG file", found=str(error))) from error
    buffer = buffer or Buffer()
    labels = buffer.take(header.height * header.width).reshape(header.height, header.width)
    fast = kernels()
    if fast is not None and header.depth == 8 and rows.size > PADDING:  # noqa: PLR2004 a byte a pixel
        flat = rows.reshape(-1)
        fast.unfilter(flat, window(flat), header.height, header.width, buffer.memory, buffer.window)
    else:
        labels[:] = _decode(data, member)
    return labels


def _decode(data: Bytes, member: str) -> NDArray[np.uint8]:
    """What Pillow makes of a PNG that has passed every check."""
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # a large picture is what was asked for
            with Image.open(io.BytesIO(_essential(data)), formats=["PNG"]) as image:
                return np.asarray(image, np.uint8)
    except (OSError, SyntaxError, ValueError) as error:
        raise Refused(Problem(Code.UNREADABLE, member, expected="an intact PNG file", found=str(error))) from error


def read_cloud(data: Bytes, member: str, shape: tuple[int, ...] | None = None) -> NDArray[np.uint32]:
    """The points of a cloud's label file: little-endian uint32, of which the lower 16 bits are the label.

    Args:
        data: a SemanticKITTI .label file.
        member: its name, for the problem that is raised.
        shape: the (points,) that it must have; any when omitted.

    Returns:
        Shape (points,).

    Raises:
        Refused: it has another number of points, or no whole number of them.
    """
    check_cloud_size(len(data), member, shape)
    return np.frombuffer(data, "<u4").astype(np.uint32, copy=False)


def check_cloud_size(size: int, member: str, shape: tuple[int, ...] | None) -> None:
    """Refuse a label file of a cloud by its size in bytes, before it is read.

    Raises:
        Refused: it has another number of points than the shape (points,), or no whole number of them.
    """
    if shape is not None and size != 4 * shape[0]:
        found = f"{size // 4} points" if size % 4 == 0 else f"{size} bytes"
        others = (shape[0], 2 * shape[0], 8 * shape[0])  # uint8, uint16, int64
        hint = "Write four bytes a point, little-endian uint32." if size in others else None
        raise Refused(Problem(Code.WRONG_POINT_COUNT, member, f"{shape[0]} points", found, hint))
    if size % 4:
        raise Refused(Problem(Code.UNREADABLE, member, "four bytes a point", f"{size} bytes"))


def check_image_start(start: bytes, member: str, shape: tuple[int, ...] | None) -> None:
    """Refuse a label map by its first `HEADER_BYTES` bytes, before it is read.

    Raises:
        Refused: they say that it has another size, or that its pixels are not indices.
    """
    if len(start) == HEADER_BYTES and start.startswith(PNG_SIGNATURE) and start[12:16] == b"IHDR":
        _check_header(_header(start, len(PNG_SIGNATURE) + 8), member, shape)


class _DamagedError(Exception):
    """What is wrong inside a PNG."""


def _chunks(data: Bytes) -> Iterator[tuple[bytes, int, int]]:
    """Type, start and end of the body of each chunk, checksums verified, to the IEND that ends the file."""
    position, left = len(PNG_SIGNATURE), FEWEST_CHUNKS + len(data) // CHUNK_BYTES
    while position + 12 <= len(data):
        left -= 1
        if left < 0:
            raise _DamagedError("it is cut into far too many chunks")
        length, kind = struct.unpack_from(">I4s", data, position)
        start, end = position + 8, position + 8 + length
        if end + 4 > len(data):
            raise _DamagedError("the file ends inside a chunk")
        if crc32(memoryview(data)[position + 4 : end]) != struct.unpack_from(">I", data, end)[0]:
            raise _DamagedError(f"the checksum of chunk {kind!r} is wrong")
        yield kind, start, end
        position = end + 4
        if kind == b"IEND":
            if position != len(data):
                raise _DamagedError("bytes follow the end of the picture")
            return
    raise _DamagedError("the file is cut off")


def _walk(data: Bytes) -> tuple[Header, list[Bytes]]:  # noqa: C901, PLR0912 one loop over chunks, a rule a kind
    header, ended, palette = None, False, False
    pixels: list[Bytes] = []
    for kind, start, end in _chunks(data):
        if header is None:
            if kind != b"IHDR" or end - start != HEADER_BYTES - 20:
                raise _DamagedError("it does not begin with a header")
            header = _header(data, start)
            if not header.width or not header.height or data[start + 10] or data[start + 11]:
                raise _DamagedError("its header is not valid")
        elif kind == b"IHDR":
            raise _DamagedError("it has two headers")
        elif kind == b"PLTE":
            if palette or pixels or end - start not in PALETTE_BYTES:
                raise _DamagedError("its palette is not valid")
            palette = True
        elif kind == b"IDAT":
            if ended:
                raise _DamagedError("its pixel data is interrupted")
            pixels.append(memoryview(data)[start:end])
        elif kind[:1].isupper() and kind != b"IEND":
            raise _DamagedError(f"chunk {kind!r} is unknown and must not be ignored")
        elif pixels:
            ended = True
    if header is None or not pixels:
        raise _DamagedError("it has no pixel data")
    if header.colour == PALETTE and not palette:
        raise _DamagedError("it has no palette")
    return header, pixels


def _header(data: Bytes, start: int) -> Header:
    width, height, depth, colour, _, _, interlace = struct.unpack_from(">IIBBBBB", data, start)
    return Header(width, height, depth, colour, bool(interlace))


def _essential(data: Bytes) -> bytes:
    """The PNG without chunks that say nothing of its pixels' values (they may be bombs, and APNG is no picture)."""
    kept: list[Bytes] = [PNG_SIGNATURE]
    kept += [data[a - 8 : b + 4] for kind, a, b in _chunks(data) if kind in (b"IHDR", b"PLTE", b"IDAT", b"IEND")]
    return b"".join(kept)


def _check_header(header: Header, member: str, shape: tuple[int, ...] | None) -> None:
    found = f"{header.depth}-bit {COLOUR_TYPES.get(header.colour, 'unknown')}"
    fine = header.depth == 8 if header.colour == GREY else header.depth in (1, 2, 4, 8)  # noqa: PLR2004 bits
    if header.colour not in (GREY, PALETTE) or not fine:
        hint = None
        if header.colour == GREY:
            hint = "Save the indices with 8 bits a pixel."
        raise Refused(Problem(Code.NOT_INDICES, member, "8-bit greyscale or a palette of indices", found, hint))
    if header.interlaced:
        raise Refused(Problem(Code.INTERLACED, member, "a PNG without interlacing", "Adam7 interlacing"))
    size = (header.height, header.width)
    if shape is not None and size != shape:
        said = "height and width are swapped" if size == (shape[1], shape[0]) else None
        hint = f"Transpose the array before you save it: {said}." if said else None
        wanted = f"{shape[1]}x{shape[0]} (width x height)"
        raise Refused(Problem(Code.WRONG_SIZE, member, wanted, f"{header.width}x{header.height}", hint))
    if shape is None and header.width * header.height > MAX_PIXELS:
        raise Refused(
            Problem(Code.WRONG_SIZE, member, f"at most {MAX_PIXELS} pixels", f"{header.width}x{header.height}")
        )
