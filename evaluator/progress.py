"""A progress bar where a person watches."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

import click


@contextmanager
def watched(label: str) -> Iterator[Callable[[int, int], None]]:
    """A progress bar on standard error where a person watches; nothing in a pipe."""
    bar: Any = None
    shown = 0

    def step(done: int, total: int) -> None:
        nonlocal bar, shown
        if not sys.stderr.isatty():
            return
        if bar is None:
            bar = click.progressbar(length=total, label=label, file=sys.stderr)
        bar.update(done - shown)
        shown = done

    yield step
    if bar is not None:
        bar.render_finish()
