"""The database's history leads to the tables that the models describe."""

from __future__ import annotations

from collections.abc import Iterator
from importlib import resources
from pathlib import Path
from typing import Any

import pytest
from alembic import command
from alembic.autogenerate import compare_metadata
from alembic.config import Config
from alembic.migration import MigrationContext
from alembic.script import ScriptDirectory
from sqlalchemy import Engine, Inspector, create_engine, inspect
from sqlalchemy.pool import NullPool

from app.accounts import models as account_models
from app.database import Base, migrate
from app.methods import models as method_models
from app.submissions import models as submission_models
from app.tracks import models as track_models

FEATURES = (account_models, method_models, submission_models, track_models)
TABLES = {
    "chunks",
    "evaluations",
    "groundtruth_releases",
    "memberships",
    "methods",
    "people",
    "scores",
    "submission_events",
    "submissions",
    "teams",
    "tokens",
    "web_sessions",
}


@pytest.fixture
def engine(database_url: str) -> Iterator[Engine]:
    """An engine on a database whose tables are made."""
    made = create_engine(database_url, poolclass=NullPool)
    yield made
    made.dispose()


def config(url: str) -> Config:
    made = Config()
    made.set_main_option("script_location", str(resources.files("migrations")))
    made.set_main_option("path_separator", "os")
    made.attributes["url"] = url
    return made


def differences(engine: Engine) -> list[Any]:
    """What Alembic would write into a next revision."""
    with engine.connect() as connection:
        context = MigrationContext.configure(connection, opts={"compare_type": True, "compare_server_default": True})
        return list(compare_metadata(context, Base.metadata))


def constraints(inspector: Inspector, table: str) -> dict[str, Any]:
    """The columns and constraints of a table, by name."""
    return {
        "columns": {one["name"]: one["nullable"] for one in inspector.get_columns(table)},
        "primary": inspector.get_pk_constraint(table),
        "unique": sorted((one["name"], tuple(one["column_names"])) for one in inspector.get_unique_constraints(table)),
        "foreign": sorted((str(one["name"]), one["referred_table"]) for one in inspector.get_foreign_keys(table)),
        "indexes": sorted((str(one["name"]), tuple(one["column_names"])) for one in inspector.get_indexes(table)),
    }


def described(engine: Engine) -> dict[str, Any]:
    inspector = inspect(engine)
    return {name: constraints(inspector, name) for name in sorted(TABLES)}


def test_the_migrated_tables_are_those_of_the_models(engine: Engine) -> None:
    assert differences(engine) == []
    assert set(Base.metadata.tables) == TABLES
    assert set(inspect(engine).get_table_names()) == TABLES | {"alembic_version"}


def test_names_of_constraints_are_those_that_the_models_would_give(sqlite_url: str, tmp_path: Path) -> None:
    """SQLAlchemy's comparison does not see them, and a later migration finds constraints by name."""
    made = create_engine(f"sqlite:///{tmp_path / 'models.sqlite'}", poolclass=NullPool)
    Base.metadata.create_all(made)
    migrated = create_engine(sqlite_url, poolclass=NullPool)
    assert described(migrated) == described(made)


def test_every_step_back_can_be_taken_and_forward_again(engine: Engine, database_url: str) -> None:
    command.downgrade(config(database_url), "base")
    assert set(inspect(engine).get_table_names()) == {"alembic_version"}
    command.upgrade(config(database_url), "head")
    assert differences(engine) == []


def test_migrating_twice_changes_nothing(engine: Engine, database_url: str) -> None:
    before = described(engine)
    migrate(database_url)
    assert described(engine) == before


def test_the_history_has_one_beginning_and_one_end() -> None:
    script = ScriptDirectory.from_config(config("sqlite://"))
    assert (len(script.get_bases()), len(script.get_heads())) == (1, 1)
