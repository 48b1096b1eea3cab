"""A multipart form, parsed while it arrives: fields as they come, the file as a stream."""

from __future__ import annotations

from collections.abc import AsyncIterator
from dataclasses import dataclass
from typing import TYPE_CHECKING

from fastapi import Request
from python_multipart.exceptions import FormParserError
from python_multipart.multipart import MultipartParser, parse_options_header

from app.errors import Invalid, Refusal, TooLarge, UnsupportedMedia

if TYPE_CHECKING:
    from python_multipart.multipart import MultipartCallbacks  # it exists for type checkers only

MAX_FIELD, MAX_FIELDS, FORM_OVERHEAD = 10_000, 30, 100_000


@dataclass(frozen=True)
class Field:
    """A whole field of the form."""

    name: str
    value: str


@dataclass(frozen=True)
class FileBegins:
    """The file's part has begun; its bytes come next."""

    name: str


@dataclass(frozen=True)
class FileBytes:
    """Some bytes of the file."""

    data: bytes


@dataclass(frozen=True)
class FileEnds:
    """The file has arrived whole."""


Part = Field | FileBegins | FileBytes | FileEnds


async def parts(request: Request, *, max_bytes: int) -> AsyncIterator[Part]:
    """The parts of a form in their order, holding no more than a block in memory.

    Raises:
        UnsupportedMedia: the body is no multipart form.
        TooLarge: the body is larger than `max_bytes` and the fields' room.
        Invalid: the form is damaged, ends early, or has too many or too long fields.
    """
    kind, options = parse_options_header(request.headers.get("content-type", ""))
    if kind != b"multipart/form-data" or not options.get(b"boundary"):
        raise UnsupportedMedia("send a multipart form, as `curl -F` does", code="not_multipart")
    told = request.headers.get("content-length", "")
    if told.isdecimal() and int(told) > max_bytes + FORM_OVERHEAD:
        raise too_large(max_bytes)
    try:
        collector = _Collector()
        parser = MultipartParser(options[b"boundary"], collector.callbacks())
        got = 0
        async for block in request.stream():
            got += len(block)
            if got > max_bytes + FORM_OVERHEAD:
                raise too_large(max_bytes)
            parser.write(block)
            for part in collector.take():
                yield part
        parser.finalize()
    except FormParserError as error:
        raise Invalid(f"the form cannot be read: {error}", code="bad_form") from error
    if not collector.ended:
        raise Invalid("the form ends early", code="bad_form")


def too_large(max_bytes: int) -> Refusal:
    """The refusal of an upload that has too many bytes."""
    return TooLarge(f"an upload has at most {max_bytes} bytes", code="upload_too_large")


class _Collector:
    """Turns the parser's callbacks into parts."""

    def __init__(self) -> None:
        self.ended = False
        self._ready: list[Part] = []
        self._header, self._value = bytearray(), bytearray()
        self._headers: dict[bytes, bytes] = {}
        self._name, self._is_file, self._fields = "", False, 0
        self._text = bytearray()

    def callbacks(self) -> MultipartCallbacks:
        return {
            "on_part_begin": self._begin,
            "on_header_field": lambda data, start, end: self._header.extend(data[start:end]),
            "on_header_value": lambda data, start, end: self._value.extend(data[start:end]),
            "on_header_end": self._header_end,
            "on_headers_finished": self._headers_finished,
            "on_part_data": self._data,
            "on_part_end": self._end,
            "on_end": self._finished,
        }

    def take(self) -> list[Part]:
        ready, self._ready = self._ready, []
        return ready

    def _begin(self) -> None:
        self._headers, self._text = {}, bytearray()

    def _header_end(self) -> None:
        self._headers[bytes(self._header).lower()] = bytes(self._value)
        self._header.clear()
        self._value.clear()

    def _headers_finished(self) -> None:
        _, options = parse_options_header(self._headers.get(b"content-disposition", b""))
        self._name = options.get(b"name", b"").decode("utf-8", "replace")
        self._is_file = self._name == "file"
        self._fields += 1
        if self._fields > MAX_FIELDS:
            raise Invalid("the form has too many fields", code="bad_form")
        if self._is_file:
            self._ready.append(FileBegins(options.get(b"filename", b"").decode("utf-8", "replace")))

    def _data(self, data: bytes, start: int, end: int) -> None:
        if self._is_file:
            self._ready.append(FileBytes(bytes(data[start:end])))
            return
        self._text += data[start:end]
        if len(self._text) > MAX_FIELD:
            raise Invalid(f"the field {self._name[:50]!r} is too long", code="bad_form")

    def _end(self) -> None:
        if self._is_file:
            self._ready.append(FileEnds())
            return
        try:
            self._ready.append(Field(self._name, self._text.decode("utf-8")))
        except UnicodeDecodeError as error:
            raise Invalid(f"the field {self._name[:50]!r} is not UTF-8", code="bad_form") from error

    def _finished(self) -> None:
        self.ended = True
