"""What the service needs of a place that keeps uploaded bytes."""

from __future__ import annotations

from contextlib import AbstractContextManager
from pathlib import Path
from typing import Protocol


class Writer(Protocol):
    """An object while it is written; it does not exist for others until it is committed."""

    def write(self, data: bytes) -> None:
        """Append bytes."""

    def commit(self) -> None:
        """Make the object durable and visible under its key: it survives a power cut once this returns."""

    def abort(self) -> None:
        """Leave nothing behind; harmless after a commit."""


class Storage(Protocol):
    """Objects by key; a key is made by the service and never from what somebody sent."""

    def create(self, key: str) -> Writer:
        """Begin an object; an object of that key is replaced on commit."""

    def local(self, key: str) -> AbstractContextManager[Path]:
        """The object as a file on this machine, for the time of the block.

        Raises:
            FileNotFoundError: there is none.
        """

    def delete(self, key: str) -> None:
        """Remove the object; harmless when there is none."""
