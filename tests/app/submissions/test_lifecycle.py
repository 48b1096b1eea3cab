"""The states of a submission and the moves between them."""

from __future__ import annotations

import itertools

import pytest

from app.submissions.lifecycle import FINAL, MOVES, SAID, Stage, State, may_move

ALLOWED = {
    (State.RECEIVING, State.QUEUED),
    (State.RECEIVING, State.CANCELLED),
    (State.QUEUED, State.RUNNING),
    (State.QUEUED, State.FAILED),
    (State.RUNNING, State.SCORED),
    (State.RUNNING, State.REJECTED),
    (State.RUNNING, State.FAILED),
    (State.RUNNING, State.QUEUED),
    (State.FAILED, State.QUEUED),
}


@pytest.mark.parametrize(("state", "to"), list(itertools.product(State, State)))
def test_every_pair_of_states_is_either_allowed_or_refused_as_the_table_says(state: State, to: State) -> None:
    assert may_move(state, to) is ((state, to) in ALLOWED)


def test_the_table_knows_every_state_and_says_each_to_people() -> None:
    assert set(MOVES) == set(SAID) == set(State)


def test_a_final_state_has_no_way_out_except_that_a_failed_one_may_be_run_again() -> None:
    assert {state: MOVES[state] for state in FINAL} == {
        State.SCORED: frozenset(),
        State.REJECTED: frozenset(),
        State.FAILED: frozenset({State.QUEUED}),
        State.CANCELLED: frozenset(),
    }
    assert all(MOVES[state] for state in State if state not in FINAL)


def test_every_state_can_be_reached_from_the_first_one() -> None:
    seen, edge = set(), {State.RECEIVING}
    while edge:
        seen |= edge
        edge = {to for state in edge for to in MOVES[state]} - seen
    assert seen == set(State)


def test_a_submission_can_follow_every_stage_of_its_evaluation() -> None:
    assert {stage.value for stage in Stage} <= {state.value for state in State}
