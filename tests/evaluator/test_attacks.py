"""What somebody might send to take a worker down costs little and is refused by name."""

from __future__ import annotations

import struct
import zlib
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import pytest

from evaluator.archive import Archive
from evaluator.errors import LONGEST, Code, Problem, Refused
from evaluator.labels import FEWEST_CHUNKS, read_image

if TYPE_CHECKING:
    from tests.evaluator.conftest import Make, Planted

LABELS = np.zeros((2, 3), np.uint8)
ROWS = b"\0\0\0\0" * 2


def test_a_huge_directory_is_refused_before_it_is_read(tmp_path: Path) -> None:
    entry = struct.pack("<IHHHHHHIIIHHHHHII", 0x02014B50, 20, 20, 0, 0, 0, 0, 0, 0, 0, 1, 0, 0, 0, 0, 0, 0) + b"a"
    entries = 100_000
    end = struct.pack("<IHHHHIIH", 0x06054B50, 0, 0, 9, 9, len(entry) * entries, 4, 0)
    path = tmp_path / "many.zip"
    path.write_bytes(b"PK\3\4" + entry * entries + end)
    with pytest.raises(Refused) as caught:
        Archive(path, max_members=10_000)
    found = f"a directory of {len(entry) * entries} bytes"
    assert caught.value.problem == Problem(Code.TOO_MANY_MEMBERS, None, "at most 10000", found)


def test_a_png_of_countless_empty_chunks_is_refused(make: type[Make]) -> None:
    honest = make.raw_png((3, 2), ROWS, extra=make.chunk(b"tEXt", b"") * 1000)
    np.testing.assert_array_equal(read_image(honest, "a.png"), LABELS)
    with pytest.raises(Refused) as caught:
        read_image(make.raw_png((3, 2), ROWS, extra=make.chunk(b"tEXt", b"") * (FEWEST_CHUNKS + 300)), "a.png")
    assert caught.value.problem.found == "it is cut into far too many chunks"


def png(make: type[Make], *chunks: bytes, colour: int = 3) -> bytes:
    header = make.chunk(b"IHDR", struct.pack(">IIBBBBB", 3, 2, 8, colour, 0, 0, 0))
    return b"\x89PNG\r\n\x1a\n" + header + b"".join(chunks) + make.chunk(b"IEND", b"")


def test_palettes_and_critical_chunks_are_what_the_specification_says(make: type[Make]) -> None:
    pixels, palette = make.chunk(b"IDAT", zlib.compress(ROWS)), make.chunk(b"PLTE", bytes(6))
    np.testing.assert_array_equal(read_image(png(make, palette, pixels), "a.png"), LABELS)
    wrong = {
        "its palette is not valid": [
            [make.chunk(b"PLTE", b""), pixels],
            [make.chunk(b"PLTE", bytes(4)), pixels],
            [make.chunk(b"PLTE", bytes(771)), pixels],
            [palette, palette, pixels],
            [palette, pixels, palette],
        ],
        "it has no palette": [[pixels]],
        "chunk b'ABCD' is unknown and must not be ignored": [[palette, make.chunk(b"ABCD", b""), pixels]],
    }
    for found, files in wrong.items():
        for chunks in files:
            with pytest.raises(Refused) as caught:
                read_image(png(make, *chunks), "a.png")
            assert caught.value.problem.found == found


def test_a_crowd_of_rivals_names_a_few(demo: Planted, make: type[Make], tmp_path: Path) -> None:
    members = demo.flat("3d-val")
    name, data = next(iter(members.items()))
    crowd = {f"{'a' * 150}{i}/{name}": data for i in range(50)}
    problems = demo.score(make.zip(tmp_path / "a.zip", members | crowd), "3d-val").problems
    assert [one.code for one in problems] == [Code.DUPLICATE_FRAME]
    found = problems[0].found or ""
    assert (found.count("/"), len(found) <= LONGEST) in {(2, True), (1, True)}


def test_what_an_archive_has_a_say_in_is_cut_and_made_visible() -> None:
    problem = Problem(Code.WRONG_TYPE, "a\u2028b" * 200, "x" * 301, "\u202e<b>\0", None)
    assert problem.member is not None
    assert (len(problem.member), problem.member[:5], problem.member[-1]) == (LONGEST, "a\ufffdba\ufffd", "…")
    assert problem.expected == "x" * 299 + "…"
    assert (problem.found, problem.hint) == ("\ufffd<b>\ufffd", None)
