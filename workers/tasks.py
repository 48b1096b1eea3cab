"""What the queue may ask for."""

from __future__ import annotations

from uuid import UUID

from app.queue import EVALUATE
from app.submissions import evaluation
from workers.celery import celery, draining, wired


@celery.task(name=EVALUATE)
def evaluate(evaluation_id: str) -> None:
    """Score one submission against one ground truth; safe to deliver twice."""
    evaluation.run(wired(), UUID(evaluation_id), draining=draining.is_set)
