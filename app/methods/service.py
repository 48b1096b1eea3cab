"""Methods, made when they are first named."""

from __future__ import annotations

import unicodedata
from datetime import datetime
from uuid import UUID

from sqlalchemy import select
from sqlalchemy.exc import IntegrityError
from sqlalchemy.orm import Session

from app.errors import Invalid
from app.methods.models import Method

MAX_NAME = 100


def checked_name(name: str) -> str:
    """A method's name as it is kept: Unicode normalised, white space folded.

    Raises:
        Invalid: it is empty, too long, or has characters that cannot be seen.
    """
    name = " ".join(unicodedata.normalize("NFC", name).split())
    if not name:
        raise Invalid("the field 'method' names your method; it is empty", code="method_missing")
    if len(name) > MAX_NAME or not name.isprintable():
        raise Invalid(f"a method's name has at most {MAX_NAME} visible characters", code="method_name")
    return name


def find_or_make(session: Session, *, team_id: UUID, name: str, now: datetime) -> tuple[Method, bool]:
    """The team's method of this name, and whether it was made just now; inside the caller's transaction."""
    name = checked_name(name)
    mine = select(Method).where(Method.team_id == team_id, Method.name == name)
    found = session.scalar(mine)
    if found:
        return found, False
    made = Method(team_id=team_id, name=name, created_at=now)
    try:
        with session.begin_nested():
            session.add(made)
    except IntegrityError:  # another upload of the team has just made it
        return session.scalars(mine).one(), False
    return made, True
