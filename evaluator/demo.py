"""A small synthetic data set in the WildScenes layout."""

from __future__ import annotations

import csv
import json
import zipfile
import zlib
from datetime import datetime, timedelta, timezone
from typing import TYPE_CHECKING

import numpy as np

from evaluator.benchmark import UNLABELLED, Benchmark, load
from evaluator.definition import Modality
from evaluator.errors import BenchmarkError
from evaluator.pack import add_member, encode_labels
from evaluator.scenery import COMMON, RARE, draw_cloud, draw_scene, value_noise

if TYPE_CHECKING:
    from collections.abc import Iterable
    from pathlib import Path

    from numpy.typing import NDArray

SMALLEST, FEWEST = (32, 24), 200
"""Width and height in pixels, and points, below which a class might not fit."""

WITH_INSTANCES = 0.3
"""The share of points that have something in the upper 16 bits."""

NOTE = "Made by a program from random numbers. The scores of this data set say nothing about WildScenes."

_SPLITS = ("train", "val", "test")
_VAL_SEQUENCE = "K-01"
_FRAME_SECONDS = 2
_REGIONS = {1: 64, 2: 12}  # per axis, by the number of axes
_COARSEST = {1: 2, 2: 8}


def write_demo(  # noqa: PLR0913 - all but the folder have defaults and go by name
    folder: Path,
    *,
    frames: int = 6,
    size: tuple[int, int] = (252, 189),
    points: int = 4000,
    seed: int = 0,
    benchmark: Benchmark | None = None,
) -> None:
    """Write label maps, clouds' labels and split files of invented forests; no images and no coordinates.

    Each class is in the test frames of each sequence taken together, and so in the train and in the val frames (clouds
    have neither sky nor water). A frame has the same name and scene in both modalities. The same arguments give the
    same bytes.

    Args:
        folder: made if need be; files in it are replaced.
        frames: test frames per sequence, as many train frames, and half as many val frames (K-01 only).
        size: width and height of a label map in pixels, at least 32 x 24.
        points: points of the largest clouds, at least 200; a cloud has up to a tenth fewer.
        seed: another seed gives other scenes and times.
        benchmark: one with the classes of WildScenes and a month for each sequence; WildScenes when omitted.

    Raises:
        ValueError: an argument is below its minimum.
        BenchmarkError: the benchmark lacks a class that the demo draws.
    """
    benchmark = benchmark or load()
    if frames < 1 or size[0] < SMALLEST[0] or size[1] < SMALLEST[1] or points < FEWEST:
        raise ValueError(f"a demo needs at least 1 frame, {SMALLEST[0]} x {SMALLEST[1]} pixels and {FEWEST} points")
    if missing := sorted({*COMMON, *RARE} - set(benchmark.names)):
        raise BenchmarkError(f"the demo draws classes that {benchmark.id} does not have: {', '.join(missing)}")
    rows: dict[tuple[str, str], list[dict[str, str]]] = {
        (split, modality): [] for split in _SPLITS for modality in benchmark.modalities
    }
    for order, sequence in enumerate(benchmark.sequences):
        moment = _start(sequence.date, order, seed)
        for turn, split in enumerate(_SPLITS):
            count = frames if split != "val" else max(1, frames // 2) * (sequence.name == _VAL_SEQUENCE)
            for number in range(count):
                rng = np.random.default_rng([seed, order, turn, number])
                moment += timedelta(seconds=_FRAME_SECONDS)
                frame = f"{int(moment.timestamp())}-{rng.integers(10**9):09}"
                rare = {name for i, name in enumerate(RARE) if i % count == number}
                scene = draw_scene(rng, size, benchmark.names, rare)
                for key, modality in benchmark.modalities.items():
                    labels = (
                        scene if modality.kind == "image" else draw_cloud(rng, scene, benchmark.names, rare, points)
                    )
                    row = _row(key, modality, sequence.name, frame)
                    _write_labels(folder / row["label_path"], labels, benchmark, modality, rng)
                    rows[split, key].append(row)
    for (split, key), listed in rows.items():
        path = folder / "splits" / benchmark.modalities[key].splits / f"{split}.csv"
        path.parent.mkdir(parents=True, exist_ok=True)
        with path.open("w", encoding="utf-8", newline="") as file:
            table = csv.DictWriter(file, list(listed[0]), lineterminator="\n")
            table.writeheader()
            table.writerows(listed)
    about = {"title": f"{benchmark.title} demo", "synthetic": True, "note": NOTE}
    (folder / "dataset.json").write_text(json.dumps(about, indent=2) + "\n", "utf-8")


def degrade(labels: NDArray[np.uint8], quality: float, rng: np.random.Generator, k: int) -> NDArray[np.uint8]:
    """Labels as a model might predict them: boundaries coarse and shifted, regions taken for a class close by.

    Args:
        labels: canonical classes, shape (H, W) or (N,), each 0..k-1 or 255.
        quality: in [0, 1]; 1 changes nothing, at 0 little but the commonest classes is right.
        rng: the same state gives errors in the same places, which grow as the quality falls.
        k: the number of classes.

    Returns:
        The shape of `labels`, with no value that `labels` lacks.

    Raises:
        ValueError: the quality is outside [0, 1].
    """
    if not 0 <= quality <= 1:
        raise ValueError(f"quality {quality} is outside [0, 1]")
    error, shape = 1.0 - quality, labels.shape
    steps = [1 + round(error * min(n / 24, _COARSEST[labels.ndim])) for n in shape]
    drifts = rng.uniform(-1, 1, labels.ndim)
    blocks = (_coarsen(n, step, drift) for n, step, drift in zip(shape, steps, drifts, strict=True))
    coarse: NDArray[np.uint8] = labels[np.ix_(*blocks)]
    counts = np.bincount(coarse.ravel(), minlength=256)[:k]
    chance = np.zeros(256)
    chance[:k] = error * (1.2 - counts / max(1, int(counts.max())))  # the commonest class errs least
    regions = (_REGIONS[labels.ndim],) * labels.ndim
    places = [
        at + value_noise(rng, shape, regions) * n / 6 - n / 12 for at, n in zip(np.indices(shape), shape, strict=True)
    ]
    region = tuple(np.clip(p * r // n, 0, r - 1).astype(int) for p, r, n in zip(places, regions, shape, strict=True))
    moves = rng.uniform(-0.25, 0.25, (labels.ndim, *regions))
    nearby = [
        np.clip(at + move[region] * n, 0, n - 1).astype(int)
        for at, move, n in zip(np.indices(shape), moves, shape, strict=True)
    ]
    return np.where(rng.random(regions)[region] < chance[coarse], coarse[tuple(nearby)], coarse)


def write_predictions(  # noqa: PLR0913 - the choices go by name
    groundtruth_labels: Iterable[tuple[str, str, NDArray[np.uint8]]],
    zip_path: Path,
    *,
    kind: str,
    quality: float,
    seed: int,
    k: int,
) -> None:
    """Write a submission in the `benchmark` encoding, made from the ground truth by `degrade`.

    Args:
        groundtruth_labels: sequence, frame name and canonical labels, shape (H, W) or (N,), of each frame. Unlabelled
            pixels and points get the class of a neighbour: a prediction has no 255.
        zip_path: the zip to write or replace.
        kind: "image" or "cloud".
        quality: in [0, 1], see `degrade`.
        seed: a frame's errors depend on this and on its name, not on the order of frames.
        k: the number of classes.

    Raises:
        ValueError: the kind or the quality is not one of those named.
    """
    if kind not in {"image", "cloud"}:
        raise ValueError(f"unknown kind {kind!r}")
    suffix = ".png" if kind == "image" else ".label"
    with zipfile.ZipFile(zip_path, "w") as archive:
        for sequence, name, labels in groundtruth_labels:
            rng = np.random.default_rng([seed, zlib.crc32(f"{sequence}/{name}".encode())])
            predicted = degrade(_fill(labels), quality, rng, k)
            add_member(archive, f"{sequence}/{name}{suffix}", encode_labels(predicted, kind))


def _coarsen(length: int, step: int, drift: float) -> NDArray[np.int64]:
    """For each place the one whose label it takes: that of its block's centre, moved."""
    at = np.arange(length) // step * step + step // 2 + round(drift * (step - 1))
    return np.clip(at, 0, length - 1)


def _fill(labels: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """Unlabelled places take the last class before them, at the start the first one after; 0 where there is none."""
    flat = labels.ravel()
    known = np.flatnonzero(flat != UNLABELLED)
    if not known.size:
        return np.zeros_like(labels)
    last = np.searchsorted(known, np.arange(flat.size), side="right") - 1
    return flat[known[np.maximum(last, 0)]].reshape(labels.shape)


def _start(date: str, order: int, seed: int) -> datetime:
    """A morning of the sequence's month; no two sequences share a day."""
    month = datetime.strptime(date, "%Y-%m").replace(tzinfo=timezone.utc)
    rng = np.random.default_rng([seed, order])
    return month + timedelta(days=1 + 5 * order + int(rng.integers(5)), seconds=int(rng.integers(3600)))


def _row(key: str, modality: Modality, sequence: str, frame: str) -> dict[str, str]:
    """The line of a split file, as WildScenes writes it."""
    base = f"WildScenes{key}/{sequence}"
    if modality.kind == "image":
        paths = {"im_path": f"{base}/image/{frame}.png", "label_path": f"{base}/indexLabel/{frame}.png"}
    else:
        stem = frame.replace("-", ".")
        paths = {
            "lidar_path": f"{base}/Clouds/{stem}.bin",
            "label_path": f"{base}/Labels/{stem}.label",
            "hist_path": f"{base}/Hists/{stem}.csv",
        }
    return {"id": frame, **paths}


def _write_labels(
    path: Path, labels: NDArray[np.uint8], benchmark: Benchmark, modality: Modality, rng: np.random.Generator
) -> None:
    """Write a label file in the modality's own encoding; a class with two indices has one left, the other right."""
    stored = np.full(labels.shape, UNLABELLED, np.uint8)
    column = np.broadcast_to(np.arange(labels.shape[-1]), labels.shape)
    encoding = benchmark.encodings[modality.groundtruth_encoding].values
    for value, name in (*enumerate(benchmark.names), (UNLABELLED, "unlabelled")):
        indices, here = [i for i, one in enumerate(encoding) if one == name], labels == value
        if indices and here.any():
            stored[here] = indices[0]
            stored[here & (column > column[here].mean())] = indices[-1]
    data = encode_labels(stored, modality.kind)
    if modality.kind == "cloud":
        instances = rng.integers(1, 1 << 16, labels.size, np.uint32) * (rng.random(labels.size) < WITH_INSTANCES)
        data = (np.frombuffer(data, "<u4") | (instances << 16)).astype("<u4").tobytes()
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_bytes(data)
