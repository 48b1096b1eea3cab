"""The parts of a running service, put together once per process."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from datetime import UTC, datetime
from functools import cached_property

import structlog

from app.database import Database
from app.queue import Queue
from app.settings import Settings
from app.storage.base import Storage
from app.storage.local import LocalStorage
from evaluator.benchmark import Benchmark, Track, load
from evaluator.errors import BenchmarkError


def utc_now() -> datetime:
    """The time, aware, in UTC."""
    return datetime.now(UTC)


@dataclass(frozen=True)
class Wired:
    """What services are called with."""

    settings: Settings
    db: Database
    storage: Storage
    queue: Queue
    benchmarks: dict[str, Benchmark]
    now: Callable[[], datetime] = field(default=utc_now)

    @cached_property
    def tracks(self) -> dict[str, tuple[Benchmark, Track]]:
        """Every track that this server has, with its benchmark."""
        return {t.id: (b, t) for b in self.benchmarks.values() for t in b.all_tracks.values()}


def _log_plainly() -> None:
    """Tracebacks without the values of variables, which may be tokens; a package that happens to be there adds them."""
    plain = structlog.dev.ConsoleRenderer(exception_formatter=structlog.dev.plain_traceback)
    structlog.configure(processors=[*structlog.get_config()["processors"][:-1], plain])


def wire(settings: Settings | None = None, *, pooled: bool = True) -> Wired:
    """Put a service together from its settings; call it after a process has forked.

    Raises:
        BenchmarkError: two benchmarks share an id or a track.
    """
    _log_plainly()
    settings = settings or Settings()
    loaded = [load(path) for path in settings.benchmarks] or [load()]
    ids = [one.id for one in loaded] + [track for one in loaded for track in one.all_tracks]
    twice = sorted({one for one in ids if ids.count(one) > 1})
    if twice:
        raise BenchmarkError(f"ids are used twice: {', '.join(twice)}")
    return Wired(
        settings=settings,
        db=Database(settings.database, pooled=pooled),
        storage=LocalStorage(settings.uploads),
        queue=Queue(settings),
        benchmarks={one.id: one for one in loaded},
    )
