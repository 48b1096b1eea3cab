"""Inflating and checksums: libdeflate in one shot where it is installed (extra `fast`), zlib where it is not.

libdeflate answers yes or no. What it declines, zlib looks at again and says why, so that what is told never depends on
which of them is installed.
"""

from __future__ import annotations

import zlib
from collections.abc import Sequence
from contextlib import suppress

from evaluator.compiled import libdeflate

Bytes = bytes | bytearray | memoryview
_RAW = -15


def crc32(data: Bytes) -> int:
    """The CRC-32 of zip and PNG."""
    fast = libdeflate()
    return int(zlib.crc32(data) if fast is None else fast.crc32(data))


class InflateError(Exception):
    """Compressed data is damaged, or is not of the size that it must have; the text says how."""


def inflate_member(data: Bytes, size: int) -> bytes | bytearray:
    """A member of a zip archive: raw deflate, exactly `size` bytes.

    Raises:
        InflateError: it is damaged, or holds more or fewer bytes.
    """
    fast = libdeflate()
    if fast is not None:
        with suppress(fast.DeflateError, MemoryError):
            whole: bytearray = fast.deflate_decompress(data, size)
            if len(whole) == size:
                return whole
    stream = zlib.decompressobj(_RAW)
    try:
        found = stream.decompress(data, size + 1)
    except zlib.error as error:
        raise InflateError(str(error)) from error
    if len(found) > size:
        raise InflateError(f"it holds more than {size} bytes")
    if not stream.eof:
        raise InflateError(f"it ends early: {len(found)} of {size} bytes")
    if len(found) != size:
        raise InflateError(f"it holds {len(found)} bytes instead of {size}")
    return found


def inflate_pixels(parts: Sequence[Bytes], size: int) -> bytes | bytearray:
    """The pixel data of a PNG: a zlib stream in parts, exactly `size` bytes, ended by their Adler-32 and nothing else.

    Raises:
        InflateError: it is damaged, or holds more or fewer bytes.
    """
    data = parts[0] if len(parts) == 1 else b"".join(parts)
    ending = int.from_bytes(data[-4:], "big")
    fast = libdeflate()
    if fast is not None:
        with suppress(fast.DeflateError, MemoryError):
            whole: bytearray = fast.zlib_decompress(data, size)
            if len(whole) == size and fast.adler32(whole) == ending:
                return whole
    stream = zlib.decompressobj()
    try:
        found = stream.decompress(data, size + 1)
    except zlib.error as error:
        raise InflateError(f"its pixel data cannot be inflated ({error})") from error
    if len(found) > size:
        raise InflateError("it has more pixel data than its size asks for")
    if len(found) != size or not stream.eof:
        raise InflateError(f"its pixel data is cut off: {len(found)} of {size} bytes")
    if zlib.adler32(found) != ending:
        raise InflateError("bytes follow its pixel data")
    return found
