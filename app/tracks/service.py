"""Ground-truth releases, and what is publicly known of the one in use."""

from __future__ import annotations

import hashlib
import shutil
import uuid
from datetime import datetime
from pathlib import Path

from sqlalchemy import select, update

from app.database import Database
from app.errors import NotFound
from app.tracks.models import GroundTruthRelease
from evaluator.benchmark import Benchmark, Track
from evaluator.errors import GroundTruthError
from evaluator.frames import Facts, Frame
from evaluator.groundtruth import GroundTruth

_parsed: dict[str, Facts] = {}
"""Facts by the SHA-256 of their text: a handful, one for each release that was ever in use."""


def import_release(db: Database, releases: Path, folder: Path, benchmark: Benchmark, *, now: datetime) -> str:
    """Verify a packed release, keep a copy of it, and use it from now on; the answer is its digest.

    Raises:
        GroundTruthError: it is damaged or of another benchmark.
    """
    truth = GroundTruth(folder, benchmark)
    wrong = truth.verify()
    if wrong:
        raise GroundTruthError(f"{folder} is damaged: {'; '.join(wrong[:5])}")
    target = releases / truth.digest
    if not target.is_dir():
        releases.mkdir(parents=True, exist_ok=True)
        partial = releases / f".{truth.digest}-{uuid.uuid4().hex}"
        shutil.copytree(folder, partial)
        partial.rename(target)
    facts = truth.facts.model_dump_json()
    with db.begin() as session:
        mine = GroundTruthRelease.benchmark == benchmark.id
        session.execute(update(GroundTruthRelease).where(mine).values(current=False))
        found = session.scalar(select(GroundTruthRelease).where(mine, GroundTruthRelease.digest == truth.digest))
        if found is None:
            found = GroundTruthRelease(benchmark=benchmark.id, digest=truth.digest, imported_at=now)
            session.add(found)
        found.facts, found.current = facts, True
        found.facts_sha256 = hashlib.sha256(facts.encode()).hexdigest()
    return truth.digest


def current_facts(db: Database, benchmark: Benchmark) -> Facts | None:
    """The public facts of the release in use; None before there is one."""
    with db.read() as session:
        mine = GroundTruthRelease.benchmark == benchmark.id, GroundTruthRelease.current
        known = session.scalar(select(GroundTruthRelease.facts_sha256).where(*mine))
        if known is not None and known not in _parsed:  # half a megabyte: not for every page
            text = session.scalars(select(GroundTruthRelease.facts).where(GroundTruthRelease.facts_sha256 == known))
            _parsed[known] = Facts.model_validate_json(text.one())
    return None if known is None else _parsed[known]


def track_facts(db: Database, benchmark: Benchmark, track: Track) -> Facts:
    """The public facts of one track.

    Raises:
        NotFound: the release in use has no frames for it.
    """
    facts = current_facts(db, benchmark)
    if facts is None or not frames_of(facts, track):
        raise NotFound(f"track {track.id} has no ground truth on this server", code="no_groundtruth")
    return facts.of_track(track)


def frames_of(facts: Facts | None, track: Track) -> tuple[Frame, ...]:
    """The frames of a track; none where the release has none."""
    try:
        return facts.frames(track) if facts else ()
    except GroundTruthError:
        return ()
