"""Objects as files in a folder."""

from __future__ import annotations

import os
import uuid
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path


class LocalWriter:
    """A temporary file that becomes the object when it is committed."""

    def __init__(self, target: Path) -> None:
        """Open a temporary file beside the target."""
        target.parent.mkdir(parents=True, exist_ok=True)
        self._target = target
        self._partial = target.with_name(f".{target.name}.{uuid.uuid4().hex}")
        self._file = self._partial.open("xb")

    def write(self, data: bytes) -> None:
        """Append bytes."""
        self._file.write(data)

    def commit(self) -> None:
        """Flush to the disk, then take the name, then flush the folder that holds it."""
        self._file.flush()
        os.fsync(self._file.fileno())
        self._file.close()
        self._partial.replace(self._target)
        folder = os.open(self._target.parent, os.O_RDONLY)
        try:
            os.fsync(folder)
        finally:
            os.close(folder)

    def abort(self) -> None:
        """Remove the temporary file."""
        self._file.close()
        self._partial.unlink(missing_ok=True)


class LocalStorage:
    """A folder of objects."""

    def __init__(self, folder: Path) -> None:
        """Keep objects below this folder."""
        self._folder = folder

    def create(self, key: str) -> LocalWriter:
        """Begin an object."""
        return LocalWriter(self._folder / key)

    @contextmanager
    def local(self, key: str) -> Iterator[Path]:
        """The object's own file."""
        path = self._folder / key
        if not path.is_file():
            raise FileNotFoundError(key)
        yield path

    def delete(self, key: str) -> None:
        """Remove the object."""
        (self._folder / key).unlink(missing_ok=True)
