"""The demo: synthetic labels, an account, and submissions that differ in quality, on first use."""

from __future__ import annotations

import hashlib
import os
import shlex
import tempfile
from contextlib import suppress
from pathlib import Path

from app.accounts.models import Role, Scope
from app.accounts.service import create_person, create_token, identify_token
from app.errors import Conflict
from app.submissions import service
from app.submissions.lifecycle import Visibility
from app.submissions.service import Entry
from app.tracks.service import current_facts, import_release
from app.wiring import Wired
from evaluator.benchmark import Track
from evaluator.build import build
from evaluator.demo import write_demo, write_predictions
from evaluator.groundtruth import GroundTruth

EMAIL = "demo@example.org"
QUALITIES = {"Sketch": 0.55, "Careful": 0.8, "Nearly there": 0.93}
SAMPLES = ("2d-standard", "3d-standard")


def prepare(wired: Wired, folder: Path) -> str:
    """Make the demo's data, releases and submissions where they are missing; the answer is the demo's token.

    Args:
        wired: the service, its tables made.
        folder: where data and sample zips go.
    """
    benchmark = next(iter(wired.benchmarks.values()))
    if current_facts(wired.db, benchmark) is None:
        folder.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryDirectory(dir=folder) as work:
            write_demo(Path(work) / "data", benchmark=benchmark)
            build(Path(work) / "data", Path(work) / "data" / "splits", Path(work) / "packed", benchmark)
            import_release(wired.db, wired.settings.releases, Path(work) / "packed", benchmark, now=wired.now())
    token = _token(wired, folder)
    for track_id in SAMPLES:
        if not sample(folder, track_id).is_file():
            _submit_samples(wired, folder, benchmark.track(track_id), token)
    return token


def sample(folder: Path, track_id: str) -> Path:
    """The sample zip of a track."""
    return folder / f"sample-{track_id}.zip"


def curl_line(wired: Wired, folder: Path, token: str) -> str:
    """A complete command that submits a sample and works as it is pasted."""
    zip_file = sample(folder.resolve(), SAMPLES[0])
    return (
        f"curl -H 'Authorization: Bearer {token}' -F track={SAMPLES[0]} -F method='My first method' "
        f"-F visibility=public -F file=@{shlex.quote(str(zip_file))} "
        f"{wired.settings.base_url.rstrip('/')}/api/v1/submissions"
    )


def _token(wired: Wired, folder: Path) -> str:
    """The demo account's token, kept beside the data so that a restart prints the same one."""
    kept = folder / "token"
    if kept.is_file():
        return kept.read_text("utf-8").strip()
    with suppress(Conflict):  # the demo was begun before and cut short
        create_person(wired.db, email=EMAIL, role=Role.MEMBER, name="Demo team", now=wired.now())
    token = create_token(wired.db, email=EMAIL, scope=Scope.SUBMIT, name="demo", now=wired.now())
    folder.mkdir(parents=True, exist_ok=True)
    with os.fdopen(os.open(kept, os.O_WRONLY | os.O_CREAT | os.O_TRUNC, 0o600), "w") as file:
        file.write(token)
    return token


def _submit_samples(wired: Wired, folder: Path, track: Track, token: str) -> None:
    """Submit predictions of different quality; the last thing made is the sample for people to send."""
    facts = current_facts(wired.db, wired.tracks[track.id][0])
    if facts is None:
        return
    benchmark = wired.tracks[track.id][0]
    truth = GroundTruth(wired.settings.releases / facts.groundtruth, benchmark)
    who = identify_token(wired.db, token)

    def write(path: Path, quality: float, seed: int) -> None:
        labelled = ((f.sequence, f.name, truth.labels(track, f).reshape(f.shape)) for f in truth.frames(track))
        write_predictions(labelled, path, kind=track.modality.kind, quality=quality, seed=seed, k=benchmark.k)

    partial = folder / f".sample-{track.id}.zip"
    for seed, (name, quality) in enumerate(QUALITIES.items()):
        write(partial, quality, seed)
        entry = Entry(track.id, name, visibility=Visibility.PUBLIC)
        begun = service.begin(wired, entry, who=who)
        data = partial.read_bytes()
        writer = wired.storage.create(begun.upload_key)
        writer.write(data)
        writer.commit()
        digest = hashlib.sha256(data).hexdigest()
        service.received(wired, begun.id, key=begun.upload_key, sha256=digest, size=len(data))
    write(partial, 0.7, len(QUALITIES))
    partial.replace(sample(folder, track.id))
