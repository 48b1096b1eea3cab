"""An archive is refused as a whole for what makes it unsafe, and read member by member when it is not."""

from __future__ import annotations

import io
import stat
import struct
import tempfile
import zipfile
from pathlib import Path
from typing import TYPE_CHECKING

import pytest
from hypothesis import given
from hypothesis import strategies as st

from evaluator.archive import Archive, Member, shown
from evaluator.errors import HINTS, Code, Refused

if TYPE_CHECKING:
    from tests.evaluator.conftest import Make

pytestmark = pytest.mark.usefixtures("either_path")


Said = dict[str, str | None]
"""A problem or a warning as JSON."""


def problem(code: Code, member: str | None = None, expected: str | None = None, found: str | None = None) -> Said:
    return {"member": member, "code": code.value, "expected": expected, "found": found, "hint": HINTS[code]}


def refused(path: Path, most: int = 50) -> Said:
    with pytest.raises(Refused) as caught:
        Archive(path, max_members=most)
    return caught.value.problem.as_json()


def entry(name: str, mode: int = 0o100644, system: int = 3) -> zipfile.ZipInfo:
    info = zipfile.ZipInfo("x")
    info.filename, info.create_system, info.external_attr = name, system, mode << 16
    return info


def patched(data: bytes, old: bytes, new: bytes, count: int) -> bytes:
    """The archive with bytes replaced where they stand; `count` says in how many places."""
    assert data.count(old) == count
    assert len(old) == len(new)
    return data.replace(old, new)


def as_file(tmp_path: Path, data: bytes | bytearray) -> Path:
    path = tmp_path / "odd.zip"
    path.write_bytes(data)
    return path


@pytest.mark.parametrize(
    ("data", "found"),
    [
        (b"", "an empty file"),
        (b"hello", "another kind of file"),
        (b"Rar!\x1a\x07\x00" + bytes(100), "a RAR archive"),
        (b"7z\xbc\xaf" + bytes(100), "a 7z archive"),
        (b"\x1f\x8b" + bytes(100), "a gzip file"),
    ],
)
def test_a_file_that_is_no_zip_is_told_what_it_is(tmp_path: Path, data: bytes, found: str) -> None:
    assert refused(as_file(tmp_path, data)) == problem(Code.NOT_A_ZIP, None, "a zip archive", found)


def test_a_zip_that_is_cut_off_is_damaged(tmp_path: Path, make: type[Make]) -> None:
    whole = make.zip(tmp_path / "whole.zip", {"a.png": bytes(range(256))}).read_bytes()
    for size in range(4, len(whole), 7):
        assert refused(as_file(tmp_path, whole[:size])) == problem(
            Code.DAMAGED_ARCHIVE, None, "a zip archive", "File is not a zip file"
        )


def test_a_directory_that_is_overwritten_is_damaged(tmp_path: Path, make: type[Make]) -> None:
    whole = make.zip(tmp_path / "whole.zip", {"a.png": b"1"}).read_bytes()
    assert refused(as_file(tmp_path, patched(whole, b"PK\x01\x02", b"PK\x09\x09", 1))) == problem(
        Code.DAMAGED_ARCHIVE, None, "a zip archive", "Bad magic number for central directory"
    )


def test_an_encrypted_member_is_refused(tmp_path: Path, make: type[Make]) -> None:
    whole = bytearray(make.zip(tmp_path / "whole.zip", {"a.png": b"secret"}).read_bytes())
    whole[whole.index(b"PK\x01\x02") + 8] |= 1
    assert refused(as_file(tmp_path, whole)) == problem(Code.ENCRYPTED_MEMBER, "a.png")


@pytest.mark.parametrize(("method", "number"), [(zipfile.ZIP_BZIP2, 12), (zipfile.ZIP_LZMA, 14)])
def test_compression_other_than_deflate_is_refused(tmp_path: Path, make: type[Make], method: int, number: int) -> None:
    assert refused(make.zip(tmp_path / "odd.zip", {"a.png": b"1" * 99}, method)) == problem(
        Code.UNSUPPORTED_COMPRESSION, "a.png", "deflate or none", f"method {number}"
    )


@pytest.mark.parametrize(
    ("kind", "found"),
    [(stat.S_IFLNK, "a link"), (stat.S_IFIFO, "a device or pipe"), (stat.S_IFCHR, "a device or pipe")],
)
def test_a_member_that_is_no_regular_file_is_refused(
    tmp_path: Path, make: type[Make], kind: int, found: str | None
) -> None:
    path = make.zip(tmp_path / "odd.zip", [(entry("a.png", kind | 0o777), b"/etc/passwd")])
    assert refused(path) == problem(Code.SPECIAL_FILE, "a.png", "a regular file", found)


@pytest.mark.parametrize(
    ("name", "printed"),
    [
        ("../a.png", "../a.png"),
        ("a/../../b.png", "a/../../b.png"),
        ("a/..", "a/.."),
        ("..\\a.png", "..\\a.png"),
        ("/a.png", "/a.png"),
        ("\\\\server\\a.png", "\\\\server\\a.png"),
        ("C:/a.png", "C:/a.png"),
        ("c:a.png", "c:a.png"),
        ("a.png\x00.exe", "a.png\ufffd.exe"),
        ("a\nb.png", "a\ufffdb.png"),
        ("a\x1b[31m.png", "a\ufffd[31m.png"),
        ("a\x7f.png", "a\ufffd.png"),
        ("a\x85.png", "a\ufffd.png"),
        ("a\u202egnp.exe", "a\ufffdgnp.exe"),
        ("a\u2066.png", "a\ufffd.png"),
        ("a\u200f.png", "a\ufffd.png"),
        ("__MACOSX/../a.png", "__MACOSX/../a.png"),
        ("../", "../"),
    ],
)
def test_a_name_that_could_escape_or_fool_refuses_the_archive_wherever_it_stands(
    tmp_path: Path, make: type[Make], name: str, printed: str
) -> None:
    members: list[tuple[str | zipfile.ZipInfo, bytes]] = [
        (entry("V-01/"), b""),
        ("README", b"fine"),
        (entry(name), b""),
    ]
    assert refused(make.zip(tmp_path / "odd.zip", members)) == problem(
        Code.UNSAFE_NAME, printed, "a plain relative name", ascii(name)
    )


def test_a_second_name_in_an_extra_field_cannot_smuggle_a_path(tmp_path: Path, make: type[Make]) -> None:
    hidden = struct.pack("<BI", 1, 0xE8B7BE43) + b"../b"  # 0x7075: the name again, in UTF-8, and the checksum of "a"
    info = entry("a")
    info.extra = struct.pack("<HH", 0x7075, len(hidden)) + hidden
    path = make.zip(tmp_path / "odd.zip", [(info, b"")])
    try:
        with Archive(path, max_members=1) as archive:
            assert [member.name for member in archive.members] == ["a"]
    except Refused as refusal:
        assert refusal.problem.code is Code.UNSAFE_NAME


@pytest.mark.parametrize("name", ["a..png", "..a/b.png", "a../b.png", "ä/ö.png", "a b.png", "V-01\\a.png", "日本.png"])
def test_a_name_that_only_looks_odd_is_accepted(tmp_path: Path, make: type[Make], name: str) -> None:
    with Archive(make.zip(tmp_path / "fine.zip", {name: b"1"}), max_members=1) as archive:
        assert archive.members == (Member(name, 1, 0),)


def test_an_archive_with_more_members_than_allowed_is_refused(tmp_path: Path, make: type[Make]) -> None:
    path = make.zip(tmp_path / "many.zip", {f"{i}.png": b"" for i in range(4)})
    assert refused(path, most=3) == problem(Code.TOO_MANY_MEMBERS, None, "at most 3", "4")
    with Archive(path, max_members=4) as archive:
        assert len(archive.members) == 4


@pytest.mark.parametrize("offset", [0, 10, 26])
def test_members_that_share_bytes_are_refused(tmp_path: Path, make: type[Make], offset: int) -> None:
    whole = bytearray(make.zip(tmp_path / "whole.zip", {"a.png": b"x" * 50, "b.png": b"y" * 50}).read_bytes())
    second = whole.rindex(b"PK\x01\x02")
    whole[second + 42 : second + 46] = struct.pack("<I", offset)  # its header is said to lie inside the first member
    found = refused(as_file(tmp_path, whole))
    assert found == problem(Code.OVERLAPPING_MEMBERS, "b.png")


def test_directories_are_no_members_and_positions_count_them(tmp_path: Path, make: type[Make]) -> None:
    path = make.zip(tmp_path / "dirs.zip", [(entry("V-01/", 0o040755), b""), ("V-01/a.png", b"12")])
    with Archive(path, max_members=2) as archive:
        assert archive.members == (Member("V-01/a.png", 2, 1),)
        assert archive.read(archive.members[0], 2) == b"12"
        assert archive.start(archive.members[0], 1) == b"1"


@pytest.mark.parametrize(
    ("name", "junk"),
    [
        ("__MACOSX/V-01/._a.png", True),
        ("V-01/.DS_Store", True),
        ("Thumbs.db", True),
        ("desktop.ini", True),
        ("V-01\\Thumbs.db", True),
        ("README", False),
        ("V-01/a.png", False),
    ],
)
def test_what_operating_systems_leave_behind_is_junk(name: str, *, junk: bool) -> None:
    assert Member(name, 0, 0).is_junk is junk


def unreadable(archive: Archive, limit: int = 1000) -> Said:
    with pytest.raises(Refused) as caught:
        archive.read(archive.members[0], limit)
    return caught.value.problem.as_json()


def test_a_member_above_its_limit_is_not_read(tmp_path: Path, make: type[Make]) -> None:
    with Archive(make.zip(tmp_path / "big.zip", {"a.png": bytes(101)}), max_members=1) as archive:
        assert unreadable(archive, 100) == problem(Code.UNREADABLE, "a.png", "at most 100 bytes", "101 bytes")
        assert archive.read(archive.members[0], 101) == bytes(101)


def test_a_member_whose_checksum_is_wrong_is_unreadable(tmp_path: Path, make: type[Make]) -> None:
    stored = make.zip(tmp_path / "whole.zip", {"a.png": b"0123456789"}, zipfile.ZIP_STORED).read_bytes()
    with Archive(as_file(tmp_path, patched(stored, b"345", b"3x5", 1)), max_members=1) as archive:
        assert unreadable(archive) == problem(Code.UNREADABLE, "a.png", "an intact member", "its checksum is wrong")


def test_a_member_that_is_larger_than_it_claims_is_unreadable(tmp_path: Path, make: type[Make]) -> None:
    whole = bytearray(make.zip(tmp_path / "whole.zip", {"a.png": bytes(5000)}).read_bytes())
    at = whole.index(b"PK\x01\x02") + 24
    whole[at : at + 4] = struct.pack("<I", 10)
    with Archive(as_file(tmp_path, whole), max_members=1) as archive:
        assert archive.members[0].size == 10
        found = "it holds more than 10 bytes"
        assert unreadable(archive, 10) == problem(Code.UNREADABLE, "a.png", "an intact member", found)


def test_a_member_with_less_data_than_it_claims_is_unreadable(tmp_path: Path, make: type[Make]) -> None:
    whole = bytearray(make.zip(tmp_path / "whole.zip", {"a.png": b"12345"}).read_bytes())
    at = whole.index(b"PK\x01\x02") + 24
    whole[at : at + 4] = struct.pack("<I", 500)
    with Archive(as_file(tmp_path, whole), max_members=1) as archive:
        found = "it holds 5 bytes instead of 500"
        assert unreadable(archive) == problem(Code.UNREADABLE, "a.png", "an intact member", found)


def test_a_header_whose_name_is_no_utf8_makes_its_member_unreadable(tmp_path: Path, make: type[Make]) -> None:
    whole = make.zip(tmp_path / "whole.zip", {"ä.png": b"1"}).read_bytes()
    with Archive(as_file(tmp_path, whole.replace(b"\xc3", b"\xff", 1)), max_members=1) as archive:
        found = unreadable(archive)
        assert (found["member"], found["code"], found["expected"]) == ("ä.png", "unreadable", "an intact member")
        assert found["found"] == "its local header contradicts the directory"
        assert archive.start(archive.members[0], 5) == b""


def ordinary() -> bytes:
    whole = io.BytesIO()
    with zipfile.ZipFile(whole, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("V-01/1-2.png", b"abc" * 50)
        archive.writestr("ü/1-3.png", b"abd" * 50)
    return whole.getvalue()


WHOLE = ordinary()


@given(st.lists(st.tuples(st.integers(0, len(WHOLE) - 1), st.integers(0, 255)), min_size=1, max_size=3))
def test_no_damage_does_more_than_refuse(changes: list[tuple[int, int]]) -> None:
    data = bytearray(WHOLE)
    for position, value in changes:
        data[position] = value
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder, "damaged.zip")
        path.write_bytes(data)
        try:
            with Archive(path, max_members=9) as archive:
                for member in archive.members:
                    assert len(archive.start(member, 8)) <= 8
                    assert len(archive.read(member, 150)) <= 150
        except Refused as refusal:
            assert refusal.problem.as_json()["hint"]


@given(st.text())
def test_a_name_is_shown_without_anything_that_steers_a_page_or_a_terminal(name: str) -> None:
    assert all(c.isprintable() for c in shown(name))
    assert len(shown(name)) == min(200, len(name))
