"""Label files of a data set, read in parallel and written as runs; a journal lets a broken-off run go on."""

from __future__ import annotations

import hashlib
import os
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from itertools import islice
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
from numpy.typing import NDArray
from pydantic import BaseModel, ConfigDict, ValidationError

from evaluator import compiled
from evaluator.benchmark import INVALID, LOW_BITS, UNLABELLED, Benchmark
from evaluator.definition import Modality
from evaluator.errors import GroundTruthError, Refused
from evaluator.groundtruth import decode_runs, encode_runs, labels_digest
from evaluator.labels import read_cloud, read_image

FRAME_PIXELS = 1_000_000
"""What a frame is taken to have before any has been read."""


@dataclass(frozen=True)
class Listed:
    """A row of a split file."""

    name: str
    sequence: str
    split: str
    path: Path


class Entry(BaseModel):
    """A line of the journal: a label file as it was, and what became of it.

    Attributes:
        counts: pixels or points of each canonical class, 255 for unlabelled.
        offset: where its runs begin in the file of runs; train labels are counted, not kept.
    """

    model_config = ConfigDict(frozen=True, extra="forbid")

    path: str
    size: int
    modified: int
    name: str
    sequence: str
    split: str
    shape: tuple[int, ...]
    counts: dict[int, int]
    offset: int
    runs: int
    sha256: str

    @property
    def end(self) -> int:
        """Where its runs end."""
        return self.offset + 5 * self.runs


@dataclass(frozen=True)
class _Packed:
    stat: os.stat_result
    shape: tuple[int, ...]
    runs: bytes
    sha256: str


def pack_labels(  # noqa: PLR0913 a build's whole context
    data: Path, rows: list[Listed], benchmark: Benchmark, modality_id: str, work: Path, step: Callable[[], None]
) -> list[Entry]:
    """Pack the labels of one modality into `<modality>.runs`, going on where an earlier run broke off.

    Args:
        data: the root that the rows' paths start from.
        rows: the frames, train ones among them.
        benchmark: which defines the encoding.
        modality_id: of the rows.
        work: the folder of the files that are made.
        step: called once a file.

    Raises:
        GroundTruthError: a file is damaged, or has a value outside the encoding.
    """
    journal = work / f"{modality_id}.journal"
    made_for = hashlib.sha256(benchmark.model_dump_json().encode()).hexdigest()
    entries = _resumable(journal, made_for, data, rows)
    modality = benchmark.modalities[modality_id]
    with (work / f"{modality_id}.runs").open("ab") as runs, journal.open("wb") as lines:
        runs.truncate(max((entry.end for entry in entries), default=0))
        runs.seek(0, os.SEEK_END)
        lines.write(f"{made_for}\n".encode())
        for entry in entries:
            lines.write(entry.model_dump_json().encode() + b"\n")
            step()
        rest = rows[len(entries) :]
        for row, packed in zip(rest, _pack_all(data, rest, benchmark, modality), strict=True):
            entries.append(_append(runs, lines, row, packed))
            step()
        os.fsync(runs.fileno())
    return entries


def _resumable(journal: Path, made_for: str, data: Path, rows: list[Listed]) -> list[Entry]:
    """Entries of the rows at the beginning whose files are still what they were."""
    if not journal.is_file():
        return []
    first, *lines = journal.read_text("utf-8", "replace").split("\n")
    entries: list[Entry] = []
    for row, line in zip(rows, lines if first == made_for else [], strict=False):
        try:
            entry = Entry.model_validate_json(line)
        except ValidationError:  # the line on which it broke off
            break
        stat = (data / row.path).stat()
        same = (str(row.path), row.name, row.sequence, row.split, stat.st_size, stat.st_mtime_ns)
        if same != (entry.path, entry.name, entry.sequence, entry.split, entry.size, entry.modified):
            break
        entries.append(entry)
    return entries


def _append(runs: BinaryIO, lines: BinaryIO, row: Listed, packed: _Packed) -> Entry:
    classes, lengths = decode_runs(packed.runs, len(packed.runs) // 5)
    counts = np.bincount(classes, weights=lengths, minlength=1)  # exact: whole numbers far below 2 to the 53
    kept = b"" if row.split == "train" else packed.runs
    entry = Entry(
        path=str(row.path),
        size=packed.stat.st_size,
        modified=packed.stat.st_mtime_ns,
        name=row.name,
        sequence=row.sequence,
        split=row.split,
        shape=packed.shape,
        counts={value: int(counts[value]) for value in np.flatnonzero(counts).tolist()},
        offset=runs.tell(),
        runs=len(kept) // 5,
        sha256=packed.sha256,
    )
    runs.write(kept)
    runs.flush()  # the journal never knows of bytes that are not there
    lines.write(entry.model_dump_json().encode() + b"\n")
    lines.flush()
    return entry


def _pack_all(data: Path, rows: list[Listed], benchmark: Benchmark, modality: Modality) -> Iterator[_Packed]:
    columns = benchmark.columns(modality.groundtruth_encoding)
    canonical = np.where(columns == benchmark.k, np.uint8(UNLABELLED), columns)
    compiled.load(len(rows) * FRAME_PIXELS)
    threads, waiting = os.cpu_count() or 1, iter(rows)

    def pack_row(row: Listed) -> _Packed:
        return _pack_one(data, row, modality, canonical)

    with ThreadPoolExecutor(threads) as pool:
        while batch := list(islice(waiting, 8 * threads)):  # few at a time: a frame is megabytes
            yield from pool.map(pack_row, batch)


def _pack_one(data: Path, row: Listed, modality: Modality, canonical: NDArray[np.uint8]) -> _Packed:
    path, member = data / row.path, str(row.path)
    stat, content = path.stat(), path.read_bytes()
    values: NDArray[Any]
    try:
        is_image = modality.kind == "image"
        values = read_image(content, member) if is_image else read_cloud(content, member) & LOW_BITS
    except Refused as error:
        raise GroundTruthError(f"ground truth {error}") from error
    lost = (values > UNLABELLED) | (canonical[np.minimum(values, UNLABELLED)] == INVALID)
    if lost.any():
        found = ", ".join(f"{v} ({n} times)" for v, n in zip(*np.unique(values[lost], return_counts=True), strict=True))
        raise GroundTruthError(f"{row.path}: values outside encoding {modality.groundtruth_encoding!r}: {found}")
    labels = canonical[values]
    return _Packed(stat, labels.shape, encode_runs(labels), labels_digest(labels))
