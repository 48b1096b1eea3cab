"""What is publicly known of a release: its frames, their sizes, and the class shares of the train split."""

from __future__ import annotations

import re
from collections import Counter
from pathlib import Path

from pydantic import BaseModel, ConfigDict, ValidationError

from evaluator.benchmark import Benchmark, Track
from evaluator.errors import GroundTruthError

_TIMESTAMP = re.compile(r"^(\d+)\.(\d+)$")


def frame_name(stem: str) -> str:
    """The one spelling of a frame's name: `-` between seconds and nanoseconds, where files may have `.`."""
    return _TIMESTAMP.sub(r"\1-\2", stem)


class Frame(BaseModel):
    """One image or cloud; `shape` is (height, width) or (points,)."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    name: str
    sequence: str
    split: str
    shape: tuple[int, ...]


class ModalityFacts(BaseModel):
    """The frames of one modality, and its share of each class in the train split (null where it was not at hand)."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    frames: tuple[Frame, ...]
    train_shares: dict[str, float] | None = None


class Facts(BaseModel):
    """A file to give away: what a submission is checked against where no labels are.

    Attributes:
        groundtruth: the digest of the release that these are the facts of.
        synthetic: whether its labels were made up, as the demo's are.
        comparable: whether its frames are the benchmark's own; scores on other data are not comparable with the paper.
    """

    model_config = ConfigDict(frozen=True, extra="forbid")

    format: int = 1
    benchmark: str
    title: str
    groundtruth: str
    open: bool
    synthetic: bool = False
    comparable: bool
    modalities: dict[str, ModalityFacts]

    def frames(self, track: Track) -> tuple[Frame, ...]:
        """The frames of a track, in the order of their names within their sequences.

        Raises:
            GroundTruthError: the release has none.
        """
        modality = self.modalities.get(track.modality_id)
        held = [f for f in modality.frames if track.holds(f.split, f.sequence)] if modality else []
        found = tuple(sorted(held, key=lambda frame: (frame.sequence, frame.name)))
        if not found:
            raise GroundTruthError(f"this release has no frames for track {track.id}")
        return found

    def of_track(self, track: Track) -> Facts:
        """The same facts, with the frames of one track only."""
        shares = self.modalities[track.modality_id].train_shares
        only = ModalityFacts(frames=self.frames(track), train_shares=shares)
        return self.model_copy(update={"modalities": {track.modality_id: only}})


def read_facts(path: Path, benchmark: Benchmark) -> Facts:
    """Read a file of facts.

    Raises:
        GroundTruthError: it cannot be read, or is of another benchmark.
    """
    try:
        facts = Facts.model_validate_json(path.read_bytes())
    except (OSError, ValidationError) as error:
        raise GroundTruthError(f"{path} is no file of facts: {error}") from error
    if facts.benchmark != benchmark.id:
        raise GroundTruthError(f"{path} is of benchmark {facts.benchmark!r}, not {benchmark.id!r}")
    return facts


def is_comparable(benchmark: Benchmark, facts: dict[str, ModalityFacts], *, synthetic: bool) -> bool:
    """Whether a release has exactly as many frames on every track as the benchmark's paper states."""
    counted: Counter[str] = Counter()
    for track in benchmark.all_tracks.values():
        frames = facts[track.modality_id].frames if track.modality_id in facts else ()
        counted[track.id] = sum(track.holds(f.split, f.sequence) for f in frames)
    return not synthetic and all(
        counted[track.id] in (0, track.protocol.frames.get(track.modality_id, counted[track.id]))
        for track in benchmark.all_tracks.values()
    )
