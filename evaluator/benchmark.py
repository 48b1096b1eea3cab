"""The benchmark definition: a TOML file as typed values, and the tracks it makes."""

from __future__ import annotations

import json
import sys
from dataclasses import dataclass
from functools import cached_property
from importlib import resources
from pathlib import Path
from typing import Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, ValidationError, model_validator

from evaluator.definition import (
    MAX_CLASSES,
    Baseline,
    Encoding,
    Limits,
    Modality,
    Name,
    Part,
    Protocol,
    SemanticClass,
    Sequence,
    TrackEntry,
)
from evaluator.errors import BenchmarkError

if sys.version_info >= (3, 11):
    import tomllib
else:
    import tomli as tomllib

UNLABELLED = 255
"""The index of an unlabelled pixel or point, in files and in the canonical space."""

DEFAULT_ENCODING = "benchmark"
"""The label encoding of a submission that names none."""

INVALID = 254
"""What `Benchmark.columns` gives for a value that an encoding does not have."""

LOW_BITS = 0xFFFF
"""Of a point's number in a file: its label; the bits above are an instance."""


@dataclass(frozen=True)
class Track:
    """A modality and a protocol: one leaderboard.

    Attributes:
        scored: canonical indices of the scored classes, ascending.
        official: canonical indices of the official mean, ascending; empty where there is none.
    """

    id: str
    modality_id: str
    modality: Modality
    protocol: Protocol
    scored: tuple[int, ...]
    official: tuple[int, ...]

    @property
    def title(self) -> str:
        """What a page calls the track."""
        return f"{self.modality.title} {self.protocol.title}"

    def holds(self, split: str, sequence: str) -> bool:
        """Whether a frame of this split and sequence is scored on this track."""
        return split == self.protocol.split and sequence in self.protocol.test_sequences


class Benchmark(Part):
    """A whole benchmark definition."""

    format: Literal[1]
    id: Name
    title: str
    summary: str = ""
    url: str = ""
    citation: str = ""
    paper_year: int | None = None
    limits: Limits = Limits()
    classes: tuple[SemanticClass, ...] = Field(min_length=1, max_length=MAX_CLASSES)
    encodings: dict[str, Encoding]
    modalities: dict[str, Modality]
    sequences: tuple[Sequence, ...] = Field(min_length=1)
    protocols: tuple[Protocol, ...] = Field(min_length=1)
    tracks: tuple[TrackEntry, ...] = Field(min_length=1)
    baselines: tuple[Baseline, ...] = ()

    @property
    def k(self) -> int:
        """The number of classes."""
        return len(self.classes)

    @cached_property
    def names(self) -> tuple[str, ...]:
        """The class names in canonical order."""
        return tuple(one.name for one in self.classes)

    @cached_property
    def all_tracks(self) -> dict[str, Track]:
        """Every track by its id, in the order of the definition."""
        protocols = {one.id: one for one in self.protocols}
        made = {}
        for entry in self.tracks:
            modality, protocol = self.modalities[entry.modality], protocols[entry.protocol]
            dropped = set(protocol.not_scored.get(entry.modality, ()))
            kept = dropped - set(modality.official_mean.add if modality.official_mean else ())
            made[entry.id] = Track(
                id=entry.id,
                modality_id=entry.modality,
                modality=modality,
                protocol=protocol,
                scored=tuple(i for i, name in enumerate(self.names) if name not in dropped),
                official=tuple(i for i, name in enumerate(self.names) if name not in kept)
                if modality.official_mean
                else (),
            )
        return made

    def track(self, track_id: str) -> Track:
        """The track with this id.

        Raises:
            BenchmarkError: there is none; the text lists those that exist.
        """
        try:
            return self.all_tracks[track_id]
        except KeyError:
            raise BenchmarkError(f"unknown track {track_id!r}; there are: {', '.join(self.all_tracks)}") from None

    def columns(self, encoding: str) -> NDArray[np.uint8]:
        """Where each value of a label file is counted.

        Args:
            encoding: the name of a label encoding.

        Returns:
            Shape (256,): the canonical class 0..K-1, K for unlabelled (void), `INVALID` for what the encoding lacks.

        Raises:
            BenchmarkError: there is no such encoding.
        """
        if encoding not in self.encodings:
            raise BenchmarkError(f"unknown label encoding {encoding!r}; there are: {', '.join(self.encodings)}")
        table = np.full(256, INVALID, np.uint8)
        table[UNLABELLED] = self.k
        for value, name in enumerate(self.encodings[encoding].values):
            if name:
                table[value] = self.k if name == "unlabelled" else self.names.index(name)
        return table

    @model_validator(mode="after")
    def _names_must_exist(self) -> Benchmark:
        known, sequences = {*self.names, "unlabelled", ""}, {one.name for one in self.sequences}
        protocols = {one.id for one in self.protocols}
        wrong = [
            *(f"encoding {e}: class {v}" for e, one in self.encodings.items() for v in one.values if v not in known),
            *(
                f"modality {m}: encoding {e}"
                for m, one in self.modalities.items()
                for e in (one.groundtruth_encoding, *one.suspects)
                if e not in self.encodings
            ),
            *(
                f"protocol {one.id}: sequence {s}"
                for one in self.protocols
                for s in (*one.test_sequences, *one.train_sequences)
                if s not in sequences
            ),
            *(
                f"protocol {one.id}: class {name}"
                for one in self.protocols
                for names in one.not_scored.values()
                for name in names
                if name not in known
            ),
            *(f"track {t.id}: modality {t.modality}" for t in self.tracks if t.modality not in self.modalities),
            *(f"track {t.id}: protocol {t.protocol}" for t in self.tracks if t.protocol not in protocols),
            *(
                f"baseline {b.title}: track {b.track}"
                for b in self.baselines
                if b.track not in {t.id for t in self.tracks}
            ),
            *(f"baseline {b.title}: class {name}" for b in self.baselines for name in b.iou if name not in known),
        ]
        if len({t.id for t in self.tracks}) != len(self.tracks):
            wrong.append("two tracks share an id")
        if len(set(self.names)) != self.k:
            wrong.append("two classes share a name")
        if wrong:
            raise ValueError("names that are not defined: " + "; ".join(wrong))
        return self


def load(path: Path | None = None) -> Benchmark:
    """Read a benchmark definition.

    Args:
        path: a TOML file; WildScenes, as shipped with this package, when omitted.

    Raises:
        BenchmarkError: the file cannot be read or contradicts itself.
    """
    shipped = resources.files("evaluator") / "benchmarks" / "wildscenes.toml"
    try:
        text = shipped.read_text("utf-8") if path is None else path.read_text("utf-8")
        return Benchmark.model_validate_json(json.dumps(tomllib.loads(text)))  # JSON has no tuples: lists may be them
    except (OSError, UnicodeDecodeError, tomllib.TOMLDecodeError) as error:
        raise BenchmarkError(f"cannot read the benchmark definition {path}: {error}") from error
    except ValidationError as error:
        wrong = "; ".join(f"{'.'.join(map(str, e['loc']))}: {e['msg']}" for e in error.errors())
        raise BenchmarkError(f"the benchmark definition {path or shipped} is not valid: {wrong}") from error
