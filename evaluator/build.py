"""A data set in the WildScenes layout, packed into a release of ground truth and its public facts."""

from __future__ import annotations

import csv
import itertools
import json
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from evaluator import __version__
from evaluator.benchmark import UNLABELLED, Benchmark
from evaluator.errors import GroundTruthError
from evaluator.frames import Facts, Frame, ModalityFacts, frame_name, is_comparable
from evaluator.groundtruth import FACTS, RELEASE, PackedFrame, Release, release_digest
from evaluator.packing import Entry, Listed, pack_labels

SPLITS = ("train", "val", "test")
SHOWN = 5
"""Files that an error lists."""
Progress = Callable[[int, int], None]


def read_splits(folder: Path, benchmark: Benchmark) -> dict[str, list[Listed]]:
    """Read the official split files: the frames of each modality that the folder has files for.

    Raises:
        GroundTruthError: a file has no such columns, names an unknown sequence, or lists a frame twice.
    """
    listed: dict[str, list[Listed]] = {}
    for modality_id, modality in benchmark.modalities.items():
        files = {split: folder / modality.splits / f"{split}.csv" for split in SPLITS}
        if any(file.is_file() for file in files.values()):
            listed[modality_id] = [
                row for split, file in files.items() if file.is_file() for row in _rows(file, split, benchmark)
            ]
            _no_twins(listed[modality_id], modality_id)
    if not listed:
        wanted = " or ".join(f"{m.splits}/test.csv" for m in benchmark.modalities.values())
        raise GroundTruthError(f"{folder} has no split files: expected {wanted}")
    return listed


def build(  # noqa: PLR0913 each is an option of the command
    data: Path,
    splits: Path,
    out: Path,
    benchmark: Benchmark,
    *,
    is_open: bool = False,
    allow_absent: bool = False,
    progress: Progress | None = None,
) -> Release:
    """Pack the val and test labels of a data set; the train labels, where they are at hand, give the class shares.

    A run that breaks off leaves a folder `.<out>.partial`; the same call goes on from there.

    Args:
        data: the root that the paths of the split files start from.
        splits: the folder of the split files.
        out: the folder to make; it must not exist or be empty.
        benchmark: the definition that names classes, encodings and tracks.
        is_open: whether everybody may see these labels, so that every figure may be shown in full.
        allow_absent: accept a ranked track in which a scored class has no ground truth.
        progress: called with the files done and the files in all.

    Raises:
        GroundTruthError: files are missing or damaged, a value is outside the encoding, or a class is absent.
    """
    if out.exists() and any(out.iterdir()):
        raise GroundTruthError(f"{out} is not empty")
    listed = read_splits(splits, benchmark)
    wanted = {m: _present(data, rows) for m, rows in listed.items()}
    total, done = sum(map(len, wanted.values())), itertools.count(1)

    def step() -> None:
        if progress:
            progress(next(done), total)

    work = out.with_name(f".{out.name}.partial")  # stays when it breaks off, for the next run to go on with
    work.mkdir(parents=True, exist_ok=True)
    for left in set(work.iterdir()) - {work / f"{m}.{kind}" for m in wanted for kind in ("runs", "journal")}:
        left.unlink()
    entries = {m: pack_labels(data, rows, benchmark, m, work, step) for m, rows in wanted.items()}
    counts = {m: _sums(one) for m, one in entries.items()}
    if not allow_absent:
        _check_absent(benchmark, counts)
    packed = {m: [_described(entry) for entry in one if entry.split != "train"] for m, one in entries.items()}
    release = _write_manifest(work, benchmark, packed, counts, data, is_open=is_open)
    for modality_id in entries:
        (work / f"{modality_id}.journal").unlink()
    if out.exists():
        out.rmdir()
    work.rename(out)
    return release


def _rows(file: Path, split: str, benchmark: Benchmark) -> Iterator[Listed]:
    sequences = {one.name for one in benchmark.sequences}
    with file.open(newline="", encoding="utf-8") as stream:
        for row in csv.DictReader(stream):
            if not row.get("id") or not row.get("label_path"):
                raise GroundTruthError(f"{file} needs the columns id and label_path")
            path = Path(row["label_path"])
            if path.is_absolute() or ".." in path.parts:
                raise GroundTruthError(f"{file}: {path} leaves the data set's folder")
            own = [part for part in path.parts if part in sequences]
            if len(own) != 1:
                raise GroundTruthError(f"{file}: {path} names no sequence of {', '.join(sorted(sequences))}")
            yield Listed(frame_name(row["id"]), own[0], split, path)


def _no_twins(rows: list[Listed], modality_id: str) -> None:
    seen: set[str] = set()
    for row in rows:
        if row.name in seen:
            raise GroundTruthError(f"the {modality_id} split files list frame {row.name} twice")
        seen.add(row.name)


def _present(data: Path, rows: list[Listed]) -> list[Listed]:
    """Rows whose files exist; train labels may be missing as a whole, nothing else may."""
    missing = [row for row in rows if not (data / row.path).is_file()]
    train = [row for row in rows if row.split == "train"]
    if missing and {row.name for row in missing} == {row.name for row in train}:
        return [row for row in rows if row.split != "train"]
    if missing:
        shown = ", ".join([*(str(row.path) for row in missing[:SHOWN]), *(["…"] if len(missing) > SHOWN else [])])
        raise GroundTruthError(f"{len(missing)} label files are missing below {data}: {shown}")
    return rows


def _described(entry: Entry) -> tuple[Frame, PackedFrame]:
    return (
        Frame(name=entry.name, sequence=entry.sequence, split=entry.split, shape=entry.shape),
        PackedFrame(name=entry.name, offset=entry.offset, runs=entry.runs, sha256=entry.sha256),
    )


def _sums(entries: list[Entry]) -> dict[tuple[str, str], NDArray[np.int64]]:
    """Pixels or points of each class, shape (256,), by split and sequence."""
    sums: dict[tuple[str, str], NDArray[np.int64]] = {}
    for entry in entries:
        held = sums.setdefault((entry.split, entry.sequence), np.zeros(256, np.int64))
        for value, count in entry.counts.items():
            held[value] += count
    return sums


def _check_absent(benchmark: Benchmark, counts: dict[str, dict[tuple[str, str], NDArray[np.int64]]]) -> None:
    absent = []
    for track in benchmark.all_tracks.values():
        held = [n for key, n in counts.get(track.modality_id, {}).items() if track.holds(*key)]
        if held and track.protocol.ranked:
            totals = np.sum(held, axis=0)
            absent += [f"{track.id}: {benchmark.names[i]}" for i in track.scored if not totals[i]]
    if absent:
        raise GroundTruthError(
            f"scored classes without ground truth (rows of one board would be means over different classes; "
            f"--allow-absent accepts that for a trial): {'; '.join(absent)}"
        )


def _write_manifest(  # noqa: PLR0913 all of what was built
    work: Path,
    benchmark: Benchmark,
    packed: dict[str, list[tuple[Frame, PackedFrame]]],
    counts: dict[str, dict[tuple[str, str], NDArray[np.int64]]],
    data: Path,
    *,
    is_open: bool,
) -> Release:
    marker = data / "dataset.json"
    about = json.loads(marker.read_text("utf-8")) if marker.is_file() else {}
    synthetic = bool(about.get("synthetic"))
    facts = {
        m: ModalityFacts(frames=tuple(frame for frame, _ in rows), train_shares=_shares(benchmark, counts[m]))
        for m, rows in packed.items()
    }
    digest = release_digest(benchmark, {m: [(f, p.sha256) for f, p in rows] for m, rows in packed.items()})
    release = Release(
        benchmark=benchmark.id,
        groundtruth=digest,
        classes=benchmark.names,
        open=is_open,
        evaluator=__version__,
        modalities={m: tuple(p for _, p in rows) for m, rows in packed.items()},
        totals={m: _totals(benchmark, rows) for m, rows in counts.items()},
    )
    public = Facts(
        benchmark=benchmark.id,
        title=about.get("title", benchmark.title),
        groundtruth=digest,
        open=is_open,
        synthetic=synthetic,
        comparable=is_comparable(benchmark, facts, synthetic=synthetic),
        modalities=facts,
    )
    (work / RELEASE).write_text(release.model_dump_json(), "utf-8")
    (work / FACTS).write_text(public.model_dump_json(), "utf-8")
    return release


def _shares(benchmark: Benchmark, counts: dict[tuple[str, str], NDArray[np.int64]]) -> dict[str, float] | None:
    train = [n for (split, _), n in counts.items() if split == "train"]
    totals = np.sum(train, axis=0)[: benchmark.k] if train else np.zeros(benchmark.k)
    if not totals.sum():
        return None
    return {name: float(n / totals.sum()) for name, n in zip(benchmark.names, totals, strict=True)}


def _totals(benchmark: Benchmark, counts: dict[tuple[str, str], NDArray[np.int64]]) -> dict[str, int]:
    held = [n for (split, _), n in counts.items() if split != "train"]
    totals = np.sum(held, axis=0) if held else np.zeros(256, np.int64)
    named = {name: int(n) for name, n in zip(benchmark.names, totals, strict=False)}
    return {**named, "unlabelled": int(totals[UNLABELLED])}
