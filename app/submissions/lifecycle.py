"""The states of a submission and the moves between them: one table, no I/O."""

from __future__ import annotations

import enum


class State(enum.StrEnum):
    """Where a submission stands."""

    RECEIVING = "receiving"
    QUEUED = "queued"
    RUNNING = "running"
    SCORED = "scored"
    REJECTED = "rejected"
    FAILED = "failed"
    CANCELLED = "cancelled"


class Visibility(enum.StrEnum):
    """Who may see a submission once it is scored."""

    PRIVATE = "private"
    PUBLIC = "public"


class Stage(enum.StrEnum):
    """Where an evaluation stands."""

    QUEUED = "queued"
    RUNNING = "running"
    SCORED = "scored"
    REJECTED = "rejected"
    FAILED = "failed"


MOVES: dict[State, frozenset[State]] = {
    State.RECEIVING: frozenset({State.QUEUED, State.CANCELLED}),
    State.QUEUED: frozenset({State.RUNNING, State.FAILED}),
    State.RUNNING: frozenset({State.SCORED, State.REJECTED, State.FAILED, State.QUEUED}),
    State.FAILED: frozenset({State.QUEUED}),
    State.SCORED: frozenset(),
    State.REJECTED: frozenset(),
    State.CANCELLED: frozenset(),
}

FINAL = frozenset({State.SCORED, State.REJECTED, State.FAILED, State.CANCELLED})

SAID: dict[State, str] = {
    State.RECEIVING: "The upload is on its way",
    State.QUEUED: "Waiting for a worker",
    State.RUNNING: "Being scored",
    State.SCORED: "Scored",
    State.REJECTED: "Refused; it does not count as an attempt",
    State.FAILED: "Our fault: scoring failed, and the file is kept",
    State.CANCELLED: "The upload broke off; send it again",
}

MAX_FRUITLESS = 3
"""Attempts in a row that stored no new chunk, after which an evaluation has failed."""


def may_move(state: State, to: State) -> bool:
    """Whether a submission in one state may go to another."""
    return to in MOVES[state]
