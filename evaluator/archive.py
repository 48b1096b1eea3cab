"""An untrusted zip archive, read member by member and never unpacked."""

from __future__ import annotations

import mmap
import re
import stat
import struct
import zipfile
import zlib
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from types import TracebackType
from typing import TYPE_CHECKING

from evaluator.errors import Code, Problem, Refused, printable
from evaluator.inflate import InflateError, crc32, inflate_member

if TYPE_CHECKING:
    from typing_extensions import Self

JUNK = frozenset({".DS_Store", "Thumbs.db", "desktop.ini"})
OTHER_FILES = {b"7z": "a 7z archive", b"\x1f\x8b": "a gzip file", b"BZh": "a bzip2 file", b"Rar!": "a RAR archive"}
_BIDI = "\u061c\u200e\u200f\u202a-\u202e\u2066-\u2069"
_UNSAFE = re.compile(rf"[\x00-\x1f\x7f-\x9f{_BIDI}]|^[/\\]|^[A-Za-z]:|(^|[/\\])\.\.([/\\]|$)")
_ENCRYPTED = 0x1
_UTF8 = 0x800
_ENTRY_BYTES = 200
"""What an entry of the directory takes, with a long name; on average."""
_DIRECTORY_SIZE = 5
"""Where the end record has the size of the directory."""
_RAW_DEFLATE = -15
_LOCAL_MAGIC = 0x04034B50
_LOCAL_HEADER = struct.Struct("<IHHHHHIIIHH")


@dataclass(frozen=True)
class Member:
    """A file inside the archive; `size` is what its directory entry claims."""

    name: str
    size: int
    position: int

    @cached_property
    def parts(self) -> list[str]:
        """The folders and the file's own name, with Windows separators made ordinary."""
        return [part for part in self.name.replace("\\", "/").split("/") if part not in ("", ".")]

    @property
    def is_junk(self) -> bool:
        """Whether an operating system put it there, so that nobody wants to hear of it."""
        return not self.parts or self.parts[-1] in JUNK or "__MACOSX" in self.parts


class Archive:
    """A zip that has passed the checks of its layout, mapped into memory; use it as a context manager, from any thread.

    Raises:
        Refused: on opening, when the archive as a whole breaks a rule.
    """

    def __init__(self, path: Path, *, max_members: int) -> None:
        """Read and check the central directory; no member is read yet."""
        _check_directory(path, max_members)
        with _open(path) as file:
            infos = file.infolist()
        if len(infos) > max_members:
            raise Refused(Problem(Code.TOO_MANY_MEMBERS, None, f"at most {max_members}", str(len(infos))))
        _check_layout(infos)
        for info in infos:
            _check_entry(info)
        with path.open("rb") as stream:
            self._map = mmap.mmap(stream.fileno(), 0, access=mmap.ACCESS_READ)
        self._infos = infos
        self.members = tuple(
            Member(info.filename, info.file_size, position) for position, info in enumerate(infos) if not info.is_dir()
        )

    def read(self, member: Member, limit: int) -> bytes | bytearray:
        """The whole content of a member, its checksum verified.

        Args:
            member: one of `members`.
            limit: how many bytes it may have at the most, whatever it claims.

        Raises:
            Refused: it is damaged or larger than the limit.
        """
        if member.size > limit:
            raise _unreadable(member, f"at most {limit} bytes", f"{member.size} bytes")
        info = self._infos[member.position]
        with memoryview(self._map) as whole:
            start, end = self._extent(whole, member)
            with whole[start:end] as stored:
                try:
                    is_stored = info.compress_type == zipfile.ZIP_STORED
                    data = bytearray(stored) if is_stored else inflate_member(stored, member.size)
                except InflateError as error:
                    raise _unreadable(member, "an intact member", str(error)) from error
        if len(data) != member.size:
            raise _unreadable(member, f"{member.size} bytes, as its entry says", f"{len(data)} bytes")
        if crc32(data) != info.CRC:
            raise _unreadable(member, "an intact member", "its checksum is wrong")
        return data

    def start(self, member: Member, size: int) -> bytes:
        """The first bytes of a member, fewer where it is shorter or damaged; nothing is verified."""
        info = self._infos[member.position]
        try:
            with memoryview(self._map) as whole:
                start, end = self._extent(whole, member)
                if info.compress_type == zipfile.ZIP_STORED:
                    return bytes(whole[start : min(end, start + size)])
                return zlib.decompressobj(_RAW_DEFLATE).decompress(whole[start:end], size)
        except (Refused, zlib.error):
            return b""

    def _extent(self, whole: memoryview, member: Member) -> tuple[int, int]:
        """Where a member's compressed bytes begin and end; its local header must agree with the directory."""
        info = self._infos[member.position]
        local = bytes(whole[info.header_offset : info.header_offset + _LOCAL_HEADER.size])
        if len(local) == _LOCAL_HEADER.size:
            magic, _, _, method, *_, name_length, extra_length = _LOCAL_HEADER.unpack(local)
            named = info.header_offset + _LOCAL_HEADER.size
            start = named + name_length + extra_length
            name = bytes(whole[named : named + name_length])
            encoded = info.orig_filename.encode("utf-8" if info.flag_bits & _UTF8 else "cp437", "replace")
            agrees = magic == _LOCAL_MAGIC and method == info.compress_type and name == encoded
            if agrees and start + info.compress_size <= len(whole):
                return start, start + info.compress_size
        raise _unreadable(member, "an intact member", "its local header contradicts the directory")

    def __enter__(self) -> Self:
        """Itself."""
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Close the file."""
        self._map.close()


def _check_directory(path: Path, max_members: int) -> None:
    """Bound the directory before a list is made of it; its size is in the record at the end, which is followed."""
    with path.open("rb") as file:
        try:
            end = zipfile._EndRecData(file)  # type: ignore[attr-defined]  # noqa: SLF001 the record that ZipFile follows
        except (OSError, struct.error, zipfile.BadZipFile):
            return  # opening it says what is wrong
    if end and end[_DIRECTORY_SIZE] > max_members * _ENTRY_BYTES:
        found = f"a directory of {end[_DIRECTORY_SIZE]} bytes"
        raise Refused(Problem(Code.TOO_MANY_MEMBERS, None, f"at most {max_members}", found))


def _open(path: Path) -> zipfile.ZipFile:
    try:
        return zipfile.ZipFile(path)
    except zipfile.BadZipFile as error:
        with path.open("rb") as file:
            start = file.read(4)
        code = Code.DAMAGED_ARCHIVE if start.startswith(b"PK") else Code.NOT_A_ZIP
        kind = next((kind for magic, kind in OTHER_FILES.items() if start.startswith(magic)), None)
        found = (kind or "another kind of file") if start else "an empty file"
        raise Refused(Problem(code, None, "a zip archive", found if code is Code.NOT_A_ZIP else str(error))) from error
    except (ValueError, UnicodeDecodeError, NotImplementedError, OverflowError, EOFError) as error:
        raise Refused(Problem(Code.DAMAGED_ARCHIVE, None, "a zip archive", str(error))) from error


def _check_layout(infos: list[zipfile.ZipInfo]) -> None:
    """No two members may share bytes: a zip bomb is made of overlaps."""
    end = 0
    for info in sorted(infos, key=lambda one: one.header_offset):
        if info.header_offset < end:
            raise Refused(Problem(Code.OVERLAPPING_MEMBERS, shown(info.filename)))
        end = info.header_offset + _LOCAL_HEADER.size + info.compress_size


def _check_entry(info: zipfile.ZipInfo) -> None:
    name = info.orig_filename
    if not name or _UNSAFE.search(name) or _UNSAFE.search(info.filename):  # newer Pythons have two names
        raise Refused(Problem(Code.UNSAFE_NAME, shown(name), "a plain relative name", ascii(name)))
    kind = stat.S_IFMT(info.external_attr >> 16)
    if kind not in (0, stat.S_IFREG, stat.S_IFDIR):
        found = "a link" if kind == stat.S_IFLNK else "a device or pipe"
        raise Refused(Problem(Code.SPECIAL_FILE, shown(name), "a regular file", found))
    if info.flag_bits & _ENCRYPTED:
        raise Refused(Problem(Code.ENCRYPTED_MEMBER, shown(name)))
    if info.compress_type not in (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED):
        found = f"method {info.compress_type}"
        raise Refused(Problem(Code.UNSUPPORTED_COMPRESSION, shown(name), "deflate or none", found))


def shown(name: str) -> str:
    """A member's name made fit for a page or a terminal: nothing in it can steer either."""
    return printable(name[:200])


def _unreadable(member: Member, expected: str, found: str) -> Refused:
    return Refused(Problem(Code.UNREADABLE, shown(member.name), expected, found))
