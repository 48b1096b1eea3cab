"""The worker: `celery -A workers.celery worker`; its children score, its parent sweeps."""

from __future__ import annotations

import multiprocessing
import os
import resource
import sys
import threading
from functools import lru_cache
from typing import Any

import structlog
from celery import signals
from celery.worker import state

from app.queue import SCORING, make_celery
from app.settings import Settings
from app.submissions.sweeper import sweep
from app.wiring import Wired, wire
from evaluator import compiled

log = structlog.get_logger()

celery = make_celery(Settings())
celery.conf.update(include=["workers.tasks"])

draining = multiprocessing.get_context("fork").Event()
"""Set in the parent when it is asked to stop; its children look at it between two chunks."""


@lru_cache(maxsize=1)
def _wired_of(_pid: int) -> Wired:
    return wire()


def wired() -> Wired:
    """This process's own service: a database connection must not cross a fork."""
    return _wired_of(os.getpid())


@signals.worker_shutting_down.connect
def drain(**_: Any) -> None:  # noqa: ANN401 Celery's signal
    """Ask the children to give back what they work on."""
    draining.set()


@signals.worker_process_init.connect
def prepare_child(**_: Any) -> None:  # noqa: ANN401 Celery's signal
    """Bound what a child may take, and load its kernels before it has work; after the fork, as threads survive none."""
    limit_memory(Settings().scoring_memory_bytes)
    compiled.load()


def limit_memory(size: int) -> None:
    """Have this process run out of memory of its own, mapped files aside, before the machine does (Linux)."""
    if sys.platform == "linux":
        resource.setrlimit(resource.RLIMIT_DATA, (size, size))


@signals.worker_ready.connect
def start_sweeping(**_: Any) -> None:  # noqa: ANN401 Celery's signal
    """Sweep in a thread of the parent for as long as it lives, where this worker scores."""
    if SCORING not in celery.amqp.queues.consume_from:
        return
    threading.Thread(target=_sweep_for_ever, name="sweeper", daemon=True).start()


def _sweep_for_ever() -> None:
    service = wire(pooled=False)
    idle_rounds = 0
    while not draining.wait(service.settings.sweep_seconds):
        try:
            overdue = sweep(service)
        except Exception:
            log.exception("sweep failed")  # the next round tries again: this thread must not die
            continue
        idle_rounds = idle_rounds + 1 if overdue and not state.active_requests else 0
        if idle_rounds * service.settings.sweep_seconds >= service.settings.deaf_seconds:
            log.error("work waits and this worker hears nothing: leaving, to be started again")
            os._exit(1)
