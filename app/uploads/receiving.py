"""The bytes of one upload on their way to storage: counted, hashed, and durable before anybody names them."""

from __future__ import annotations

import hashlib
from dataclasses import dataclass

from anyio import to_thread

from app.storage.base import Storage
from app.uploads.multipart import too_large

BLOCK = 1 << 20


@dataclass(frozen=True)
class Received:
    """A durable object."""

    key: str
    sha256: str
    size: int


class Receiver:
    """Takes bytes as they come; hashing and writing happen in a thread, a megabyte at a time."""

    def __init__(self, storage: Storage, key: str, *, max_bytes: int) -> None:
        """Begin the object; call `begin` before anything else."""
        self._storage, self._key, self._max = storage, key, max_bytes
        self._hash, self._size, self._block = hashlib.sha256(), 0, bytearray()

    async def begin(self) -> None:
        """Open the object."""
        self._writer = await to_thread.run_sync(self._storage.create, self._key)

    async def take(self, data: bytes) -> bool:
        """Take some bytes; the answer is whether a block was written.

        Raises:
            TooLarge: that is more than an upload may have.
        """
        self._size += len(data)
        if self._size > self._max:
            raise too_large(self._max)
        self._block += data
        if len(self._block) < BLOCK:
            return False
        await to_thread.run_sync(self._flush)
        return True

    async def finish(self) -> Received:
        """Make the object durable."""
        await to_thread.run_sync(self._flush)
        await to_thread.run_sync(self._writer.commit)
        return Received(self._key, self._hash.hexdigest(), self._size)

    def abort(self) -> None:
        """Leave nothing behind."""
        self._writer.abort()

    def _flush(self) -> None:
        block, self._block = bytes(self._block), bytearray()
        self._hash.update(block)
        self._writer.write(block)
