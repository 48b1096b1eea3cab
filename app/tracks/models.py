"""Tables of ground-truth releases."""

from __future__ import annotations

from datetime import datetime
from uuid import UUID, uuid4

from sqlalchemy import Index, String, Text, UniqueConstraint, text
from sqlalchemy.orm import Mapped, mapped_column

from app.database import Base, UtcDateTime


class GroundTruthRelease(Base):
    """A packed release: its public facts are here, its labels only where the workers are."""

    __tablename__ = "groundtruth_releases"
    __table_args__ = (
        UniqueConstraint("benchmark", "digest"),
        Index(
            "uq_groundtruth_releases_current",
            "benchmark",
            unique=True,
            postgresql_where=text("current"),
            sqlite_where=text("current"),
        ),
    )

    id: Mapped[UUID] = mapped_column(primary_key=True, default=uuid4)
    benchmark: Mapped[str] = mapped_column(String(100))
    digest: Mapped[str] = mapped_column(String(64))
    facts: Mapped[str] = mapped_column(Text)
    facts_sha256: Mapped[str] = mapped_column(String(64))
    current: Mapped[bool]
    imported_at: Mapped[datetime] = mapped_column(UtcDateTime)
