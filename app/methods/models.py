"""Tables of methods."""

from __future__ import annotations

from datetime import datetime
from uuid import UUID, uuid4

from sqlalchemy import ForeignKey, String, UniqueConstraint
from sqlalchemy.orm import Mapped, mapped_column, relationship

from app.accounts.models import Team
from app.database import Base, UtcDateTime


class Method(Base):
    """What a team submits results of."""

    __tablename__ = "methods"
    __table_args__ = (UniqueConstraint("team_id", "name"),)

    id: Mapped[UUID] = mapped_column(primary_key=True, default=uuid4)
    team_id: Mapped[UUID] = mapped_column(ForeignKey("teams.id"))
    name: Mapped[str] = mapped_column(String(100))
    inputs: Mapped[str] = mapped_column(String(40), default="")
    training_data: Mapped[str] = mapped_column(String(200), default="")
    paper: Mapped[str] = mapped_column(String(500), default="")
    code: Mapped[str] = mapped_column(String(500), default="")
    created_at: Mapped[datetime] = mapped_column(UtcDateTime)
    team: Mapped[Team] = relationship()
