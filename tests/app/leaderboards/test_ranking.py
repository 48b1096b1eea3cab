"""Who stands where on a board."""

from __future__ import annotations

from datetime import UTC, datetime, timedelta
from uuid import UUID, uuid5

from hypothesis import given
from hypothesis import strategies as st

from app.leaderboards.ranking import Candidate, Row, rank, standing
from app.submissions.disclosure import Shown, rounded

START = datetime(2026, 1, 1, tzinfo=UTC)
NAMES = UUID(int=0)


def row(method: str, miou: float | None, day: int | None = None) -> Row:
    when = None if day is None else START + timedelta(days=day)
    return Row(method, "team", Shown(miou, None, {}, {}), submitted_at=when, baseline=when is None)


def ranks(rows: list[Row]) -> list[tuple[str, int | None]]:
    return [(one.method, one.rank) for one in rank(rows)]


def candidate(name: str, method: str, day: int, published: int | None) -> Candidate:
    return Candidate(
        submission_id=uuid5(NAMES, name),
        method_id=uuid5(NAMES, method),
        method=method,
        team="team",
        created_at=START + timedelta(days=day),
        published_at=None if published is None else START + timedelta(days=published),
        results={"miou": 1 / (day + 1)},
        inputs="",
        training_data="",
        paper="",
        code="",
    )


def stands(candidates: list[Candidate]) -> list[tuple[UUID, tuple[int, int]]]:
    return [(one.submission_id, attempt) for one, attempt in standing(candidates)]


def test_the_highest_miou_is_first() -> None:
    assert ranks([row("low", 0.1, 0), row("high", 0.9, 1), row("middle", 0.5, 2)]) == [
        ("high", 1),
        ("middle", 2),
        ("low", 3),
    ]


def test_figures_that_read_alike_share_a_rank_and_the_earlier_one_is_first() -> None:
    rows = [row("late", 0.50004, 2), row("early", 0.49996, 1), row("below", 0.4, 0)]
    assert ranks(rows) == [("early", 1), ("late", 1), ("below", 3)]


def test_a_tie_on_the_edge_of_rounding_is_decided_half_to_even() -> None:
    assert ranks([row("a", 0.12345, 1), row("b", 0.1234, 2), row("c", 0.12355, 3)]) == [("c", 1), ("a", 2), ("b", 2)]


def test_the_papers_rows_count_and_come_before_an_equal_submission() -> None:
    rows = [row("ours", 0.4107, 5), row("paper", 0.4107), row("worse", 0.41, 1)]
    assert ranks(rows) == [("paper", 1), ("ours", 1), ("worse", 3)]


def test_a_row_without_miou_is_last_and_has_no_rank() -> None:
    assert ranks([row("undefined", None, 0), row("zero", 0.0, 1)]) == [("zero", 1), ("undefined", None)]


def test_an_empty_board_stays_empty() -> None:
    assert ranks([]) == []


@given(st.lists(st.tuples(st.none() | st.floats(0, 1), st.integers(0, 9)), max_size=12))
def test_a_rank_is_one_more_than_the_number_of_rows_that_read_better(figures: list[tuple[float | None, int]]) -> None:
    rows = [row(str(i), miou, day) for i, (miou, day) in enumerate(figures)]
    ranked = rank(rows)
    assert sorted(one.method for one in ranked) == sorted(one.method for one in rows)
    shown = [f for one in rows if (f := rounded(one.shown.miou, 4)) is not None]
    for one in ranked:
        figure = rounded(one.shown.miou, 4)
        assert one.rank == (None if figure is None else 1 + sum(other > figure for other in shown))


def test_the_submission_published_last_stands_even_when_an_earlier_one_was_better() -> None:
    better, worse = candidate("better", "m", 0, published=3), candidate("worse", "m", 1, published=4)
    assert stands([better, worse]) == [(worse.submission_id, (2, 2))]


def test_publishing_an_older_submission_later_puts_that_one_on_the_board() -> None:
    older, newer = candidate("older", "m", 0, published=9), candidate("newer", "m", 1, published=4)
    assert stands([newer, older]) == [(older.submission_id, (1, 2))]


def test_private_attempts_count_but_never_stand() -> None:
    tries = [candidate(str(day), "m", day, published=1 if day == 1 else None) for day in range(4)]
    assert stands(tries) == [(tries[1].submission_id, (2, 4))]


def test_a_method_with_nothing_published_is_not_on_the_board() -> None:
    assert stands([candidate("a", "m", 0, published=None)]) == []


def test_each_method_has_one_row() -> None:
    mine, theirs = candidate("a", "mine", 0, published=1), candidate("b", "theirs", 1, published=1)
    assert stands([theirs, mine]) == [(mine.submission_id, (1, 1)), (theirs.submission_id, (1, 1))]
