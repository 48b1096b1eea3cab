"""Packed ground truth: canonical labels as runs, opened by memory map and verified by digest."""

from __future__ import annotations

import hashlib
import json
from functools import cached_property
from math import prod
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from pydantic import BaseModel, ConfigDict, ValidationError

from evaluator.benchmark import UNLABELLED, Benchmark, Track
from evaluator.confusion import Runs
from evaluator.errors import GroundTruthError
from evaluator.frames import Facts, Frame, read_facts

RELEASE, FACTS = "release.json", "facts.json"


class PackedFrame(BaseModel):
    """Where the labels of a frame lie in its modality's file, and their SHA-256 once they are unpacked.

    `strata` has room for more runs of the same frame (offset and number by name), in which a stratum's value stands for
    each pixel or point: its distance band, how sure its label is. No release has any yet.
    """

    model_config = ConfigDict(frozen=True, extra="forbid")

    name: str
    offset: int
    runs: int
    sha256: str
    strata: dict[str, tuple[int, int]] = {}


class Release(BaseModel):
    """The manifest of a packed release; `totals` counts the pixels or points of each class on each modality."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    format: int = 1
    benchmark: str
    groundtruth: str
    classes: tuple[str, ...]
    open: bool
    evaluator: str
    modalities: dict[str, tuple[PackedFrame, ...]]
    totals: dict[str, dict[str, int]]


def encode_runs(labels: NDArray[np.uint8]) -> bytes:
    """Labels as runs: the class of each run, a byte each, then the lengths, little-endian uint32 each.

    Args:
        labels: canonical classes, 255 for unlabelled; any shape.
    """
    flat = labels.ravel()
    starts = np.flatnonzero(np.concatenate([[True], flat[1:] != flat[:-1]])) if flat.size else np.zeros(0, np.intp)
    lengths = np.diff(starts, append=flat.size)
    return flat[starts].tobytes() + lengths.astype("<u4").tobytes()


def decode_runs(data: bytes | NDArray[np.uint8], runs: int) -> Runs:
    """The runs that `encode_runs` made, sharing the data's memory."""
    return Runs(np.frombuffer(data, np.uint8, runs), np.frombuffer(data, "<u4", runs, offset=runs))


def labels_digest(labels: NDArray[np.uint8]) -> str:
    """SHA-256 of canonical labels, a byte each, row by row."""
    return hashlib.sha256(labels.tobytes()).hexdigest()


def release_digest(benchmark: Benchmark, frames: dict[str, list[tuple[Frame, str]]]) -> str:
    """The digest that names a release: of its classes, frames and labels, whatever file they are packed in.

    Args:
        benchmark: whose classes they are.
        frames: by modality, each frame with the digest of its labels.
    """
    said = {
        "benchmark": benchmark.id,
        "classes": benchmark.names,
        "frames": {
            modality: sorted([f.name, f.sequence, f.split, list(f.shape), digest] for f, digest in rows)
            for modality, rows in sorted(frames.items())
        },
    }
    return hashlib.sha256(json.dumps(said, separators=(",", ":")).encode()).hexdigest()


class GroundTruth:
    """An opened release of hidden labels.

    Raises:
        GroundTruthError: on opening, when the folder holds no release of this benchmark.
    """

    def __init__(self, folder: Path, benchmark: Benchmark) -> None:
        """Read the manifest and the facts; labels are mapped when they are first asked for."""
        self.folder, self.benchmark = folder, benchmark
        try:
            self.release = Release.model_validate_json((folder / RELEASE).read_bytes())
        except (OSError, ValidationError) as error:
            raise GroundTruthError(f"{folder} holds no packed ground truth: {error}") from error
        self.facts: Facts = read_facts(folder / FACTS, benchmark)
        if self.release.benchmark != benchmark.id or self.release.classes != benchmark.names:
            raise GroundTruthError(f"{folder} was packed for another benchmark or other classes; build it again")
        if self.facts.groundtruth != self.release.groundtruth:
            raise GroundTruthError(f"{folder}: {FACTS} and {RELEASE} are of different releases")
        self._index = {
            modality: {one.name: one for one in packed} for modality, packed in self.release.modalities.items()
        }

    @property
    def digest(self) -> str:
        """The digest that names this release."""
        return self.release.groundtruth

    def frames(self, track: Track) -> tuple[Frame, ...]:
        """The frames of a track."""
        return self.facts.frames(track)

    def labels(self, track: Track, frame: Frame) -> NDArray[np.uint8]:
        """The true labels of a frame.

        Returns:
            Shape (N,), row by row: canonical classes, 255 for unlabelled.
        """
        return self.runs(track, frame).expand(prod(frame.shape))

    def runs(self, track: Track, frame: Frame) -> Runs:
        """The true labels of a frame as runs."""
        return self._runs(track.modality_id, self._index[track.modality_id][frame.name])

    def verify(self) -> list[str]:
        """Unpack every frame and compare its digest; returns what is wrong, one sentence each."""
        wrong: list[str] = []
        seen: dict[str, list[tuple[Frame, str]]] = {}
        for modality, facts in self.facts.modalities.items():
            seen[modality] = []
            for frame in facts.frames:
                packed = self._index.get(modality, {}).get(frame.name)
                if packed is None:
                    wrong.append(f"{modality} frame {frame.name} is not packed")
                    continue
                try:
                    labels = self._runs(modality, packed).expand(prod(frame.shape))
                except (ValueError, OSError) as error:
                    wrong.append(f"{modality} frame {frame.name} cannot be unpacked: {error}")
                    continue
                digest = labels_digest(labels)
                seen[modality].append((frame, digest))
                if digest != packed.sha256:
                    wrong.append(f"{modality} frame {frame.name} is damaged")
                elif labels[labels != UNLABELLED].max(initial=0) >= self.benchmark.k:
                    wrong.append(f"{modality} frame {frame.name} has a class that the benchmark lacks")
        if not wrong and release_digest(self.benchmark, seen) != self.digest:
            wrong.append("the digest of the whole does not match")
        return wrong

    def _runs(self, modality: str, packed: PackedFrame) -> Runs:
        return decode_runs(self._maps[modality][packed.offset : packed.offset + 5 * packed.runs], packed.runs)

    @cached_property
    def _maps(self) -> dict[str, NDArray[np.uint8]]:
        return {
            m: np.asarray(np.memmap(self.folder / f"{m}.runs", np.uint8, mode="r")) for m in self.release.modalities
        }
