"""The database means the same on SQLite and PostgreSQL."""

from __future__ import annotations

from datetime import UTC, datetime, timedelta, timezone
from uuid import uuid4

import pytest
from sqlalchemy import Engine, select, text
from sqlalchemy.exc import IntegrityError, StatementError

from app.accounts.models import Membership, Team
from app.database import Database
from app.tracks.models import GroundTruthRelease
from tests.app.world import NOON, World, at_once

BRISBANE = timezone(timedelta(hours=10))


def team(world: World, when: datetime) -> Team:
    made = Team(name="Forest", personal=False, created_at=when)
    with world.wired.db.begin() as session:
        session.add(made)
    with world.wired.db.read() as session:
        return session.get_one(Team, made.id)


@pytest.mark.parametrize(
    "when", [NOON, datetime(2026, 3, 1, 22, 0, 0, 123456, tzinfo=BRISBANE), datetime(2026, 1, 1, tzinfo=UTC)]
)
def test_a_time_comes_back_aware_in_utc_to_the_microsecond(world: World, when: datetime) -> None:
    found = team(world, when).created_at
    assert (found, found.tzinfo) == (when.astimezone(UTC), UTC)


def test_a_time_without_a_zone_is_refused(world: World) -> None:
    with pytest.raises(StatementError, match="a time without a zone"):
        team(world, datetime(2026, 3, 1, 12))  # noqa: DTZ001 what is refused


def test_times_are_compared_across_zones(world: World) -> None:
    made = team(world, NOON)
    half_past = (NOON + timedelta(minutes=30)).astimezone(BRISBANE)
    with world.wired.db.read() as session:
        before = session.scalars(select(Team.id).where(Team.created_at < half_past)).all()
        after = session.scalars(select(Team.id).where(Team.created_at > half_past)).all()
    assert (before, after) == ([made.id], [])


def test_no_update_is_lost_between_four_threads(world: World) -> None:
    """Each reads a value and writes one more: without immediate transactions SQLite lost most of them."""
    with world.wired.db.begin() as session:
        session.add(Team(name="0", personal=False, created_at=NOON))

    def count_up() -> None:
        for _ in range(50):
            with world.wired.db.begin() as session:
                counter = session.scalars(select(Team).with_for_update()).one()
                counter.name = str(int(counter.name) + 1)

    assert at_once([count_up] * 4) == [None] * 4
    with world.wired.db.read() as session:
        assert session.scalars(select(Team.name)).one() == "200"


def test_a_transaction_that_raises_writes_nothing(world: World) -> None:
    def fail() -> None:
        with world.wired.db.begin() as session:
            session.add(Team(name="Half", personal=False, created_at=NOON))
            session.flush()
            raise RuntimeError

    with pytest.raises(RuntimeError):
        fail()
    with world.wired.db.read() as session:
        assert session.scalars(select(Team)).all() == []


def test_a_row_cannot_point_at_nothing(world: World) -> None:
    with pytest.raises(IntegrityError), world.wired.db.begin() as session:
        session.add(Membership(team_id=uuid4(), person_id=uuid4()))


def test_readers_are_not_held_up_by_a_writer(world: World) -> None:
    with world.wired.db.begin() as writing:
        writing.add(Team(name="Later", personal=False, created_at=NOON))
        writing.flush()
        with world.wired.db.read() as session:
            assert session.scalars(select(Team)).all() == []


def test_sqlite_keeps_what_was_committed_through_a_power_cut(small_world: World) -> None:
    with small_world.wired.db.read() as session:
        pragmas = {
            name: session.execute(text(f"PRAGMA {name}")).scalar_one()
            for name in ("journal_mode", "synchronous", "foreign_keys", "busy_timeout")
        }
    assert pragmas == {"journal_mode": "wal", "synchronous": 2, "foreign_keys": 1, "busy_timeout": 30000}


def test_an_unpooled_database_keeps_no_connection(database_url: str) -> None:
    database = Database(database_url, pooled=False)
    with database.read() as session:
        assert session.scalars(select(GroundTruthRelease)).all() == []
    engine: Engine = database.engine
    assert type(engine.pool).__name__ == "NullPool"
    database.dispose()
