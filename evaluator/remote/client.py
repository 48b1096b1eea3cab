"""The requests that the command line makes of a server."""

from __future__ import annotations

import time
from collections.abc import Callable
from pathlib import Path
from typing import Any, BinaryIO

import httpx2

from evaluator.errors import WildScenesError

FINAL = frozenset({"scored", "rejected", "failed", "cancelled", "withdrawn", "held"})
Sent = Callable[[int, int], None]


class ServerError(WildScenesError):
    """The server cannot be reached, or refused a request; the text says which and why."""


class Client:
    """A server and the token to speak to it with."""

    def __init__(self, server: str, token: str) -> None:
        """Prepare a connection; nothing is sent yet."""
        self._http = httpx2.Client(
            base_url=server.rstrip("/"),
            headers={"Authorization": f"Bearer {token}"},
            timeout=httpx2.Timeout(60, write=600),
        )

    def submit(self, path: Path, fields: dict[str, str], sent: Sent | None = None) -> dict[str, Any]:
        """Upload a zip; the answer is the new submission.

        Raises:
            ServerError: the server refused it, or went away.
        """
        with path.open("rb") as file:
            body = _Watched(file, path.stat().st_size, sent)
            files = {"file": (path.name, body, "application/zip")}
            return self._ask("POST", "/api/v1/submissions", data=fields, files=files)

    def wait(self, submission_id: str, moved: Sent | None = None) -> dict[str, Any]:
        """Ask for a submission until its state is final; the answer is the submission."""
        pause = 0.2
        while True:
            submission = self._ask("GET", f"/api/v1/submissions/{submission_id}")
            progress = submission["progress"]
            if moved and progress["total"]:
                moved(progress["done"], progress["total"])
            if submission["state"] in FINAL:
                return submission
            time.sleep(pause)
            pause = min(3.0, 1.5 * pause)

    def _ask(self, method: str, url: str, **content: Any) -> dict[str, Any]:  # noqa: ANN401 what httpx2 takes
        try:
            response = self._http.request(method, url, **content)
        except httpx2.HTTPError as error:
            raise ServerError(f"{self._http.base_url}: {str(error) or type(error).__name__}") from error
        try:
            said: Any = response.json()
        except ValueError as error:
            raise ServerError(f"{self._http.base_url} is no evaluation server: {response.status_code}") from error
        if response.is_error:
            detail = f": {said['detail']}" if said.get("detail") else ""
            raise ServerError(f"{said.get('title', response.status_code)}{detail}")
        return dict(said)


class _Watched:
    """A file that tells how much of it was read."""

    def __init__(self, file: BinaryIO, size: int, sent: Sent | None) -> None:
        self._file, self._size, self._sent, self._read = file, size, sent, 0

    def read(self, amount: int = -1) -> bytes:
        data = self._file.read(amount)
        self._read += len(data)
        if self._sent and self._size:
            self._sent(self._read, self._size)
        return data

    def seek(self, offset: int, whence: int = 0) -> int:
        return self._file.seek(offset, whence)

    def tell(self) -> int:
        return self._file.tell()

    def fileno(self) -> int:
        return self._file.fileno()

    def __iter__(self) -> _Watched:
        return self

    def __next__(self) -> bytes:
        if data := self.read(1 << 16):
            return data
        raise StopIteration
