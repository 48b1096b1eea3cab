"""One upload from its first byte to its place in the queue, without ever holding it in memory."""

from __future__ import annotations

import time
import uuid
from collections.abc import Mapping
from dataclasses import replace
from uuid import UUID

from anyio import CancelScope, to_thread
from fastapi import Request
from starlette.requests import ClientDisconnect

from app.accounts.service import Identity
from app.errors import Invalid, Refusal
from app.submissions import service
from app.submissions.lifecycle import Visibility
from app.submissions.service import Begun, Entry
from app.uploads.multipart import Field, FileBegins, FileBytes, parts
from app.uploads.receiving import Received, Receiver
from app.wiring import Wired
from evaluator.benchmark import DEFAULT_ENCODING

KNOWN = frozenset({"track", "method", "labels", "visibility"})


def entry_from(fields: Mapping[str, str]) -> Entry:
    """What the form's fields say.

    Raises:
        Invalid: a field is none that we know, or has a value that it cannot have.
    """
    unknown = sorted(set(fields) - KNOWN)
    if unknown:
        raise Invalid(f"unknown fields: {', '.join(unknown)}; known are: {', '.join(sorted(KNOWN))}, file")
    visibility = fields.get("visibility") or Visibility.PRIVATE
    if visibility not in list(Visibility):
        raise Invalid("the field 'visibility' is 'private' or 'public'", code="unknown_visibility")
    return Entry(
        track=fields.get("track", "").strip(),
        method=fields.get("method", ""),
        encoding=fields.get("labels", "").strip() or DEFAULT_ENCODING,
        visibility=Visibility(visibility),
    )


class _Arrival:
    """The state of one upload: its fields, its row once they are known, its bytes."""

    def __init__(self, wired: Wired, who: Identity, fields: Mapping[str, str]) -> None:
        self.wired, self.who, self.fields = wired, who, dict(fields)
        self.begun: Begun | None = None
        self.entry: Entry | None = None
        self.receiver: Receiver | None = None
        self.done: Received | None = None
        self._told = time.monotonic()

    async def begin_row(self) -> Begun:
        entry = self.entry = entry_from(self.fields)
        return await to_thread.run_sync(lambda: service.begin(self.wired, entry, who=self.who))

    async def file_begins(self) -> None:
        """Check what is known before a byte is kept; fields behind the file are checked when it has arrived."""
        if self.receiver:
            raise Invalid("one file at a time: the form has two fields 'file'", code="two_files")
        if "track" in self.fields and "method" in self.fields:
            self.begun = await self.begin_row()
        key = self.begun.upload_key if self.begun else f"{uuid.uuid4()}.zip"
        self.receiver = Receiver(self.wired.storage, key, max_bytes=self.wired.settings.max_upload_bytes)
        await self.receiver.begin()

    async def file_bytes(self, data: bytes) -> None:
        if self.receiver and await self.receiver.take(data):
            await self._still_here()

    async def file_ends(self) -> None:
        if self.receiver:
            self.done = await self.receiver.finish()

    async def conclude(self) -> Begun:
        if self.done is None:
            raise Invalid("the field 'file' is missing: send a zip", code="file_missing")
        begun = self.begun = await self._row_as_told()
        done = self.done
        await to_thread.run_sync(
            lambda: service.received(self.wired, begun.id, key=done.key, sha256=done.sha256, size=done.size)
        )
        return begun

    def clean_up(self, reason: str) -> None:
        """Leave no bytes, and no row that waits for them."""
        if self.receiver:
            self.receiver.abort()
        unwanted = self.begun is None or service.broke_off(self.wired, self.begun.id, reason=reason)
        if self.done and unwanted:
            self.wired.storage.delete(self.done.key)

    async def _row_as_told(self) -> Begun:
        """The row that says what all fields say: another one where fields behind the file changed something."""
        early, told = self.begun, self.entry
        if early is None or told is None:
            return await self.begin_row()
        now = entry_from(self.fields)
        if now == told:
            return early
        begun = await self.begin_row()
        reason = "sent again under the fields behind the file"
        await to_thread.run_sync(lambda: service.broke_off(self.wired, early.id, reason=reason))
        is_new = begun.method_created or (early.method_created and now.method == told.method)
        return replace(begun, method_created=is_new)

    async def _still_here(self) -> None:
        """Tell the sweeper, a few times within its patience, that bytes are still coming."""
        patience = self.wired.settings.receiving_seconds / 4
        begun = self.begun
        if begun and time.monotonic() - self._told > patience:
            self._told = time.monotonic()
            await to_thread.run_sync(service.still_receiving, self.wired, begun.id)


async def receive(request: Request, wired: Wired, *, who: Identity) -> tuple[UUID, bool]:
    """Receive a submission form; the answer is the submission's id, and whether its method is new.

    Raises:
        Refusal: the form, a field or the file cannot be accepted; nothing is left behind.
    """
    arrival = _Arrival(wired, who, {k: v for k, v in request.query_params.items() if k in KNOWN})
    try:
        async for part in parts(request, max_bytes=wired.settings.max_upload_bytes):
            if isinstance(part, Field):
                arrival.fields[part.name] = part.value
            elif isinstance(part, FileBegins):
                await arrival.file_begins()
            elif isinstance(part, FileBytes):
                await arrival.file_bytes(part.data)
            else:
                await arrival.file_ends()
        begun = await arrival.conclude()
    except BaseException as error:
        with CancelScope(shield=True):
            await to_thread.run_sync(arrival.clean_up, _reason(error))
        if isinstance(error, ClientDisconnect):
            raise Invalid("the upload broke off", code="upload_broken") from error
        raise
    return begun.id, begun.method_created


def _reason(error: BaseException) -> str:
    return f"refused: {error.detail}" if isinstance(error, Refusal) else "the upload broke off"
