"""The queue of evaluations: a hint to the workers, never the truth."""

from __future__ import annotations

from typing import Any
from uuid import UUID

from celery import Celery
from kombu.exceptions import OperationalError

from app.settings import Settings

EVALUATE = "wildscenes.evaluate"
SCORING = "scoring"


def make_celery(settings: Settings) -> Celery:
    """The Celery application, as workers run it and as the web sends to it.

    There is no result backend (with one, a lost broker turns a running task into a lost one), and a task is
    acknowledged late: what happened is in SQL.
    """
    celery = Celery("wildscenes", broker=broker_url(settings), set_as_current=False)
    options: dict[str, Any] = {
        "task_acks_late": True,
        "task_reject_on_worker_lost": False,
        "task_ignore_result": True,
        "task_time_limit": settings.scoring_seconds,
        "task_default_queue": SCORING,
        "task_serializer": "json",
        "accept_content": ["json"],
        "worker_prefetch_multiplier": 1,
        "worker_cancel_long_running_tasks_on_connection_loss": False,
        "worker_hijack_root_logger": False,
        "worker_proc_alive_timeout": 60,  # a child first compiles or loads its kernels
        "broker_connection_retry_on_startup": True,
        "broker_transport_options": {
            "visibility_timeout": 24 * 3600,  # far above the longest task: the sweeper is who re-sends
            "unacked_restore_interval": 5,
            "unacked_restore_throttle": 1,
            "socket_timeout": 30,
        },
    }
    celery.conf.update(options)
    return celery


def broker_url(settings: Settings) -> str:
    """The broker's address; the embedded one's socket when none is set."""
    return settings.broker_url or f"redis+socket://{(settings.home / 'broker.sock').resolve()}"


class Queue:
    """What the service sends to."""

    def __init__(self, settings: Settings) -> None:
        """Prepare the application; nothing connects yet."""
        self._celery = make_celery(settings)
        self._celery.conf.update(
            broker_connection_timeout=1,
            broker_transport_options={"socket_timeout": 1, "socket_connect_timeout": 1, "max_retries": 0},
        )

    def send(self, evaluation_id: UUID) -> bool:
        """Hand an evaluation to the workers: one try of a second; False when the broker is away.

        The sweeper sends a waiting evaluation again, so that nothing is lost by a failure here.
        """
        try:
            self._celery.send_task(EVALUATE, args=[str(evaluation_id)], retry=False)
        except (OperationalError, OSError):
            return False
        return True
