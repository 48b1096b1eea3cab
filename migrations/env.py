"""How Alembic connects, and which tables it compares with."""

from __future__ import annotations

from typing import Any, Literal

from alembic import context
from sqlalchemy import create_engine
from sqlalchemy.pool import NullPool

import app.accounts.models
import app.methods.models
import app.submissions.models
import app.tracks.models
from app.database import Base, UtcDateTime
from app.settings import Settings

TABLES = (app.accounts.models, app.methods.models, app.submissions.models, app.tracks.models)


def render_item(kind: str, item: Any, _context: Any) -> str | Literal[False]:  # noqa: ANN401 Alembic's hook
    """Write our own column type by its name."""
    return "UtcDateTime()" if kind == "type" and isinstance(item, UtcDateTime) else False


# A plain engine: SQLite enforces foreign keys only when it is told to, and batch moves of tables need them off.
engine = create_engine(context.config.attributes.get("url") or Settings().database, poolclass=NullPool)
with engine.connect() as connection:
    context.configure(
        connection=connection,
        target_metadata=Base.metadata,
        render_as_batch=connection.dialect.name == "sqlite",
        render_item=render_item,
        compare_type=True,
    )
    with context.begin_transaction():
        context.run_migrations()
